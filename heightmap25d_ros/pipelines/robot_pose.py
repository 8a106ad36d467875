# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robot's poses, from messages of several types or from transforms."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from heightmap25d_ros.io import decode
from heightmap25d_ros.io.decode import Odometry
from heightmap25d_ros.params.sections import IntakeParams
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.transform_buffer import JUMP_BACK_NS, Missing, TransformBuffer

_MOST_WAITING = 100
"""Stamps of one transform that wait for another one of the chain."""


def robot_pose(message: Any, base_frame: str, dropped: Drops) -> Odometry | None:
    """The pose in a message; None, and counted, where it is malformed.

    Parameters
    ----------
    message : nav_msgs/Odometry, PoseStamped, PoseWithCovarianceStamped, or an `Odometry`
        By duck type. A pose is taken for that of the base, as odometry that names no child frame
        is, with a notice.
    base_frame : str
    dropped : Drops
    """
    if isinstance(message, Odometry):
        return message
    if getattr(message, "child_frame_id", base_frame) == "":
        dropped.notice(f"child_frame_id of the odometry is empty: taken for {base_frame!r}")
    return dropped.decoded("odometry", lambda m: decode.odometry(m, base_frame), message)


class TransformPoses:
    """Poses of the base in the odometry's frame from /tf and /tf_static, as odometry.

    A pose comes for each new transform on the way from ``odom_frame`` to ``base_frame``, once the
    others are known at its stamp.

    Parameters
    ----------
    params : IntakeParams
    dropped : Drops, optional
    """

    def __init__(self, params: IntakeParams, dropped: Drops | None = None) -> None:
        self._frames = params.odom_frame, params.base_frame
        self._buffer = TransformBuffer(max_gap=params.odom_gap, dropped=dropped)
        self._buffer.chain(*self._frames)  # asks for them
        self._waiting: deque[int] = deque(maxlen=_MOST_WAITING)

    def take(self, message: Any, *, is_static: bool) -> list[Odometry]:
        """Take a tf2_msgs/TFMessage; the poses that it completes, in order of time."""
        transforms = self._buffer.take(message, is_static=is_static)
        chain = self._buffer.chain(*self._frames)
        stamps = {t.stamp_ns for t in transforms if t.child in chain and not is_static}
        if stamps and self._waiting and min(stamps) < max(self._waiting) - JUMP_BACK_NS:
            self._waiting.clear()  # time started over
        self._waiting.extend(sorted(stamps - set(self._waiting)))
        return self._completed()

    def _completed(self) -> list[Odometry]:
        poses, waiting = [], []
        odom_frame, base_frame = self._frames
        for stamp in sorted(self._waiting):
            T = self._buffer.lookup(odom_frame, base_frame, np.array([stamp]))
            if not isinstance(T, Missing):
                poses.append(
                    Odometry(stamp_ns=stamp, frame_id=odom_frame, child_frame_id=base_frame, T=T[0])
                )
            elif T in (Missing.NOT_YET, Missing.UNCONNECTED):
                waiting.append(stamp)
        self._waiting = deque(waiting, maxlen=_MOST_WAITING)
        return poses
