# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The transform map -> odom, published for as long as nobody else publishes it."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from heightmap25d_ros import se3
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

    def observe(self, message: TFMessage) -> None:
        """Look at what came on /tf."""
        for transform in message.transforms:
            stamp = transform.header.stamp.sec, transform.header.stamp.nanosec
            if transform.header.frame_id == self._map_frame and stamp not in self._own_stamps:
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
