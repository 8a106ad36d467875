# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The scripted driver of a recording: pure pursuit along a path. It knows the true pose."""

from __future__ import annotations

from math import atan2

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array

_LOOKAHEAD = 0.6
_SPACING = 0.05
_TURN_GAIN = 2.5
_STEEP_TURN = 1.0
_STOPPING = 0.4


class Driver:
    """Follows a path once; ``is_done`` is true at its end.

    Parameters
    ----------
    way : (N, 2) float64 [m], map
    speed : float [m/s]
    """

    def __init__(self, way: Array, speed: float) -> None:
        lengths = np.linalg.norm(np.diff(way, axis=0), axis=1)
        at = np.concatenate([[0.0], np.cumsum(lengths)])
        along = np.arange(0.0, at[-1] + _SPACING, _SPACING)
        self._points = np.column_stack([np.interp(along, at, way[:, axis]) for axis in (0, 1)])
        self._speed = speed
        self._nearest = 0
        self.is_done = False

    def command(self, T: se3.Matrix) -> tuple[float, float]:
        """Speed [m/s] and turn rate [rad/s] at a pose (4, 4)."""
        ahead = round(_LOOKAHEAD / _SPACING)
        window = self._points[self._nearest : self._nearest + 2 * ahead]
        self._nearest += int(np.linalg.norm(window - T[:2, 3], axis=1).argmin())
        rest = _SPACING * (len(self._points) - 1 - self._nearest)
        self.is_done = rest < _SPACING
        if self.is_done:
            return 0.0, 0.0
        target = self._points[min(self._nearest + ahead, len(self._points) - 1)]
        bearing = atan2(target[1] - T[1, 3], target[0] - T[0, 3]) - atan2(T[1, 0], T[0, 0])
        bearing = (bearing + np.pi) % (2 * np.pi) - np.pi
        speed = self._speed * max(0.0, 1.0 - abs(bearing) / _STEEP_TURN)
        speed = min(speed, 0.1 + rest / _STOPPING * 0.5)
        return speed, float(np.clip(_TURN_GAIN * bearing, -1.2, 1.2))
