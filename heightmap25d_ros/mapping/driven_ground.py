# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a laser sees the ground where the robot then drives: pitch and roll of its mount.

Under the robot the ground is the plane of base_link. What a laser has returned from there before
is above that plane, or below it, where the laser is mounted otherwise than assumed: at a horizontal
distance d in the direction a from the laser by

    e = d (roll sin a - pitch cos a)

for small angles about the axes of base_link by which the assumed mount is too large. A laser that
looks ahead tells of its pitch, and of its roll where the robot turns to what it saw at its side. A
level one tells of them where a ramp or rough ground comes into its plane.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3

_SPACING = 0.25  # [m] of travel between two places at which the ground is compared
_KEPT = 50_000  # returns: those of 14 m of travel, since level lasers look far
_NEAREST = 0.8  # [m] from the laser: nearer ones may be of the robot
_LENGTH, _WIDTH = 0.3, 0.25  # [m] from base_link: under the robot, whatever robot
_UNDER = np.array([_LENGTH, _WIDTH, 1.0])
_FEW = 2  # returns of a scan that count; a single one may be of anything
_PLACES = 200  # that are remembered
_ENOUGH = 5  # places from which on angles are estimated
_NOISE = np.radians(0.5)  # of a direction: errors of the pose between seeing and driving
_ROUNDS = 10  # of reweighting; it converges in a few


class Tilt(NamedTuple):
    """By how much an assumed mount is too large, with standard deviations [rad]."""

    roll: float
    pitch: float
    roll_deviation: float
    pitch_deviation: float


class DrivenGround:
    """Compares the returns of one laser with the ground under the robot."""

    def __init__(self) -> None:
        self._travelled = self._compared_at = 0.0
        self._scans = self._next = 0
        # Components by rows: only the first one is looked at in all of them.
        self._seen = np.full((7, _KEPT), np.nan)  # x, y, z in odom, lever, number of the scan
        self._compared: deque[NDArray[np.float64]] = deque(maxlen=_PLACES)

    def restart(self) -> None:
        """The poses of before are not connected with those that come; what was found stays."""
        self._seen.fill(np.nan)

    def observe(
        self,
        T_odom_base: se3.Matrix,
        travelled: float,
        points: NDArray[np.float64],
        lever: NDArray[np.float64],
    ) -> None:
        """Take in a scan, at a place that the robot has reached.

        Parameters
        ----------
        T_odom_base : (4, 4) float64
        travelled : float [m]
            Since the scan before.
        points : (N, 3) float64 [m], odom
        lever : (N, 3) float64 [m], base_link
            From the laser to the points.
        """
        self._travelled += travelled
        if self._travelled >= self._compared_at:
            self._compared_at = self._travelled + _SPACING
            self._compare(T_odom_base)
        is_far = np.hypot(lever[:, 0], lever[:, 1]) > _NEAREST
        self._keep(np.hstack([points, lever])[is_far].T)

    def _keep(self, returns: NDArray[np.float64]) -> None:
        """Put returns (6, N) in place of the oldest ones."""
        count = returns.shape[1]
        if self._next + count > _KEPT:
            self._seen[:, self._next :] = np.nan
            self._next = 0
        kept = slice(self._next, self._next + count)
        self._seen[:6, kept], self._seen[6, kept] = returns, self._scans
        self._next += count
        self._scans += 1

    def _compare(self, T_odom_base: se3.Matrix) -> None:
        """The direction and the height over the distance of each scan's returns from here."""
        robot, reach = T_odom_base[:3, 3], _LENGTH + _WIDTH
        near = np.flatnonzero(np.abs(self._seen[0] - robot[0]) < reach)
        returns = self._seen[:, near]
        here = T_odom_base[:3, :3].T @ (returns[:3] - robot[:, None])
        is_under = (np.abs(here) < _UNDER[:, None]).all(axis=0)
        (_, _, above), returns = here[:, is_under], returns[:, is_under]
        found = []
        for number in np.unique(returns[6]):
            of_scan = returns[6] == number
            x, y = returns[3:5, of_scan]
            if len(x) >= _FEW:
                values = np.stack([y, -x, above[of_scan]]) / np.hypot(x, y)
                found.append(np.median(values, axis=1))
        if found:
            self._compared.append(np.array(found))

    def tilt(self) -> Tilt | None:
        """What is known of roll and pitch; None as long as too few places were compared.

        Robust least squares, in which each place counts for as much.
        """
        if len(self._compared) < _ENOUGH:
            return None
        rows = np.concatenate(self._compared)
        share = np.repeat([1.0 / len(place) for place in self._compared],
                          [len(place) for place in self._compared])  # fmt: skip
        terms, directions = rows[:, :2], rows[:, 2]
        weight, angles = share, np.zeros(2)
        for _ in range(_ROUNDS):
            normal = (terms * weight[:, None]).T @ terms + 1e-6 * np.eye(2)
            angles = np.linalg.solve(normal, (terms * weight[:, None]).T @ directions)
            off = np.abs(directions - terms @ angles)
            weight = share / np.maximum(off / _NOISE, 1.0)
        noise = max(float(np.median(off)) * 1.5, _NOISE)
        deviation = noise * np.sqrt(np.diag(np.linalg.inv(normal)))
        return Tilt(*angles.tolist(), *deviation.tolist())
