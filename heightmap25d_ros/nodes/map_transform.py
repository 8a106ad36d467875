# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The transforms that the mapping node publishes.

`MapTransform` is map -> odom, for as long as nobody else publishes it. `AnchorTransform` is the
frame near a map that is far from zero.
"""

from __future__ import annotations

import time
from collections import deque
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_map import local_origin
from heightmap25d_ros.io import encode

PERIOD = 0.05
"""Between two transforms [s]."""

AHEAD_NS = 100_000_000
"""How far transforms are dated ahead [ns], so that they hold until the next one."""

SILENCE = 2.0
"""Nobody else publishes the transform when none of another publisher came for this long [s]."""

_REMEMBERED = 200  # stamps of our own transforms, which come back on /tf


class MapTransform:
    """Tells the transforms of others from our own, and makes the next one where there are none.

    REP-105 wants one publisher of map -> odom: a localization, where there is one.

    Parameters
    ----------
    map_frame : str
    """

    def __init__(self, map_frame: str) -> None:
        self._map_frame = map_frame
        self._own_stamps: deque[tuple[int, int]] = deque(maxlen=_REMEMBERED)
        self._silent_since = time.monotonic()
        self._newest_ns = -1

    def observe(self, message: Any) -> None:
        """Look at what came on /tf, in a TFMessage by duck type."""
        for transform in message.transforms:
            header = transform.header
            if header.frame_id != self._map_frame:
                continue
            if (header.stamp.sec, header.stamp.nanosec) not in self._own_stamps:
                self._silent_since = time.monotonic()

    def next(self, stamp_ns: int, odom_frame: str, T_map_odom: se3.Matrix) -> Any:
        """A TFMessage with the pose (4, 4) of odom in the map.

        None where others publish it, odometry is in the map's frame, or there is no new odometry.
        """
        is_known = odom_frame == self._map_frame or stamp_ns == self._newest_ns
        if is_known or time.monotonic() - self._silent_since < SILENCE:
            return None
        self._newest_ns = stamp_ns
        transform = TransformStamped()
        encode.fill_transform(
            transform, T_map_odom, stamp_ns + AHEAD_NS, self._map_frame, odom_frame
        )
        self._own_stamps.append((transform.header.stamp.sec, transform.header.stamp.nanosec))
        return TFMessage(transforms=[transform])


def anchor_frame(map_frame: str) -> str:
    """Name of the frame near a map that is far from zero."""
    return f"{map_frame}_anchor"


class AnchorTransform:
    """The static transform from the map to a frame near what is mapped, where zero is far away.

    Points in single precision have steps of 0.5 m at 5000 km: they are published in this frame.

    Parameters
    ----------
    map_frame : str

    Attributes
    ----------
    frame : str
        Of points: the map's own where it serves.
    origin : (3,) float64 [m], map
        Position of that frame.
    """

    def __init__(self, map_frame: str) -> None:
        self._map_frame = map_frame
        self.frame = map_frame
        self.origin = np.zeros(3)

    def update(self, anchor: tuple[float, float, float], stamp_ns: int) -> Any:
        """A TFMessage where the frame has moved for a map's anchor (x, y, z) [m]; else None."""
        origin = local_origin(anchor)
        if np.array_equal(origin, self.origin):
            return None
        self.origin = origin
        self.frame = anchor_frame(self._map_frame) if origin.any() else self._map_frame
        transform = TransformStamped()
        T_map_anchor = np.eye(4)
        T_map_anchor[:3, 3] = origin
        child = anchor_frame(self._map_frame)
        encode.fill_transform(transform, T_map_anchor, stamp_ns, self._map_frame, child)
        return TFMessage(transforms=[transform])
