# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""ROS messages of the simulator, and the QoS profiles of its topics."""

from __future__ import annotations

from collections.abc import Iterable
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.typesys import Stores, get_typestore

from heightmap25d_ros import se3
from heightmap25d_ros.simulation.cloud_sensors import DepthCamera, Lidar
from heightmap25d_ros.simulation.lasers import (
    ANGLE_INCREMENT,
    RANGE_MAX,
    RANGE_MIN,
    TIME_INCREMENT,
    Laser,
    TakenScan,
)

Message = Any
START_NS = 1_000_000_000_000_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)

LASER_SCAN, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
TRANSFORMS = "tf2_msgs/msg/TFMessage"


def _qos(depth: int, reliability: QosReliability, durability: QosDurability) -> Qos:
    never = QosTime(9223372036, 854775807)
    return Qos(QosHistory.KEEP_LAST, depth, reliability, durability, never, never,
               QosLiveliness.AUTOMATIC, never, False)  # fmt: skip


_SENSOR = _qos(5, QosReliability.BEST_EFFORT, QosDurability.VOLATILE)
_DEFAULT = _qos(10, QosReliability.RELIABLE, QosDurability.VOLATILE)
_LATCHED = _qos(1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL)


def topics(mounted: Iterable[Laser | Lidar | DepthCamera]) -> dict[str, tuple[str, Qos]]:
    """Topic -> message type and offered QoS profile."""
    return {
        "/tf_static": (TRANSFORMS, _LATCHED),
        "/tf": (TRANSFORMS, _DEFAULT),
        "/odom": (ODOMETRY, _DEFAULT),
        "/ground_truth": (ODOMETRY, _DEFAULT),
        **{
            sensor.topic: (LASER_SCAN, _SENSOR)
            if isinstance(sensor, Laser)
            else (POINT_CLOUD, _DEFAULT)
            for sensor in mounted
        },
    }


def stamp_ns(seconds: float) -> int:
    """Stamp [ns] of a time since the start [s]."""
    return START_NS + round(seconds * 1e9)


def transforms(seconds: float, parent: str, children: Iterable[tuple[str, se3.Matrix]]) -> Message:
    """A TFMessage."""
    return _message(
        TRANSFORMS,
        [
            _message(
                "geometry_msgs/msg/TransformStamped",
                _header(seconds, parent),
                child,
                _message(
                    "geometry_msgs/msg/Transform", _vector("Vector3", T[:3, 3]), _quaternion(T)
                ),
            )
            for child, T in children
        ],
    )


def odometry(seconds: float, frame_id: str, T: se3.Matrix, twist: tuple[float, float]) -> Message:
    """An Odometry of base_link; speed [m/s] and turn rate [rad/s] in base_link."""
    motion = _message(
        "geometry_msgs/msg/Twist",
        _vector("Vector3", np.array([twist[0], 0.0, 0.0])),
        _vector("Vector3", np.array([0.0, 0.0, twist[1]])),
    )
    return _message(
        ODOMETRY,
        _header(seconds, frame_id),
        "base_link",
        _message("geometry_msgs/msg/PoseWithCovariance", _pose(T), np.zeros(36)),
        _message("geometry_msgs/msg/TwistWithCovariance", motion, np.zeros(36)),
    )


def correction(seconds: float, frame_id: str, T: se3.Matrix) -> Message:
    """A geometry_msgs/PoseWithCovarianceStamped with the pose (4, 4) of odom; no covariance."""
    with_covariance = _message("geometry_msgs/msg/PoseWithCovariance", _pose(T), np.zeros(36))
    return _message(
        "geometry_msgs/msg/PoseWithCovarianceStamped", _header(seconds, frame_id), with_covariance
    )


def path(stamp: int, frame_id: str, poses: se3.Matrix) -> Message:
    """A nav_msgs/Path of poses (N, 4, 4), stamped [ns]."""
    header = _header((stamp - START_NS) * 1e-9, frame_id)
    return _message(
        "nav_msgs/msg/Path",
        header,
        [_message("geometry_msgs/msg/PoseStamped", header, _pose(T)) for T in poses],
    )


def scan(sensor: Laser | Lidar | DepthCamera, taken: TakenScan) -> Message:
    """A LaserScan, or a PointCloud2 of a lidar or a depth camera."""
    if isinstance(sensor, Laser):
        return _laser_scan(sensor, taken)
    points = np.zeros(sensor.shape, _LIDAR_POINT if isinstance(sensor, Lidar) else _PIXEL)
    # Without return: zero in the clouds of lidars, NaN in those of cameras.
    missing = 0.0 if isinstance(sensor, Lidar) else np.nan
    is_return = np.isfinite(taken.ranges)
    ranges = np.where(is_return, taken.ranges, 0.0)[:, None]
    places = np.where(is_return[:, None], ranges * sensor.directions, missing)
    for axis, name in enumerate("xyz"):
        points[name] = places[:, axis].reshape(sensor.shape)
    if isinstance(sensor, Lidar):
        points["t"] = np.rint((sensor.beam_times(0.0) * 1e9).reshape(sensor.shape))
        points["ring"] = np.arange(sensor.rings)[:, None]
    return _point_cloud(_header(taken.start, sensor.frame_id), points)


_LIDAR_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<u4"), ("ring", "<u2")])
_PIXEL = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
_DATATYPES = {"<u2": 4, "<u4": 6, "<f4": 7}


def _point_cloud(header: Message, points: NDArray[Any]) -> Message:
    """Of a structured array (rows, columns)."""
    rows, columns = points.shape
    size = points.dtype.itemsize
    fields = [
        _message("sensor_msgs/msg/PointField", name, offset, _DATATYPES[kind.str], 1)
        for name, (kind, offset, *_) in (points.dtype.fields or {}).items()
    ]
    is_dense = bool(np.isfinite(points["x"]).all())
    data = np.frombuffer(points.tobytes(), np.uint8)
    return _message(
        POINT_CLOUD, header, rows, columns, fields, False, size, size * columns, data, is_dense
    )


def _laser_scan(laser: Laser, scan: TakenScan) -> Message:
    return _message(
        LASER_SCAN,
        _header(scan.start, laser.frame_id),
        -pi / 2,
        pi / 2,
        ANGLE_INCREMENT,
        TIME_INCREMENT,
        1.0 / laser.rate,
        RANGE_MIN,
        RANGE_MAX,
        scan.ranges.astype(np.float32),
        np.empty(0, np.float32),
    )


def _message(name: str, *values: Any) -> Message:
    return STORE.types[name](*values)


def _header(seconds: float, frame_id: str) -> Message:
    sec, nanosec = divmod(stamp_ns(seconds), 1_000_000_000)
    stamp = _message("builtin_interfaces/msg/Time", sec, nanosec)
    return _message("std_msgs/msg/Header", stamp, frame_id)


def _pose(T: se3.Matrix) -> Message:
    return _message("geometry_msgs/msg/Pose", _vector("Point", T[:3, 3]), _quaternion(T))


def _vector(name: str, values: se3.Matrix) -> Message:
    # Ten digits, so that the last bits of a machine's trigonometry do not change a bag.
    return _message(f"geometry_msgs/msg/{name}", *map(float, values.round(10) + 0.0))


def _quaternion(T: se3.Matrix) -> Message:
    return _vector("Quaternion", se3.to_quaternion(T))
