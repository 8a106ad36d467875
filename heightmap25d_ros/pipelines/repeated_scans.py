# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans that a stuck driver sends again and again, with new stamps, while the robot drives on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.kernels import kernel

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
        new, finite = difference(before.ranges, ranges)
        if new:
            different = before.different + 1 if new > _DIFFERENT * finite else 0
            self._newest[topic] = _Newest(ranges, T_odom_base, different)
            return False
        has_moved = np.abs(T_odom_base - before.T_odom_base).max() > _MOVED
        return bool(before.different >= _NOISY and has_moved and finite)


def difference(before: NDArray[np.float32], after: NDArray[np.float32]) -> tuple[int, int]:
    """How many values of an array differ from those of one before, and how many are finite.

    NaN is the same as NaN; arrays of other shapes differ in all.
    """
    if before.shape != after.shape:
        return after.size, int(np.isfinite(after).sum())
    found: tuple[int, int] = _difference(before.reshape(-1), after.reshape(-1))
    return found


@kernel
def _difference(before: NDArray[np.float32], after: NDArray[np.float32]) -> tuple[int, int]:
    different = finite = 0
    for i in range(len(after)):
        is_same = before[i] == after[i] or (np.isnan(before[i]) and np.isnan(after[i]))
        different += not is_same
        finite += np.isfinite(after[i])
    return different, finite
