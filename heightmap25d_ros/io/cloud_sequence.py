# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A folder of clouds with known poses, as KITTI and 3DTK have them, into a bag.

The bag has the clouds on /points, the poses of the robot on /odom and the mount on /tf_static.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from heightmap25d_ros import se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import POSITION_LIMIT
from heightmap25d_ros.input_files import require_file
from heightmap25d_ros.io import cloud_files
from heightmap25d_ros.io._untrusted import as_input_error
from heightmap25d_ros.io.trajectory import read_tum

POINTS, ODOM, MOUNT = "/points", "/odom", "/tf_static"
SENSOR_FRAME = "lidar"

_SPEED, _TURN_RATE, _PERIOD = 1.0, 0.5, 0.1  # [m/s], [rad/s], [s] where there are no times
_FROM_3DTK = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_STORE = get_typestore(Stores.ROS2_JAZZY)


@dataclass(frozen=True, slots=True, kw_only=True)
class CloudSequence:
    """Clouds and where they were taken.

    Attributes
    ----------
    files : list of Path
        One a cloud, see `cloud_files.read`.
    stamps_ns : (N,) int64 [ns]
    T_map_sensor : (N, 4, 4) float64
    """

    files: list[Path]
    stamps_ns: NDArray[np.int64]
    T_map_sensor: se3.Matrix


def read(
    folder: Path, poses: Path | None = None, times: Path | None = None, calib: Path | None = None
) -> CloudSequence:
    """The clouds of a folder, in the order of their names, with their poses and times.

    Parameters
    ----------
    folder : Path
    poses : Path, optional
        One pose of the sensor a cloud, in their order: lines of 12 numbers, the upper three rows
        of a matrix, as KITTI has them; or TUM text, with times. Without it the folder is 3DTK's:
        a .frames or .pose beside each .3d.
    times : Path, optional
        One time [s] a line. Without times the sensor moves from one cloud to the next at up to
        1 m/s, 0.5 rad/s and 10 Hz.
    calib : Path, optional
        KITTI's, whose ``Tr`` is the pose of the lidar in the camera: the poses are those of the
        camera.

    Raises
    ------
    InputError
        If a file cannot be read, or there are not as many poses and times as clouds.
    """
    found = sorted(folder.iterdir(), key=lambda path: path.name)
    files = [path for path in found if path.suffix in cloud_files.READERS]
    if not files:
        raise InputError(f"{folder}: no file in it ends in {', '.join(cloud_files.READERS)}")
    kinds = {path.suffix for path in files}
    if len(kinds) > 1:
        raise InputError(f"{folder}: has files of several kinds, {', '.join(sorted(kinds))}")
    stamps = None
    if poses is None:
        T = np.array([_beside(path) for path in files])
    else:
        T, stamps = _poses(poses)
    if calib is not None:
        T_camera_lidar = _calibration(calib)
        T = se3.inverse(T_camera_lidar) @ T @ T_camera_lidar
    if times is not None:
        stamps = _times(times)
    if stamps is None:
        stamps = _unhurried(T)
    for name, count in ((poses or folder, len(T)), (times or poses, len(stamps))):
        if count != len(files):
            raise InputError(f"{name}: {count} for the {len(files)} clouds of {folder}")
    is_back = np.diff(stamps) <= 0
    if is_back.any():
        raise InputError(f"{times or poses}: time {is_back.argmax() + 2} is not later")
    return CloudSequence(files=files, stamps_ns=stamps, T_map_sensor=T)


def _numbers(path: Path) -> NDArray[np.float64]:
    """(lines, numbers of a line)."""
    require_file(path)
    with as_input_error(str(path)):
        lines = path.read_text(encoding="utf-8").splitlines()
        rows = [line.split() for line in lines if line.strip() and not line.startswith("#")]
        values = np.array(rows, np.float64).reshape(len(rows), -1)
    if not len(values) or not np.isfinite(values).all():
        raise InputError(f"{path}: is not lines of finite numbers")
    return values


def _poses(path: Path) -> tuple[se3.Matrix, NDArray[np.int64] | None]:
    values = _numbers(path)
    if values.shape[1] == 12:
        return _matrices(path, values.reshape(-1, 3, 4)), None
    tum = read_tum(path)
    T = se3.from_quaternion(tum[:, 1:4], tum[:, 4:])
    return T, np.rint(tum[:, 0] * 1e9).astype(np.int64)


def _matrices(path: Path, upper: NDArray[np.float64]) -> se3.Matrix:
    """Poses (N, 4, 4) of their upper rows (N, 3, 4), with rotations made exact."""
    T = np.tile(np.eye(4), (len(upper), 1, 1))
    u, _, v = np.linalg.svd(upper[:, :, :3])
    T[:, :3, :3], T[:, :3, 3] = u @ v, upper[:, :, 3]
    is_wrong = np.abs(T[:, :3, :3] - upper[:, :, :3]).max(axis=(1, 2)) > 1e-2
    is_wrong |= (np.linalg.det(upper[:, :, :3]) < 0.0) | (np.abs(T[:, :3, 3]) > POSITION_LIMIT).any(
        axis=1
    )
    if is_wrong.any():
        raise InputError(f"{path}: pose {is_wrong.argmax() + 1} is none of a body on Earth")
    return T


def _times(path: Path) -> NDArray[np.int64]:
    return np.rint(_numbers(path)[:, 0] * 1e9).astype(np.int64)


def _calibration(path: Path) -> se3.Matrix:
    require_file(path)
    with as_input_error(str(path)):
        lines = path.read_text(encoding="utf-8").splitlines()
        (numbers,) = [line.split()[1:] for line in lines if line.startswith("Tr")]
        upper = np.array(numbers, np.float64).reshape(1, 3, 4)
    return np.asarray(_matrices(path, upper)[0])


def _beside(path: Path) -> se3.Matrix:
    """3DTK's pose of a scan: the last matrix of its .frames, or position and angles of its .pose.

    Its axes point to the right, up and ahead, which is a left-handed system.
    """
    frames, pose = path.with_suffix(".frames"), path.with_suffix(".pose")
    if frames.exists():
        T = _numbers(frames)[-1, :16].reshape(4, 4).T  # column by column
        rotation, position = T[:3, :3], T[:3, 3]
    elif pose.exists():
        (position, angles) = _numbers(pose).reshape(2, 3)
        rotation = Rotation.from_euler("XYZ", angles, degrees=True).as_matrix()
    else:
        raise InputError(f"{path}: neither {frames.name} nor {pose.name} is beside it; name poses")
    turned = _FROM_3DTK @ rotation @ _FROM_3DTK.T
    upper = np.concatenate([turned, (_FROM_3DTK @ position)[:, None] / 100.0], axis=1)
    return np.asarray(_matrices(path, upper[None])[0])


def _unhurried(T: se3.Matrix) -> NDArray[np.int64]:
    """Times [ns] of poses that have none."""
    motion = se3.inverse(T[:-1]) @ T[1:]
    distance = np.linalg.norm(motion[:, :3, 3], axis=1)
    angle = Rotation.from_matrix(motion[:, :3, :3]).magnitude()
    steps = np.maximum(_PERIOD, np.maximum(distance / _SPEED, angle / _TURN_RATE))
    return np.rint(np.cumsum([1.0, *steps]) * 1e9).astype(np.int64)


def write_bag(directory: Path, sequence: CloudSequence, T_base_sensor: se3.Matrix) -> int:
    """Write a sequence as a new bag; the number of its points.

    Raises
    ------
    InputError
        If the directory exists, or a cloud cannot be read.
    """
    if directory.exists():
        raise InputError(f"{directory}: exists already")
    directory.parent.mkdir(parents=True, exist_ok=True)
    writer = Writer(directory, version=9, storage_plugin=StoragePlugin.MCAP)
    T_map_base = sequence.T_map_sensor @ se3.inverse(T_base_sensor)
    count = 0
    with writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=_STORE)
            for topic, kind in (
                (MOUNT, "tf2_msgs/msg/TFMessage"), (ODOM, "nav_msgs/msg/Odometry"),
                (POINTS, "sensor_msgs/msg/PointCloud2"),
            )
        }  # fmt: skip

        def write(topic: str, stamp_ns: int, message: Any) -> None:
            connection = connections[topic]
            data = _STORE.serialize_cdr(message, connection.msgtype)
            writer.write(connection, stamp_ns, data)

        first = int(sequence.stamps_ns[0])
        write(MOUNT, first, _mount(first, T_base_sensor))
        for file, stamp, T in zip(sequence.files, sequence.stamps_ns, T_map_base, strict=True):
            points = cloud_files.read(file)
            count += len(points)
            write(ODOM, int(stamp), _odometry(int(stamp), T))
            write(POINTS, int(stamp), _cloud(int(stamp), points))
    return count


def _of(kind: str, *values: Any) -> Any:
    return _STORE.types[kind](*values)


def _header(stamp_ns: int, frame_id: str) -> Any:
    stamp = _of("builtin_interfaces/msg/Time", *divmod(stamp_ns, 10**9))
    return _of("std_msgs/msg/Header", stamp, frame_id)


def _vector(kind: str, values: NDArray[np.float64]) -> Any:
    return _of(f"geometry_msgs/msg/{kind}", *map(float, values))


def _mount(stamp_ns: int, T: se3.Matrix) -> Any:
    turn = _vector("Quaternion", se3.to_quaternion(T))
    transform = _of("geometry_msgs/msg/Transform", _vector("Vector3", T[:3, 3]), turn)
    header = _header(stamp_ns, "base_link")
    stamped = _of("geometry_msgs/msg/TransformStamped", header, SENSOR_FRAME, transform)
    return _of("tf2_msgs/msg/TFMessage", [stamped])


def _odometry(stamp_ns: int, T: se3.Matrix) -> Any:
    turn = _vector("Quaternion", se3.to_quaternion(T))
    pose = _of("geometry_msgs/msg/Pose", _vector("Point", T[:3, 3]), turn)
    still = _vector("Vector3", np.zeros(3))
    return _of(
        "nav_msgs/msg/Odometry", _header(stamp_ns, "odom"), "base_link",
        _of("geometry_msgs/msg/PoseWithCovariance", pose, np.zeros(36)),
        _of("geometry_msgs/msg/TwistWithCovariance",
            _of("geometry_msgs/msg/Twist", still, still), np.zeros(36)),
    )  # fmt: skip


def _cloud(stamp_ns: int, points: NDArray[np.float32]) -> Any:
    fields = [
        _of("sensor_msgs/msg/PointField", name, 4 * axis, 7, 1) for axis, name in enumerate("xyz")
    ]
    data = np.frombuffer(points.astype("<f4").tobytes(), np.uint8)
    return _of(
        "sensor_msgs/msg/PointCloud2", _header(stamp_ns, SENSOR_FRAME), 1, len(points), fields,
        False, 12, 12 * len(points), data, bool(np.isfinite(points).all()),
    )  # fmt: skip
