# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The messages that come many times a second, from their serialized bytes (CDR).

Only what is used is made into objects, by duck type those of rclpy and rosbags, which make thirty
of an odometry, with its covariances, and eight of each transform of a robot's arm.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io._topics import LASER_SCAN, ODOMETRY, TF_MESSAGE
from heightmap25d_ros.io.decode import LONGEST_FRAME

_STAMP, _LENGTH, _POSE = struct.Struct("<iI"), struct.Struct("<I"), struct.Struct("<7d")
_COVARIANCE, _TWIST = struct.Struct("<36d"), struct.Struct("<6d")
_SCAN = struct.Struct("<7f")
_LITTLE_ENDIAN = b"\0\1"
_BEGIN = 4  # bytes of the header that says how numbers are stored
_LONGEST = 8 * LONGEST_FRAME  # bytes of a name that are looked at


class StampedTransform(NamedTuple):
    """A transform in the bytes of a message, by duck type a geometry_msgs/TransformStamped.

    It holds none of the other bytes, which may be many.

    Attributes
    ----------
    parent, child_frame_id : str
    stamp, pose : bytes
        Seconds and nanoseconds; position and quaternion.
    """

    parent: str
    child_frame_id: str
    stamp: bytes
    pose: bytes

    @property
    def header(self) -> SimpleNamespace:
        """As a std_msgs/Header."""
        return _header(self.parent, self.stamp, 0)

    @property
    def transform(self) -> SimpleNamespace:
        """As a geometry_msgs/Transform."""
        translation, rotation = _pose(self.pose, 0)
        return SimpleNamespace(translation=translation, rotation=rotation)


def tf_message(data: bytes) -> SimpleNamespace:
    """A tf2_msgs/TFMessage, by duck type, from its serialized bytes.

    Raises
    ------
    InputError
        If the bytes are not those of such a message, or are stored in another way than a machine
        with the least significant byte first does.
    """
    _require_order(data, "transforms")
    transforms = []
    try:
        (count,) = _LENGTH.unpack_from(data, _BEGIN)
        at = _BEGIN + 4
        for _ in range(count):
            stamp = data[at : at + _STAMP.size]
            parent, at = _text(data, at + _STAMP.size)
            child, at = _text(data, _aligned(at, 4))
            at = _aligned(at, 8)
            pose = data[at : at + _POSE.size]
            at += _POSE.size
            if at > len(data):
                raise InputError("transforms: end too early")
            transforms.append(StampedTransform(parent, child, stamp, pose))
    except struct.error:
        raise InputError("transforms: end too early") from None
    return SimpleNamespace(transforms=transforms)


def laser_scan(data: bytes) -> SimpleNamespace:
    """A sensor_msgs/LaserScan without its intensities; errors as of `tf_message`."""
    _require_order(data, "ranges")
    try:
        frame_id, at = _text(data, _BEGIN + _STAMP.size)
        at = _aligned(at, 4)
        first, last, increment, time_increment, _, range_min, range_max = _SCAN.unpack_from(
            data, at
        )
        at += _SCAN.size
        (count,) = _LENGTH.unpack_from(data, at)
        ranges = np.frombuffer(data, "<f4", count, at + 4) if count else np.empty(0)
        _LENGTH.unpack_from(data, at + 4 + 4 * count)  # of the intensities
    except (struct.error, ValueError):
        raise InputError("ranges: end too early") from None
    return SimpleNamespace(
        header=_header(frame_id, data, _BEGIN),
        angle_min=first,
        angle_max=last,
        angle_increment=increment,
        time_increment=time_increment,
        range_min=range_min,
        range_max=range_max,
        ranges=ranges.astype(np.float32),  # of its own: kernels tell what is read-only
    )


def odometry(data: bytes) -> SimpleNamespace:
    """The pose of a nav_msgs/Odometry, without covariance and twist; errors as of `tf_message`."""
    _require_order(data, "pose")
    try:
        frame_id, at = _text(data, _BEGIN + _STAMP.size)
        child_frame_id, at = _text(data, _aligned(at, 4))
        at = _aligned(at, 8)
        position, orientation = _pose(data, at)
        if at + _POSE.size + 2 * _COVARIANCE.size + _TWIST.size > len(data):
            raise InputError("pose: ends too early")
        header = _header(frame_id, data, _BEGIN)
    except struct.error:
        raise InputError("pose: ends too early") from None
    pose = SimpleNamespace(pose=SimpleNamespace(position=position, orientation=orientation))
    return SimpleNamespace(header=header, child_frame_id=child_frame_id, pose=pose)


READERS: dict[str, Callable[[bytes], Any]] = {
    LASER_SCAN: laser_scan,
    ODOMETRY: odometry,
    TF_MESSAGE: tf_message,
}
"""Of the types whose messages are read from their bytes."""


def _require_order(data: bytes, field: str) -> None:
    if data[:2] != _LITTLE_ENDIAN:
        raise InputError(f"{field}: not stored with the least significant byte first")


def _aligned(at: int, size: int) -> int:
    """The next place of a number of so many bytes."""
    return _BEGIN - (_BEGIN - at) // size * size


def _header(frame_id: str, data: bytes, at: int) -> SimpleNamespace:
    """As a std_msgs/Header."""
    seconds, nanoseconds = _STAMP.unpack_from(data, at)
    return SimpleNamespace(
        frame_id=frame_id, stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds)
    )


def _pose(data: bytes, at: int) -> tuple[SimpleNamespace, SimpleNamespace]:
    """Position and quaternion."""
    x, y, z, qx, qy, qz, qw = _POSE.unpack_from(data, at)
    return SimpleNamespace(x=x, y=y, z=z), SimpleNamespace(x=qx, y=qy, z=qz, w=qw)


def _text(data: bytes, at: int) -> tuple[str, int]:
    """A string, of a longer one than any name the beginning, and where it ends."""
    (length,) = _LENGTH.unpack_from(data, at)
    end = at + 4 + length
    return data[at + 4 : min(end - 1, at + _LONGEST)].decode("utf-8", "replace"), end
