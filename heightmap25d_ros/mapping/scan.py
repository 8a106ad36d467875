# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A planar scan as arrays and numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Scan:
    """One planar scan, as sensor_msgs/LaserScan.

    Attributes
    ----------
    stamp_ns : int [ns]
        Of the first beam.
    frame_id : str
    angle_min, angle_increment : float [rad]
    time_increment : float [s]
        Between beams; negative where the laser scans against the order of the angles.
    range_min, range_max : float [m]
    ranges : (N,) float32 [m]
        A list is taken as well.

    Examples
    --------
    >>> Scan(angle_min=0.0, angle_increment=0.01, ranges=[2.0, 2.1]).ranges
    array([2. , 2.1], dtype=float32)
    """

    KIND: ClassVar[str] = "scan"

    stamp_ns: int = 0
    frame_id: str = ""
    angle_min: float
    angle_increment: float
    time_increment: float = 0.0
    range_min: float = 0.0
    range_max: float = np.inf
    ranges: NDArray[np.float32]

    def __post_init__(self) -> None:
        object.__setattr__(self, "ranges", np.ascontiguousarray(self.ranges, np.float32))
        if self.ranges.ndim != 1:
            raise ValueError(f"ranges: shape {self.ranges.shape}, not (N,)")

    def beam_stamps_ns(self) -> NDArray[np.int64]:
        """(N,) int64 [ns]: stamp of each beam; (1,) where all beams have the same one."""
        count = len(self.ranges) if self.time_increment else 1
        stamps: NDArray[np.int64] = self.stamp_ns + _offsets_ns(count, self.time_increment)
        return stamps


@lru_cache(maxsize=16)
def _offsets_ns(count: int, time_increment: float) -> NDArray[np.int64]:
    """(N,) int64 [ns]: of beams after the first one; a laser's are the same in all scans."""
    offsets: NDArray[np.int64] = np.rint(np.arange(count) * (time_increment * 1e9)).astype(np.int64)
    return offsets
