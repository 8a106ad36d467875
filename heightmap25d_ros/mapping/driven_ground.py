# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a laser sees the ground where the robot then drives: pitch and roll of its mount.

Under the robot the ground is the plane of base_link. What a laser has returned from there before
is above that plane, or below it, where the laser is mounted otherwise than assumed: at a horizontal
distance d in the direction a from the laser by

    e = d (roll sin a - pitch cos a)

for small angles about the axes of base_link by which the assumed mount is too large. A laser that
looks ahead tells of its pitch, and of its roll where the robot turns to what it saw at its side. A
level one tells of them where a ramp or rough ground comes into its plane. What was seen long before
the robot came there does not count, since its odometry has drifted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.mapping.scan_points import count_of_points, scan_points

_SPACING = 0.25  # [m] of travel between two places at which the ground is compared
_KEPT = 50_000  # returns: those of 14 m of travel, since level lasers look far
_DETOUR, _TURN = 1.5, 1.0  # of the distance, and [m]: longer ways there have drifted
_NEAREST = 0.8  # [m] from the laser: nearer ones may be of the robot
_LENGTH, _WIDTH, _HEIGHT = 0.3, 0.25, 1.0  # [m] from base_link: under the robot, whatever robot
_FEW = 2  # returns of a scan that count; a single one may be of anything
_SCANS = 200  # whose returns are compared at a place
_PLACES = 200  # that are remembered
_ENOUGH = 5  # places from which on angles are estimated
_STRETCHES = 5  # of a drive, each of which is left out once
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
        self._corner: NDArray[np.float64] | None = None  # [m], odom: of the places
        # Of the points, small enough to be looked through at each place.
        self._places = np.full((_KEPT, 2), np.nan, np.float32)
        self._points, self._levers = np.empty((2, _KEPT, 3))
        self._scan_of = np.empty(_KEPT, np.int64)
        self._seen_at = np.zeros(_KEPT)  # [m] that the robot had travelled
        self._compared: deque[NDArray[np.float64]] = deque(maxlen=_PLACES)

    def restart(self) -> None:
        """The poses of before are not connected with those that come; what was found stays."""
        self._places.fill(np.nan)
        self._corner = None

    def observe(
        self,
        scan: Scan,
        T_odom_base: se3.Matrix,
        T_base_sensor: se3.Matrix,
        travelled: float,
        step: int,
    ) -> None:
        """Take in a scan, at a place that the robot has reached.

        Parameters
        ----------
        scan : Scan
        T_odom_base, T_base_sensor : (N, 4, 4) or (1, 4, 4) float64
            At each beam's own time, or once for all beams.
        travelled : float [m]
            Since the scan before.
        step : int
            Every so many-th beam is looked at.
        """
        if self._corner is None:
            self._corner = T_odom_base[0, :2, 3].copy()
        self._travelled += travelled
        if self._travelled >= self._compared_at:
            self._compared_at = self._travelled + _SPACING
            self._compare(T_odom_base[0])
        count = min(count_of_points(scan, step), _KEPT)
        if self._next + count > _KEPT:
            self._places[self._next :] = np.nan
            self._next = 0
        kept = slice(self._next, self._next + count)
        self._next += count
        self._scans += 1
        points = self._points[kept]
        scan_points(scan, T_odom_base, T_base_sensor, step, points, self._levers[kept])
        self._scan_of[kept], self._seen_at[kept] = self._scans, self._travelled
        np.subtract(points[:, :2], self._corner, out=self._places[kept], casting="same_kind")

    def _compare(self, T_odom_base: se3.Matrix) -> None:
        """The mean direction, and height over distance, of each scan's returns from here."""
        found = _compared(
            self._places, self._corner, self._points, self._levers, self._scan_of,
            self._travelled - self._seen_at, T_odom_base,
        )  # fmt: skip
        if len(found):
            self._compared.append(found)

    def tilt(self) -> Tilt | None:
        """What is known of roll and pitch; None as long as too few places were compared.

        Places beside each other err alike: a robot that turns at the foot of a ramp has all that
        tells of the roll from there. The deviations are therefore also those of the jackknife over
        stretches of the drive: what only one of them tells is not known.
        """
        if len(self._compared) < _ENOUGH:
            return None
        places = list(self._compared)
        angles, deviations = _tilt_of(places)
        bounds = np.linspace(0, len(places), _STRETCHES + 1).astype(int).tolist()
        without = [_tilt_of(places[:a] + places[b:])[0] for a, b in pairwise(bounds)]
        spread = np.sqrt((_STRETCHES - 1) * np.var(without, axis=0))
        return Tilt(*angles.tolist(), *np.maximum(deviations, spread).tolist())


def _tilt_of(places: Sequence[NDArray[np.float64]]) -> tuple[NDArray[np.float64], ...]:
    """Roll and pitch (2,), and their deviations if places erred by themselves [rad].

    Robust least squares, in which each place counts for as much.
    """
    rows = np.concatenate(places)
    share = np.repeat([1.0 / len(place) for place in places], [len(place) for place in places])
    terms, directions = rows[:, :2], rows[:, 2]
    weight, angles = share, np.zeros(2)
    for _ in range(_ROUNDS):
        normal = (terms * weight[:, None]).T @ terms + 1e-6 * np.eye(2)
        angles = np.linalg.solve(normal, (terms * weight[:, None]).T @ directions)
        off = np.abs(directions - terms @ angles)
        weight = share / np.maximum(off / _NOISE, 1.0)
    noise = max(float(np.median(off)) * 1.5, _NOISE)
    return angles, noise * np.sqrt(np.diag(np.linalg.inv(normal)))


@kernel
def _compared(places, corner, points, levers, scan_of, way_since, T_base):
    """(K, 3): sine and minus cosine of the direction, height over distance; a row for a scan."""
    found = np.empty((_SCANS + 1, 3))
    rows, count, scan, reach = 0, 0, -1, np.float32(_LENGTH + _WIDTH)
    middle_x, middle_y = np.float32(T_base[0, 3] - corner[0]), np.float32(T_base[1, 3] - corner[1])
    for i in range(len(places)):
        is_near = abs(places[i, 0] - middle_x) < reach and abs(places[i, 1] - middle_y) < reach
        if not is_near:
            continue
        x, y, z = (
            points[i, 0] - T_base[0, 3],
            points[i, 1] - T_base[1, 3],
            points[i, 2] - T_base[2, 3],
        )
        distance = np.hypot(levers[i, 0], levers[i, 1])
        ahead = x * T_base[0, 0] + y * T_base[1, 0] + z * T_base[2, 0]
        left = x * T_base[0, 1] + y * T_base[1, 1] + z * T_base[2, 1]
        above = x * T_base[0, 2] + y * T_base[1, 2] + z * T_base[2, 2]
        is_under = abs(ahead) < _LENGTH and abs(left) < _WIDTH and abs(above) < _HEIGHT
        is_fresh = way_since[i] < _DETOUR * distance + _TURN
        if not (is_under and is_fresh) or distance < _NEAREST:
            continue
        if scan_of[i] != scan:
            rows = min(rows + (count >= _FEW), _SCANS)
            scan, count = scan_of[i], 0
            found[rows] = 0.0
        count += 1
        found[rows, 0] += (levers[i, 1] / distance - found[rows, 0]) / count
        found[rows, 1] += (-levers[i, 0] / distance - found[rows, 1]) / count
        found[rows, 2] += (above / distance - found[rows, 2]) / count
    rows = min(rows + (count >= _FEW), _SCANS)
    return found[:rows].copy()
