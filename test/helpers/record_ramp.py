# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Record bags/ramp, the drive of ramp_drive.py, as a rosbag2 with its truth beside it.

Usage: ``python test/helpers/record_ramp.py DIRECTORY``. Deterministic; bags/README.md describes it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import ramp_drive
from analytic_worlds import Array
from ramp_drive import ANGLES, DURATION, LASERS, SCAN_DURATION, TIME_INCREMENT, Laser, TakenScan
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

START_NS = 1_000_000_000_000_000_000
ODOMETRY_PERIOD, TRUTH_PERIOD = 0.02, 0.1
STORE = get_typestore(Stores.ROS2_JAZZY)


def _message(name: str, *values: Any) -> Any:
    return STORE.types[name](*values)


def _header(seconds: float, frame_id: str) -> Any:
    sec, nanosec = divmod(_stamp_ns(seconds), 1_000_000_000)
    stamp = _message("builtin_interfaces/msg/Time", sec, nanosec)
    return _message("std_msgs/msg/Header", stamp, frame_id)


def _stamp_ns(seconds: float) -> int:
    return START_NS + round(seconds * 1e9)


def _vector(name: str, values: Array) -> Any:
    return _message(f"geometry_msgs/msg/{name}", *map(float, values))


def _quaternion(T: Array) -> Any:
    # Ten digits, so that the last bits of a machine's trigonometry do not change the bag.
    return _vector("Quaternion", Rotation.from_matrix(T[:3, :3]).as_quat().round(10))


def _transform(seconds: float, parent: str, child: str, T: Array) -> Any:
    transform = _message(
        "geometry_msgs/msg/Transform", _vector("Vector3", T[:3, 3].round(10)), _quaternion(T)
    )
    return _message(
        "geometry_msgs/msg/TransformStamped", _header(seconds, parent), child, transform
    )


def _odometry(seconds: float, frame_id: str) -> Any:
    """True pose and, in base_link, true velocity."""
    before, T, after = ramp_drive.poses(seconds + np.array([-0.005, 0.0, 0.005]))
    linear = T[:3, :3].T @ (after - before)[:3, 3] / 0.01
    angular = Rotation.from_matrix(before[:3, :3].T @ after[:3, :3]).as_rotvec() / 0.01
    pose = _message("geometry_msgs/msg/Pose", _vector("Point", T[:3, 3].round(10)), _quaternion(T))
    twist = _message(
        "geometry_msgs/msg/Twist",
        _vector("Vector3", linear.round(6) + 0.0),
        _vector("Vector3", angular.round(6) + 0.0),
    )
    return _message(
        "nav_msgs/msg/Odometry",
        _header(seconds, frame_id),
        "base_link",
        _message("geometry_msgs/msg/PoseWithCovariance", pose, np.zeros(36)),
        _message("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36)),
    )


def _laser_scan(laser: Laser, scan: TakenScan) -> Any:
    return _message(
        "sensor_msgs/msg/LaserScan",
        _header(scan.start, laser.frame_id),
        float(ANGLES[0]),
        float(ANGLES[-1]),
        radians(0.5),
        TIME_INCREMENT,
        ramp_drive.SCAN_PERIOD,
        ramp_drive.RANGE_MIN,
        ramp_drive.RANGE_MAX,
        scan.ranges.astype(np.float32),
        np.empty(0, np.float32),
    )


Event = tuple[float, str, Any]
"""When the message is there to be recorded [s], topic, message."""


def events(duration: float) -> Iterator[Event]:
    """All messages of the bag up to a time [s], topic by topic."""
    mounts = [_transform(0.0, "base_link", las.frame_id, las.T_base_sensor) for las in LASERS]
    yield 0.0, "/tf_static", _message("tf2_msgs/msg/TFMessage", mounts)
    for seconds in np.arange(0.0, duration, ODOMETRY_PERIOD):
        T = ramp_drive.poses(np.array([seconds]))[0]
        moving = [_transform(seconds, "odom", "base_link", T)]
        yield seconds, "/odom", _odometry(seconds, "odom")
        yield seconds, "/tf", _message("tf2_msgs/msg/TFMessage", moving)
    for seconds in np.arange(0.0, duration, TRUTH_PERIOD):
        yield seconds, "/ground_truth", _odometry(seconds, "map")
    for laser in LASERS:
        # Only scans that odometry brackets.
        for scan in ramp_drive.take_scans(laser, duration - ODOMETRY_PERIOD):
            taken = scan.start + SCAN_DURATION
            yield taken, laser.topic, _laser_scan(laser, scan)


def _qos(depth: int, reliability: QosReliability, durability: QosDurability) -> Qos:
    never = QosTime(9223372036, 854775807)
    return Qos(QosHistory.KEEP_LAST, depth, reliability, durability, never, never,
               QosLiveliness.AUTOMATIC, never, False)  # fmt: skip


_SENSOR = _qos(5, QosReliability.BEST_EFFORT, QosDurability.VOLATILE)
_DEFAULT = _qos(10, QosReliability.RELIABLE, QosDurability.VOLATILE)
_LATCHED = _qos(1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL)
TOPICS = {
    "/tf_static": ("tf2_msgs/msg/TFMessage", _LATCHED),
    "/tf": ("tf2_msgs/msg/TFMessage", _DEFAULT),
    "/odom": ("nav_msgs/msg/Odometry", _DEFAULT),
    "/ground_truth": ("nav_msgs/msg/Odometry", _DEFAULT),
    "/scan": ("sensor_msgs/msg/LaserScan", _SENSOR),
    "/scan_down": ("sensor_msgs/msg/LaserScan", _SENSOR),
}


def record(directory: Path, duration: float = DURATION) -> None:
    """Write the bag; the directory must not exist."""
    recorded = sorted(events(duration), key=lambda event: event[0])
    writer = Writer(directory, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(
                topic, msgtype, typestore=STORE, offered_qos_profiles=[qos]
            )
            for topic, (msgtype, qos) in TOPICS.items()
        }
        for seconds, topic, message in recorded:
            data = STORE.serialize_cdr(message, TOPICS[topic][0])
            writer.write(connections[topic], _stamp_ns(seconds), data)


def write_truth(directory: Path) -> None:
    """Write what a perfect map of the world holds, and what the lasers could see of it."""
    directory.mkdir(parents=True)
    grid = (ramp_drive.RESOLUTION, ramp_drive.ORIGIN, ramp_drive.SHAPE)
    scans = (scan for laser in LASERS for scan in ramp_drive.take_scans(laser))
    np.savez_compressed(
        directory / "surface.npz",
        top=ramp_drive.WORLD.cell_top(*grid).astype(np.float32),
        seen=ramp_drive.seen_height(scans).astype(np.float32),
        resolution=np.float64(ramp_drive.RESOLUTION),
        origin=np.array(ramp_drive.ORIGIN),
    )


if __name__ == "__main__":
    record(Path(sys.argv[1]))
    write_truth(Path(sys.argv[1]) / "truth")
