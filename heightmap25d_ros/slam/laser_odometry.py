# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The odometry of wheels, corrected by what level lasers see: correlative scan matching.

A level laser tells of the motion in its plane, and walls at its height stand still. Of all poses
around the one that the wheels tell, the one is taken at which the returns of a scan lie nearest to
those of the last metres (Olson, "Real-time correlative scan matching", 2009). Nothing has to be
found or associated before, so odometry may be wrong by whole steps: wheels that spin, encoders
that do not tell forwards from backwards, stamps that are not those of the scans. Along a corridor,
where all poses are as good, the wheels decide.

As soon as a laser has seen the ground it is none of these any more, and nothing is corrected.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.kernels import inlined_kernel, kernel
from heightmap25d_ros.mapping.ground_evidence import see_ground
from heightmap25d_ros.mapping.sensor_model import Beams

_POINTS = 360  # of a scan that are matched at most
_LEAST_POINTS = 20
_RADIAN = 0.5  # [m] of distance that a radian of turning counts as
_LEAST_MOTION = 0.03  # [m] between two scans that are matched
_KEPT_MOTION = 0.1  # [m] between two that others are matched with
_MOST_TILT = 0.035  # [rad] of a robot whose lasers look along the floor
_LEAST_GAP, _GAP = 0.2, 0.1  # [m], and of the range, between two returns of one surface
_CELL = 0.05  # [m]
_BLUR = 0.06  # [m] standard deviation about a return
_HALF = 30.0  # [m] half the side of the square around the robot that is remembered
_MARGIN = 12.0  # [m] that the robot may go from its middle
_LEVELS = np.array([
    # half the side [m], its step [m], half the turn [rad], its step [rad]
    (0.3, 0.1, 0.3, 0.03),
    (0.08, 0.04, 0.03, 0.01),
    (0.02, 0.01, 0.01, 0.0025),
])  # fmt: skip
_SHIFT, _OF_MOTION = 0.02, 0.1  # [m] deviation of the odometry, and what each metre adds
_TURN, _OF_TURN = 0.01, 0.1  # [rad] the same of its yaw
_UNEXPECTED = 0.02  # share of the returns that speak against a deviation of the odometry


class _Scan(NamedTuple):
    """Places (N, 2) [m, odom] that were seen, and the distance [m] travelled by then."""

    seen: Array
    distance: float


class LaserOdometry:
    """Odometry by wheels and level lasers.

    Parameters
    ----------
    memory : float [m]
        Distance back along the drive that scans are matched with.

    Attributes
    ----------
    T_odom_wheels : (4, 4) float64
        Where the frame of the wheels' odometry is in that of this one.
    is_level : bool
        Whether no laser has seen the ground so far.
    """

    def __init__(self, memory: float) -> None:
        self.T_odom_wheels = np.eye(4)
        self._memory = memory
        self.is_level = True
        self._matched: se3.Matrix = np.eye(4)  # T_wheels_base of the last scan that was matched
        self._kept: se3.Matrix = np.eye(4)  # T_odom_base of the newest one of these:
        self._scans: deque[_Scan] = deque()
        self._distance = 0.0
        cells = round(2.0 * _HALF / _CELL)
        self._near = np.zeros((cells, cells), np.float32)
        self._corner = np.zeros(2)

    def correct(self, beams: Beams, T_wheels_base: se3.Matrix) -> Beams:
        """Take in a scan, of which the robot was at a pose (4, 4) at its end by its wheels.

        Returns
        -------
        Beams
            The same in the frame of this odometry.
        """
        self.is_level = self.is_level and not see_ground(beams)
        if self.is_level and T_wheels_base[2, 2] > np.cos(_MOST_TILT):
            self._take(beams.ends[beams.is_hit & ~beams.is_lone], T_wheels_base)
        is_same = np.array_equal(self.T_odom_wheels, np.eye(4))
        return beams if is_same else beams.moved(self.T_odom_wheels)

    def _take(self, returns: Array, T_wheels_base: se3.Matrix) -> None:
        """Take in returns (N, 3) [m] in the frame of the wheels' odometry."""
        seen = _surfaces(returns[:, :2], T_wheels_base[:2, 3])
        if len(seen) < _LEAST_POINTS:
            return
        seen = np.column_stack([seen, np.zeros(len(seen))])
        if self._scans:
            shift, turn = _motion(self._matched, T_wheels_base)
            if _weighed(shift, turn) < _LEAST_MOTION:
                return
            self._match(seen, T_wheels_base, shift, turn)
        self._matched = T_wheels_base
        self._keep(se3.transform_points(self.T_odom_wheels, seen)[:, :2], T_wheels_base)

    def _match(self, seen: Array, T_wheels_base: se3.Matrix, shift: float, turn: float) -> None:
        """Correct a pose (4, 4) after the wheels have told so much of a motion [m], [rad]."""
        T_odom_base = self.T_odom_wheels @ T_wheels_base
        position = T_odom_base[:2, 3]
        some = se3.transform_points(self.T_odom_wheels, seen[:: 1 + len(seen) // _POINTS])[:, :2]
        precision = np.array([_SHIFT + _OF_MOTION * shift, _TURN + _OF_TURN * turn]) ** -2
        found = np.zeros(3)
        _search(self._near, position - self._corner, some - position, precision, found)
        x, y, yaw = found
        shifted = se3.correction_about(T_odom_base, (x, y, 0.0), yaw)
        self.T_odom_wheels = shifted @ self.T_odom_wheels

    def _keep(self, seen: Array, T_wheels_base: se3.Matrix) -> None:
        """Remember places (N, 2) [m, odom] that were seen, if the robot has moved on."""
        T_odom_base = self.T_odom_wheels @ T_wheels_base
        if self._scans:
            moved = _weighed(*_motion(self._kept, T_odom_base))
            if moved < _KEPT_MOTION:
                return
            self._distance += moved
        self._kept = T_odom_base
        self._scans.append(_Scan(seen, self._distance))
        middle = T_odom_base[:2, 3]
        away = np.abs(middle - self._corner - _HALF).max()
        oldest = self._scans[0].distance
        is_old = self._distance - oldest > 2.0 * self._memory
        if len(self._scans) == 1 or away > _MARGIN or is_old:
            self._recentre(middle)
        else:
            _add(self._near, seen - self._corner)

    def _recentre(self, middle: Array) -> None:
        """Remember the square around a place (2,), and the last metres only."""
        while self._scans[0].distance < self._distance - self._memory:
            self._scans.popleft()
        self._corner = middle - _HALF
        self._near[:] = 0.0
        for scan in self._scans:
            _add(self._near, scan.seen - self._corner)

    def mend(self, T_odom_wheels: se3.Matrix) -> None:
        """The wheels' odometry has jumped: its frame is at another pose (4, 4) from now on."""
        self._matched = se3.inverse(T_odom_wheels) @ self.T_odom_wheels @ self._matched
        self.T_odom_wheels = T_odom_wheels


def _weighed(shift: float, turn: float) -> float:
    """A motion [m], [rad] as one distance [m]."""
    return shift + _RADIAN * turn


def _surfaces(returns: Array, middle: Array) -> Array:
    """Places (M, 2) [m], a cell apart, on the surfaces that beams (N, 2) [m] met in their order.

    Two neighbours are on one surface if they are not far apart for their range. Single returns of a
    wall that beams graze would draw the next scan to where the robot saw the same ones.
    """
    along = np.diff(returns, axis=0)
    gap = np.hypot(*along.T)
    longest = np.maximum(_LEAST_GAP, _GAP * np.hypot(*(returns[:-1] - middle).T))
    counts = np.where(gap <= longest, 1 + (gap / _CELL).astype(np.int64), 0)
    of = np.repeat(np.arange(len(gap)), counts)
    number = np.arange(len(of)) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.asarray(returns[of] + (number / counts[of])[:, None] * along[of])


def _motion(before: se3.Matrix, after: se3.Matrix) -> tuple[float, float]:
    """How far [m] and by how much [rad] a pose (4, 4) moved in the plane."""
    moved = se3.inverse(before) @ after
    return float(np.hypot(moved[0, 3], moved[1, 3])), abs(se3.yaw(moved))


@kernel
def _add(near, seen):
    """Add places (N, 2) [m, from the corner] to a square of how near such places are."""
    half = int(3.0 * _BLUR / _CELL)
    for i in range(len(seen)):
        u, v = seen[i, 0] / _CELL - 0.5, seen[i, 1] / _CELL - 0.5
        ix, iy = int(np.round(u)), int(np.round(v))
        if half <= ix < near.shape[1] - half and half <= iy < near.shape[0] - half:
            for row in range(iy - half, iy + half + 1):
                for column in range(ix - half, ix + half + 1):
                    away = _CELL * _CELL * ((row - v) ** 2 + (column - u) ** 2)
                    value = np.exp(-0.5 * away / (_BLUR * _BLUR))
                    near[row, column] = max(near[row, column], value)


@kernel
def _search(near, position, seen, precision, found):
    """Fill in the shift [m] and the yaw [rad] (3,) at which returns (N, 2) are the nearest.

    They are seen from a position (2,) from the corner; precision of its shift and yaw.
    """
    for level in range(len(_LEVELS)):
        half, step, half_turn, turn_step = _LEVELS[level]
        count, turns = round(half / step), round(half_turn / turn_step)
        begin = found.copy()
        best = -np.inf
        for k in range(-turns, turns + 1):
            yaw = begin[2] + k * turn_step
            cos, sin = np.cos(yaw), np.sin(yaw)
            for j in range(-count, count + 1):
                y = begin[1] + j * step
                for i in range(-count, count + 1):
                    x = begin[0] + i * step
                    off = (x * x + y * y) * precision[0] + yaw * yaw * precision[1]
                    score = _nearness(near, position[0] + x, position[1] + y, cos, sin, seen)
                    score -= _UNEXPECTED * np.log1p(off)
                    if score > best:
                        best = score
                        found[0], found[1], found[2] = x, y, yaw


@inlined_kernel
def _nearness(near, x, y, cos, sin, seen):
    """Mean over places of how near others are, between the middles of four cells."""
    total = 0.0
    for i in range(len(seen)):
        u = (x + cos * seen[i, 0] - sin * seen[i, 1]) / _CELL - 0.5
        v = (y + sin * seen[i, 0] + cos * seen[i, 1]) / _CELL - 0.5
        if 0.0 <= u < near.shape[1] - 1.0 and 0.0 <= v < near.shape[0] - 1.0:
            ix, iy = int(u), int(v)
            right, above = u - ix, v - iy
            lower = (1.0 - right) * near[iy, ix] + right * near[iy, ix + 1]
            upper = (1.0 - right) * near[iy + 1, ix] + right * near[iy + 1, ix + 1]
            total += (1.0 - above) * lower + above * upper
    return total / len(seen)
