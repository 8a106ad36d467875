# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How returns are held against a map that is being made, by the robot that they localize.

What such a map does not know yet, also close to what it knows, does not speak against the pose. It
errs as the pose does, so that its returns tell less than those of a finished one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.landmarks import Landmarks
from heightmap25d_ros.localization.scan_update import FIT, Update, update_by_returns
from heightmap25d_ros.params.sections import ScanFilterParams

LEAST_KNOWN = 0.5
"""Share of ``min_returns`` that must be over known cells."""

_YAW = 2
_STARTS = 0.035 * np.array([side * k for k in range(1, 9) for side in (1, -1)])
"""[rad] Between two of these an update finds its way to a wall some metres away."""

_CLEAR = 0.8  # of what agreed a moment before, for which no other yaw needs to be tried
_TAIL = 4.0  # degrees of freedom of what odometry may be off, as of Student's distribution
_RETURNS_PER_INFORMATION = 2.0  # times those of a finished map


class GrowingMapUpdate:
    """Updates by returns, of which each remembers what those before were like."""

    def __init__(self) -> None:
        self._agreeing, self._residual = 0.0, 0.5 * FIT  # of what was accepted lately

    def hold(
        self,
        returns: Array,
        position: Array,
        precision: Array,
        landmarks: Landmarks,
        params: ScanFilterParams,
    ) -> Update:
        """Hold returns against the map, as `update_by_returns`.

        Where clearly fewer agree than a moment before, the likeliest of updates that begin at other
        yaws: odometry errs by more than its deviation where its stamps are not those of the scans.
        """
        share = _RETURNS_PER_INFORMATION * params.returns_per_information
        params = replace(params, returns_per_information=share)

        def likelihood(update: Update) -> float:
            error = update.error[:4]
            unexpected = np.log1p(error @ precision @ error / _TAIL)
            return float(update.agreeing / share - 0.5 * _TAIL * unexpected)

        found = update_by_returns(returns, position, precision, landmarks, params)
        for start in _STARTS:
            if self._is_clear(found, len(returns)):
                break
            error = np.zeros(6)
            error[_YAW] = start
            other = update_by_returns(returns, position, precision, landmarks, params, error)
            found = max(found, other, key=likelihood)  # the first of two equal ones
        return found

    def remember(self, found: Update, returns: int) -> None:
        """What an update that was accepted is like, of a number of returns."""
        self._agreeing += 0.5 * (found.agreeing / returns - self._agreeing)
        self._residual += 0.5 * (found.residual - self._residual)

    def _is_clear(self, found: Update, returns: int) -> bool:
        """Whether about as many returns agree, and as closely, as a moment before."""
        return (
            found.agreeing >= _CLEAR * self._agreeing * returns
            and found.residual <= self._residual / _CLEAR
        )
