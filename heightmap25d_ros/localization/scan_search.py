# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where around its pose the robot would see what it sees: correlative scan matching.

Poses in a circle are scored by the mean distance of the elevated returns from the nearest wall (as
in Olson, *Real-Time Correlative Scan Matching*, 2009). All returns count: one where the map has
nothing costs as much as one far from any wall, so that a place beyond the map fits nowhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.localization.landmarks import ELEVATED, Landmarks, sample_landmarks

_CELL = 0.0625  # [m] of the distances, and between two positions
_YAW_STEP = 0.035  # [rad] between two poses
_FAR = 0.3  # [m] from a wall, and farther
_MOST_RETURNS = 160
_LEAST_RETURNS = 40
_FITTING = 0.2  # [m] mean distance at the right place, at most
_UNIQUE = 0.7  # of the mean distance at the second best place
_APART, _APART_YAW = 0.5, 0.2  # [m], [rad] between two places


def find_place(
    returns: Array, position: Array, landmarks: Landmarks, radius: float, turn: float
) -> Array | None:
    """The only pose in a circle at which the elevated returns are near walls.

    Parameters
    ----------
    returns : (N, 3) float64 [m]
        Seen from the robot, along the axes of the map.
    position : (3,) float64 [m], map
        Of the robot, the middle of the circle.
    landmarks : Landmarks
    radius : float [m]
    turn : float [rad]
        How far the robot may be turned to either side.

    Returns
    -------
    (3,) float64 or None
        To be added to x, y [m] and yaw [rad], within a step of 0.0625 m and 0.035 rad; None if no
        place fits, or another one nearly as well.
    """
    seen = _elevated(returns + position, landmarks) - position[:2]
    if len(seen) < _LEAST_RETURNS:
        return None
    seen = seen[:: 1 + len(seen) // _MOST_RETURNS]
    reach = radius + float(np.hypot(*seen.T).max()) + _FAR
    distances = _distances(landmarks, position[:2], reach)
    yaws = _YAW_STEP * np.arange(-int(turn / _YAW_STEP), int(turn / _YAW_STEP) + 1)
    steps = np.arange(-int(radius / _CELL), int(radius / _CELL) + 1)
    scores = np.full((len(yaws), len(steps), len(steps)), np.float32(_FAR))
    _score(seen, yaws, steps, radius / _CELL, distances, scores)
    best = np.unravel_index(np.argmin(scores), scores.shape)
    near = int(_APART / _CELL)
    others = np.abs(yaws - yaws[best[0]]) < _APART_YAW
    least = scores[best]
    scores[
        np.ix_(others, *(np.abs(np.arange(len(steps)) - index) <= near for index in best[1:]))
    ] = _FAR
    if least > _FITTING or least > _UNIQUE * scores.min():
        return None
    return np.array([_CELL * steps[best[2]], _CELL * steps[best[1]], yaws[best[0]]])


def _elevated(at: Array, landmarks: Landmarks) -> Array:
    """x, y (M, 2) of the returns (N, 3) [m, map] that are of something that stands there."""
    rows, columns = np.floor((at[:, :2] - landmarks.origin) / landmarks.resolution).T[::-1]
    inside = (rows >= 0) & (rows < landmarks.lowest.shape[0])
    inside &= (columns >= 0) & (columns < landmarks.lowest.shape[1])
    lowest = np.full(len(at), -np.inf)
    lowest[inside] = landmarks.lowest[rows[inside].astype(int), columns[inside].astype(int)]
    # Where the map knows no ground, level lasers saw what it holds.
    is_elevated = (at[:, 2] > lowest + ELEVATED) | (lowest > at[:, 2] + ELEVATED)
    return np.ascontiguousarray(at[is_elevated, :2])


def _distances(landmarks: Landmarks, middle: Array, reach: float) -> NDArray[np.float32]:
    """Distance [m] from the nearest wall, at most 0.3 m, in a square of cells about a position."""
    half = int(np.ceil(reach / _CELL))
    is_free = np.ones((2 * half + 1, 2 * half + 1), bool)
    columns, rows = np.rint((landmarks.walls[:, :2] - middle) / _CELL).astype(int).T + half
    is_inside = (np.minimum(rows, columns) >= 0) & (np.maximum(rows, columns) <= 2 * half)
    is_free[rows[is_inside], columns[is_inside]] = False
    if is_free.all():
        return np.full(is_free.shape, np.float32(_FAR))
    distances = _CELL * ndimage.distance_transform_edt(is_free)
    return np.asarray(np.minimum(distances, _FAR), np.float32)


def compile_kernels() -> None:
    """Compile, or load from numba's cache."""
    returns = np.tile([1.0, 1.0, 1.0], (_LEAST_RETURNS, 1))
    find_place(returns, np.zeros(3), sample_landmarks(), radius=_CELL, turn=0.0)


@kernel
def _score(seen, yaws, steps, radius, distances, scores):
    """Mean distance [m] from walls, of returns (N, 2) [m], at each yaw and step within a radius."""
    half = distances.shape[0] // 2
    count = len(seen)
    rows, columns = np.empty(count, np.int64), np.empty(count, np.int64)
    for k in range(len(yaws)):
        cos, sin = np.cos(yaws[k]), np.sin(yaws[k])
        for i in range(count):
            x, y = seen[i]
            columns[i] = half + int(np.rint((cos * x - sin * y) / _CELL))
            rows[i] = half + int(np.rint((sin * x + cos * y) / _CELL))
        for a in range(len(steps)):
            for b in range(len(steps)):
                if np.hypot(steps[a], steps[b]) > radius:
                    continue
                total = np.float32(0.0)
                for i in range(count):
                    total += distances[rows[i] + steps[a], columns[i] + steps[b]]
                scores[k, a, b] = total / count
