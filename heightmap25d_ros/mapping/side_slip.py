# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether walls slide sideways as the robot drives: the yaw of a laser's mount.

A laser whose mount is assumed at a yaw that is too large by an angle a sees the robot drive by a to
the right of where its odometry has it go. Two scans some metres apart are aligned by their straight
pieces, without regard to the odometry: where the second one has to be moved to the left of the path
between them by s, and turned by r, over a distance L,

    a = s / L - r / 2

The second term is what an odometry that turns steadily by r would make of the path. An error of its
heading at the start of the path cannot be told from that of a mount; it is not always on one side.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.mapping.scan_points import count_of_points, scan_points

_SPAN = 2.0  # [m] of travel between two scans that are aligned
_STRAIGHT = 0.5  # share of it by which they are apart at least
_BESIDE = 3  # returns on each side of one that make a straight piece with it
_LONGEST, _BENT = 1.0, 0.04  # [m] length of such a piece, and how far it may bend
_NEAR, _FAR = 0.5, 15.0  # [m] from the laser
_ENOUGH = 25  # straight pieces that are aligned
_MOST = 120  # of a scan: more tell nothing new
_ROUNDS = 6
_REACHES = (0.5, 0.5, 0.5, 0.25)  # [m] between pieces that are aligned, by round; then the last one
_ALIKE = 0.95  # cosine of the angle between them
_NOISE = 0.02  # [m] of a piece
_DEVIATION = np.radians(0.5)  # of an angle that counts
_REMEMBERED = 40  # angles


class Slip(NamedTuple):
    """By how much the yaw of an assumed mount is too large, with standard deviation [rad].

    It is the median of so many spans of the path.
    """

    yaw: float
    deviation: float
    spans: int


class _Pieces(NamedTuple):
    """Straight pieces of a scan, and where the robot was."""

    places: NDArray[np.float64]  # (N, 2) [m]
    normals: NDArray[np.float64]  # (N, 2)
    robot: NDArray[np.float64]  # (2,) [m]


class SideSlip:
    """Aligns the scans of one laser with one another."""

    def __init__(self) -> None:
        self._travelled = 0.0
        self._before: _Pieces | None = None
        self._angles: deque[float] = deque(maxlen=_REMEMBERED)

    def restart(self) -> None:
        """The poses of before are not connected with those that come; what was found stays."""
        self._before = None

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
        self._travelled += travelled
        if self._before is not None and self._travelled < _SPAN:
            return
        self._travelled = 0.0
        points, lever = np.empty((2, count_of_points(scan, step), 3))
        scan_points(scan, T_odom_base, T_base_sensor, step, points, lever)
        distances = np.hypot(lever[:, 0], lever[:, 1])
        pieces = _Pieces(*_straight_pieces(points[:, :2], distances), T_odom_base[0, :2, 3])
        if self._before is not None and min(map(len, (pieces.places, self._before.places))):
            angle = _angle(self._before, pieces)
            if angle is not None:
                self._angles.append(angle)
        self._before = pieces

    def slip(self) -> Slip | None:
        """What is known of the yaw; None without any."""
        if not self._angles:
            return None
        angles = np.array(self._angles)
        yaw = float(np.median(angles))
        scatter = 1.5 * float(np.median(np.abs(angles - yaw)))
        deviation = 1.25 * max(scatter, _DEVIATION) / np.sqrt(len(angles))
        return Slip(yaw, float(deviation), len(angles))


def _straight_pieces(
    points: NDArray[np.float64], distances: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middles and normals (N, 2) of neighbouring returns that lie on a line."""
    width = 2 * _BESIDE + 1
    if len(points) < width:
        return np.empty((0, 2)), np.empty((0, 2))
    windows = np.lib.stride_tricks.sliding_window_view(points, width, axis=0)  # (N, 2, width)
    along = windows[..., -1] - windows[..., 0]
    length = np.hypot(along[:, 0], along[:, 1])
    normals = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(length, 1e-9)[:, None]
    off = np.abs(np.einsum("nij,ni->nj", windows - windows[..., :1], normals)).max(axis=1)
    middle = distances[_BESIDE : len(points) - _BESIDE]
    with np.errstate(invalid="ignore"):
        is_piece = (off < _BENT) & (length < _LONGEST) & (middle > _NEAR) & (middle < _FAR)
    chosen = np.flatnonzero(is_piece)
    chosen = chosen[:: 1 + len(chosen) // _MOST]
    return windows[chosen].mean(axis=2), normals[chosen]


def _angle(before: _Pieces, now: _Pieces) -> float | None:
    """The angle of the module's formula [rad]; None where the scans do not tell it."""
    path = now.robot - before.robot
    length = float(np.hypot(*path))
    if length < _STRAIGHT * _SPAN:
        return None
    moved = np.zeros(3)  # of the second scan: x, y [m], about the robot [rad]
    for number in range(_ROUNDS):
        reach = _REACHES[min(number, len(_REACHES) - 1)]
        cos, sin = np.cos(moved[2]), np.sin(moved[2])
        turn = np.array([[cos, -sin], [sin, cos]])
        lever = (now.places - now.robot) @ turn.T
        places = lever + now.robot + moved[:2]
        apart = ((places[:, None] - before.places) ** 2).sum(axis=2)
        nearest = apart.argmin(axis=1)
        normals = before.normals[nearest]
        alike = np.abs((now.normals @ turn.T * normals).sum(axis=1)) > _ALIKE
        is_used = alike & (apart[np.arange(len(places)), nearest] < reach**2)
        if np.count_nonzero(is_used) < _ENOUGH:
            return None
        normals, lever = normals[is_used], lever[is_used]
        off = (normals * (places[is_used] - before.places[nearest[is_used]])).sum(axis=1)
        around = normals[:, 1] * lever[:, 0] - normals[:, 0] * lever[:, 1]
        terms = np.column_stack([normals, around])
        weighted = terms / np.maximum(np.abs(off) / _NOISE, 1.0)[:, None]
        normal = weighted.T @ terms + 1e-3 * np.eye(3)
        moved = moved - np.linalg.solve(normal, weighted.T @ off)
    left = np.array([-path[1], path[0], 0.0]) / length
    deviation = _NOISE * float(np.sqrt(left @ np.linalg.inv(normal) @ left)) / length
    if deviation > _DEVIATION:
        return None
    return float(left @ moved / length - moved[2] / 2)
