# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bytes of a tf2_msgs/TFMessage, of which only what is used is made into objects.

A robot with arms sends thousands of transforms a second, few of which a node needs, and rclpy makes
eight objects of each.
"""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import NamedTuple

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io.decode import LONGEST_FRAME

_STAMP, _LENGTH, _POSE = struct.Struct("<iI"), struct.Struct("<I"), struct.Struct("<7d")
_BEGIN = 4  # bytes of the header that says how numbers are stored
_LITTLE_ENDIAN = b"\0\1"
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
        seconds, nanoseconds = _STAMP.unpack(self.stamp)
        stamp = SimpleNamespace(sec=seconds, nanosec=nanoseconds)
        return SimpleNamespace(frame_id=self.parent, stamp=stamp)

    @property
    def transform(self) -> SimpleNamespace:
        """As a geometry_msgs/Transform."""
        x, y, z, qx, qy, qz, qw = _POSE.unpack(self.pose)
        return SimpleNamespace(
            translation=SimpleNamespace(x=x, y=y, z=z),
            rotation=SimpleNamespace(x=qx, y=qy, z=qz, w=qw),
        )


def tf_message(data: bytes) -> SimpleNamespace:
    """A tf2_msgs/TFMessage, by duck type, from its serialized bytes.

    Raises
    ------
    InputError
        If the bytes are not those of such a message, or are stored in another way than a machine
        with the least significant byte first does.
    """
    if data[:2] != _LITTLE_ENDIAN:
        raise InputError("transforms: are not stored with the least significant byte first")
    transforms = []
    try:
        (count,) = _LENGTH.unpack_from(data, _BEGIN)
        at = _BEGIN + 4
        for _ in range(count):
            stamp = data[at : at + _STAMP.size]
            parent, at = _text(data, at + _STAMP.size)
            child, at = _text(data, -(-at // 4) * 4)
            at = _BEGIN + -(-(at - _BEGIN) // 8) * 8
            pose = data[at : at + _POSE.size]
            at += _POSE.size
            if at > len(data):
                raise InputError("transforms: end too early")
            transforms.append(StampedTransform(parent, child, stamp, pose))
    except struct.error:
        raise InputError("transforms: end too early") from None
    return SimpleNamespace(transforms=transforms)


def _text(data: bytes, at: int) -> tuple[str, int]:
    """A string, of a longer one than any name the beginning, and where it ends."""
    (length,) = _LENGTH.unpack_from(data, at)
    end = at + 4 + length
    return data[at + 4 : min(end - 1, at + _LONGEST)].decode("utf-8", "replace"), end
