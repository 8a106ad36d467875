# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The returns of the last moment, and when they are used: by distance, not by time.

A robot that stands sees the same again and again, with the same errors of the map: that is no news.
Where it stopped with a pose that contradicts the map, it goes on looking.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import ScanFilterParams

_SECONDS = 0.12
_STANDING_UPDATES = 3  # for a robot which stands, that do not contradict the map
_STANDING_NS = 100_000_000  # from one of them to the next


class ScanWindow:
    """Returns in odom.

    Parameters
    ----------
    params : ScanFilterParams
    """

    def __init__(self, params: ScanFilterParams) -> None:
        self.params = params
        self._scans: deque[tuple[int, Array]] = deque()
        self._used_distance = -np.inf
        self._used_ns = 0
        self._confirmed = 0  # updates since the robot moved that the map did not contradict

    def clear(self) -> None:
        """What was seen does not go with what will be seen."""
        self._scans.clear()

    def add(self, beams: Beams, stamp_ns: int) -> None:
        """Take a scan's returns in; older ones go."""
        self._scans.append((stamp_ns, beams.ends[beams.is_hit & ~beams.is_lone]))
        while self._scans[0][0] < stamp_ns - _SECONDS * 1e9:
            self._scans.popleft()

    def is_due(self, distance: float, stamp_ns: int) -> bool:
        """Whether an update is due at a distance [m] that the robot has come to."""
        if distance - self._used_distance >= self.params.interval:
            self._confirmed = 0
            return True
        return self._confirmed < _STANDING_UPDATES and stamp_ns - self._used_ns >= _STANDING_NS

    def confirm(self) -> None:
        """The returns that were taken last did not contradict the map."""
        self._confirmed += 1

    def take(self, distance: float, stamp_ns: int) -> Array:
        """(N, 3) float64 [m, odom]: the returns, of ``max_returns`` at most; they are used now."""
        self._used_distance, self._used_ns = distance, stamp_ns
        returns = np.concatenate([ends for _, ends in self._scans])
        self._scans.clear()
        return np.ascontiguousarray(returns[:: 1 + len(returns) // self.params.max_returns])
