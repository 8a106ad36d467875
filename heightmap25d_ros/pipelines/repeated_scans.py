# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans that a stuck driver sends again and again, with new stamps, while the robot drives on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3

_NOISY = 20  # scans in a row that differ from the one before: of a laser with noise
_DIFFERENT = 0.5  # share of the ranges that differ in them
_MOVED = 0.02  # [m, rad] after which no laser with noise measures the same


@dataclass(slots=True)
class _Newest:
    """The newest ranges of a laser, where they came first, and how many before were all new."""

    ranges: NDArray[np.float32]
    T_odom_base: se3.Matrix
    different: int = 0


class RepeatedScans:
    """Tells which scans are repeated.

    Only of a laser whose scans have differed all along: without noise, as in some simulators, all
    places on flat ground look the same.
    """

    def __init__(self) -> None:
        self._newest: dict[str, _Newest] = {}

    def is_repeated(self, topic: str, ranges: NDArray[np.float32], T_odom_base: se3.Matrix) -> bool:
        """Whether ranges (N,) are those of before, and the robot, now at a pose, has left there."""
        before = self._newest.get(topic)
        if before is None or len(before.ranges) != len(ranges):
            self._newest[topic] = _Newest(ranges, T_odom_base)
            return False
        is_same = (before.ranges == ranges) | (np.isnan(before.ranges) & np.isnan(ranges))
        if not is_same.all():
            is_new = np.count_nonzero(~is_same) > _DIFFERENT * np.count_nonzero(np.isfinite(ranges))
            different = before.different + 1 if is_new else 0
            self._newest[topic] = _Newest(ranges, T_odom_base, different)
            return False
        has_moved = np.abs(T_odom_base - before.T_odom_base).max() > _MOVED
        return bool(before.different >= _NOISY and has_moved and np.isfinite(ranges).any())
