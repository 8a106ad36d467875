# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small messages, as rosbags' or as rclpy's classes, and small bags of them."""

from __future__ import annotations

import array
import importlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
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

STORE = get_typestore(Stores.ROS2_JAZZY)
TypeOf = Callable[[str], Callable[..., Any]]


def rosbags_type(name: str) -> Callable[..., Any]:
    return STORE.types[name]


def rclpy_type(name: str) -> Callable[..., Any]:
    package, _, message = name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), message)


def header(stamp_ns: int, frame_id: str, type_of: TypeOf = rosbags_type) -> Any:
    sec, nanosec = divmod(stamp_ns, 10**9)
    stamp = type_of("builtin_interfaces/msg/Time")(sec=sec, nanosec=nanosec)
    return type_of("std_msgs/msg/Header")(stamp=stamp, frame_id=frame_id)


def laser_scan(
    stamp_ns: int,
    ranges: Iterable[float] = (1.0, 2.0, 3.0),
    frame_id: str = "laser",
    type_of: TypeOf = rosbags_type,
    **changes: float,
) -> Any:
    ranges = np.array(ranges, np.float32)
    increment = min(0.1, 6.0 / max(len(ranges), 1))  # less than a turn
    fields = {
        "angle_min": -0.5,
        "angle_max": -0.5 + increment * (len(ranges) - 1),
        "angle_increment": increment,
        "time_increment": 0.0,
        "scan_time": 0.1,
        "range_min": 0.1,
        "range_max": 30.0,
    }
    return type_of("sensor_msgs/msg/LaserScan")(
        header=header(stamp_ns, frame_id, type_of),
        ranges=ranges,
        intensities=np.zeros(0, np.float32),
        **(fields | changes),
    )


DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


def point_cloud(
    stamp_ns: int,
    records: np.ndarray,
    frame_id: str = "lidar",
    row_padding: int = 0,
    type_of: TypeOf = rosbags_type,
    **changes: Any,
) -> Any:
    """Of a structured array (N,) or (height, width); its byte order is the message's."""
    records = np.atleast_2d(records)
    height, width = records.shape
    kinds = {name: kind for name, (kind, *_) in records.dtype.fields.items()}
    fields = [
        type_of("sensor_msgs/msg/PointField")(
            name=name,
            offset=offset,
            datatype=DATATYPES[kinds[name].str[1:]],
            count=1,
        )
        for name, (_, offset, *_) in records.dtype.fields.items()
    ]
    row = records.dtype.itemsize * width
    data = np.zeros((height, row + row_padding), np.uint8)
    data[:, :row] = np.frombuffer(records.tobytes(), np.uint8).reshape(height, row)
    values = {
        "height": height,
        "width": width,
        "fields": fields,
        "is_bigendian": kinds["x"].str[0] == ">" if "x" in kinds else False,
        "point_step": records.dtype.itemsize,
        "row_step": row + row_padding,
        "data": array.array("B", data.tobytes()) if type_of is rclpy_type else data.ravel(),
        "is_dense": True,
    }
    return type_of("sensor_msgs/msg/PointCloud2")(
        header=header(stamp_ns, frame_id, type_of), **(values | changes)
    )


def odometry(
    stamp_ns: int,
    position: Iterable[float] = (0.0, 0.0, 0.0),
    quaternion: Iterable[float] = (0.0, 0.0, 0.0, 1.0),
    frame_id: str = "odom",
    child_frame_id: str = "base_link",
    type_of: TypeOf = rosbags_type,
) -> Any:
    def vector(name: str, values: Iterable[float], names: str = "xyz") -> Any:
        return type_of(f"geometry_msgs/msg/{name}")(**dict(zip(names, values, strict=True)))

    pose = type_of("geometry_msgs/msg/Pose")(
        position=vector("Point", position),
        orientation=vector("Quaternion", quaternion, "xyzw"),
    )
    twist = type_of("geometry_msgs/msg/Twist")(
        linear=vector("Vector3", (0.0, 0.0, 0.0)), angular=vector("Vector3", (0.0, 0.0, 0.0))
    )
    covariance = np.zeros(36)
    return type_of("nav_msgs/msg/Odometry")(
        header=header(stamp_ns, frame_id, type_of),
        child_frame_id=child_frame_id,
        pose=type_of("geometry_msgs/msg/PoseWithCovariance")(pose=pose, covariance=covariance),
        twist=type_of("geometry_msgs/msg/TwistWithCovariance")(twist=twist, covariance=covariance),
    )


def tf_message(
    *transforms: tuple[int, str, str, Iterable[float], Iterable[float]],
    type_of: TypeOf = rosbags_type,
) -> Any:
    """Of (stamp [ns], parent, child, position, quaternion x y z w)."""
    stamped = [
        type_of("geometry_msgs/msg/TransformStamped")(
            header=header(stamp_ns, parent, type_of),
            child_frame_id=child,
            transform=type_of("geometry_msgs/msg/Transform")(
                translation=type_of("geometry_msgs/msg/Vector3")(
                    **dict(zip("xyz", position, strict=True))
                ),
                rotation=type_of("geometry_msgs/msg/Quaternion")(
                    **dict(zip("xyzw", quaternion, strict=True))
                ),
            ),
        )
        for stamp_ns, parent, child, position, quaternion in transforms
    ]
    return type_of("tf2_msgs/msg/TFMessage")(transforms=stamped)


def qos(*, depth: int = 10, is_reliable: bool = True, is_transient_local: bool = False) -> Qos:
    never = QosTime(9223372036, 854775807)
    return Qos(
        QosHistory.KEEP_LAST,
        depth,
        QosReliability.RELIABLE if is_reliable else QosReliability.BEST_EFFORT,
        QosDurability.TRANSIENT_LOCAL if is_transient_local else QosDurability.VOLATILE,
        never,
        never,
        QosLiveliness.AUTOMATIC,
        never,
        False,
    )


def write_bag(
    path: Path,
    events: Iterable[tuple[str, int, Any]],
    *,
    storage: StoragePlugin = StoragePlugin.SQLITE3,
    compression: CompressionMode = CompressionMode.NONE,
    profiles: Mapping[str, Qos] | None = None,
    silent: Mapping[str, str] | None = None,
) -> Path:
    """Write (topic, stamp [ns], message) events; a message may be (type name, raw bytes).

    Topics without messages are given with their types.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        for topic, name in (silent or {}).items():
            writer.add_connection(topic, name, typestore=STORE)
        connections: dict[tuple[str, str], Any] = {}
        for topic, stamp_ns, message in events:
            name, raw = message if isinstance(message, tuple) else (message.__msgtype__, None)
            if (topic, name) not in connections:
                profile = (profiles or {}).get(topic)
                connections[topic, name] = writer.add_connection(
                    topic,
                    name,
                    typestore=STORE,
                    offered_qos_profiles=[profile] if profile else [],
                )
            data = STORE.serialize_cdr(message, name) if raw is None else raw
            writer.write(connections[topic, name], stamp_ns, data)
    return path
