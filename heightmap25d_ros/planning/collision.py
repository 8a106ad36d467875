# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Clearance of the robot from obstacles: its disc over all cells, its rectangle along a path.

`collision_free` and `closeness` are for the graph, over whole maps; `swept`, `first_overlap` and
`least_clearance` check one path. Anything in an occupied cell may be the obstacle, so that the
rectangle is held against the cells' squares, not their centres.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.terrain.ground_plane import footprint, inflate

_FREE, _TOUCHED, _SOLID = np.int8(0), 99, 100

FARTHEST = 5.0
"""Largest clearance that is measured [m]."""

_TURN_MARGIN = 0.02
"""How much larger the rectangles of a turn on the spot are at most [cells]."""

_TOUCHING = 1e-9
"""Rectangles and squares that share no more than this [cells] touch, and do not overlap."""


def swept(
    points: NDArray[np.float64], heading: NDArray[np.float64], length: float, width: float
) -> NDArray[np.float64]:
    """Rectangles that together cover a robot wherever it is on its way along a path.

    At each point it turns on the spot, by the smaller angle, from the direction of the line
    before to the point's heading, and then to the direction of the line after. Along a line one
    rectangle covers all positions; the headings of a turn are so close together that between
    them no corner leaves the rectangles, which are larger by at most `_TURN_MARGIN`.

    Parameters
    ----------
    points : (N, 2) float64 [cells]
        (y, x).
    heading : (N,) float64 [rad]
    length, width : float [cells]
        Of the robot, along the heading and across it.

    Returns
    -------
    (M, 5) float64 [cells, rad]
        y and x of the centre, heading, half length and half width; the first one is the robot at
        the first point with the first heading.
    """
    half = np.array([0.5 * length, 0.5 * width])
    reach = max(math.hypot(*half), 1.0)
    steps = np.diff(points, axis=0)
    along = np.arctan2(steps[:, 0], steps[:, 1])
    # At each point two turns, and the line to the next point.
    headings = np.stack(
        [np.append(heading[:1], along), heading, np.append(along, heading[-1:])], axis=-1
    )
    turns = np.remainder(np.diff(headings) + math.pi, 2.0 * math.pi) - math.pi
    turns = np.where(np.abs(turns) < _TOUCHING, 0.0, turns)
    counts = np.ceil(np.abs(turns) * (reach / (2.0 * _TURN_MARGIN))).astype(int)
    lines = np.arange(len(points)) < len(along)
    rows = np.column_stack([np.where(counts > 0, counts + 1, 0), lines]).ravel()
    turns, counts = (np.column_stack([part, np.zeros(len(points))]) for part in (turns, counts))
    margins = 0.5 * reach * np.abs(turns) / np.maximum(counts, 1.0)
    centers = np.repeat(points[:, None], 3, axis=1)
    centers[: len(steps), 2] += 0.5 * steps
    halves = half + margins[:, :, None]
    halves[: len(steps), 2, 0] += 0.5 * np.hypot(*steps.T)
    index = np.repeat(np.arange(3 * len(points)), rows)
    number = np.arange(len(index)) - np.repeat(np.cumsum(rows) - rows, rows)
    share = number / np.maximum(counts.ravel()[index], 1.0)
    yaw = headings.ravel()[index] + share * turns.ravel()[index]
    rectangles = np.column_stack([centers.reshape(-1, 2)[index], yaw, halves.reshape(-1, 2)[index]])
    return np.vstack([[*points[0], heading[0], *half], rectangles])


def first_overlap(solid: NDArray[np.bool_], rectangles: NDArray[np.float64]) -> int:
    """Index of the first rectangle that overlaps the square of a solid cell, or -1.

    Parameters
    ----------
    solid : (rows, columns) bool
    rectangles : (N, 5) float64 [cells, rad]
        As of `swept`.

    Examples
    --------
    >>> solid = np.array([[False, False, False, True]])
    >>> first_overlap(solid, np.array([[0.5, 1.9, 0.0, 1.0, 0.5], [0.5, 2.1, 0.0, 1.0, 0.5]]))
    1
    """
    return int(_first(solid, rectangles, True))


def first_free(solid: NDArray[np.bool_], rectangles: NDArray[np.float64]) -> int:
    """Index of the first rectangle that overlaps no solid cell's square, or -1; see above."""
    return int(_first(solid, rectangles, False))


def overlapped(solid: NDArray[np.bool_], rectangle: NDArray[np.float64]) -> NDArray[np.int64]:
    """(K, 2) int64: the solid cells whose squares a rectangle (5,) overlaps."""
    return np.asarray(_overlapped(solid, rectangle, solid.size))


@kernel
def _first(solid, rectangles, is_overlap_wanted):
    for i in range(len(rectangles)):
        if (len(_overlapped(solid, rectangles[i], 1)) > 0) == is_overlap_wanted:
            return i
    return -1


@kernel
def _overlapped(solid, rectangle, enough):
    """Separating axes: those of the grid bound the loops, and two are the rectangle's own."""
    y, x, heading, half_length, half_width = rectangle
    cosine, sine = math.cos(heading), math.sin(heading)
    reach_y = half_length * abs(sine) + half_width * abs(cosine) - _TOUCHING
    reach_x = half_length * abs(cosine) + half_width * abs(sine) - _TOUCHING
    half_square = 0.5 * (abs(cosine) + abs(sine)) - _TOUCHING
    first_x = max(math.floor(x - reach_x), 0)
    last_x = min(math.floor(x + reach_x), solid.shape[1] - 1)
    cells = np.empty((0, 2), np.int64)
    count = 0
    for iy in range(max(math.floor(y - reach_y), 0), min(math.floor(y + reach_y) + 1, len(solid))):
        for ix in range(first_x, last_x + 1):
            if not solid[iy, ix] or count == enough:
                continue
            dy, dx = iy + 0.5 - y, ix + 0.5 - x
            ahead, aside = dx * cosine + dy * sine, dy * cosine - dx * sine
            if abs(ahead) < half_length + half_square and abs(aside) < half_width + half_square:
                if count == len(cells):
                    larger = np.empty((2 * count + 1, 2), np.int64)
                    larger[:count] = cells
                    cells = larger
                cells[count] = iy, ix
                count += 1
    return cells[:count]


def least_clearance(solid: NDArray[np.bool_], points: NDArray[np.float64], reach: float) -> float:
    """Distance [cells] from the nearest of points (N, 2) to the nearest solid cell's centre.

    At most ``reach`` [cells].
    """
    return float(_least_clearance(solid, points, reach))


@kernel
def _least_clearance(solid, points, reach):
    for i in range(len(points)):
        y, x = points[i, 0], points[i, 1]
        # The least distance so far bounds the search around the next points.
        for iy in range(max(int(y - reach), 0), min(int(y + reach) + 1, solid.shape[0])):
            for ix in range(max(int(x - reach), 0), min(int(x + reach) + 1, solid.shape[1])):
                if solid[iy, ix]:
                    reach = min(reach, math.hypot(iy + 0.5 - y, ix + 0.5 - x))
    return reach


def collision_free(
    occupied: NDArray[np.bool_],
    forbidden: NDArray[np.bool_],
    robot_radius: float,
    unknown_margin: float,
    resolution: float,
) -> NDArray[np.bool_]:
    """Cells that may contain the robot's centre.

    Parameters
    ----------
    occupied, forbidden : (rows, columns) bool
    robot_radius : float [m]
        Least distance from the centre of an occupied cell.
    unknown_margin : float [m]
        Least distance from the centre of a forbidden cell.
    resolution : float [m]
    """
    return np.asarray(
        ~_near(occupied, robot_radius, resolution) & ~_near(forbidden, unknown_margin, resolution)
    )


def _near(cells: NDArray[np.bool_], distance: float, resolution: float) -> NDArray[np.bool_]:
    """Cells whose centre is within a distance [m] of the centre of one of the given cells."""
    disc = footprint(math.floor((distance / resolution) ** 2 + 1e-6))
    marked = np.where(cells, np.int8(_SOLID), _FREE)
    return np.asarray(inflate(marked, disc, occupied=_SOLID, inflated=_TOUCHED) != _FREE)


def closeness(
    solid: NDArray[np.bool_], radius: float, clearance: float, resolution: float
) -> NDArray[np.float32]:
    """1 where the robot just fits beside a solid cell, linearly to 0 at ``clearance`` [m] more."""
    if not clearance:
        return np.zeros(solid.shape, np.float32)
    reach = (radius + clearance) / resolution
    distance = np.full((solid.shape[0] + 2, solid.shape[1] + 2), reach, np.float32)
    distance[1:-1, 1:-1][solid] = 0.0
    _chamfer(distance)
    distance = distance[1:-1, 1:-1] * np.float32(resolution)
    return np.clip((radius + clearance - distance) / clearance, 0.0, 1.0).astype(np.float32)


@kernel
def _chamfer(distance):
    """Distances [cells] over the 8-connected grid to the zeros, in two passes."""
    rows, columns = distance.shape
    for y in range(1, rows - 1):
        for x in range(1, columns - 1):
            straight = min(distance[y, x - 1], distance[y - 1, x]) + np.float32(1.0)
            across = min(distance[y - 1, x - 1], distance[y - 1, x + 1]) + np.float32(math.sqrt(2))
            distance[y, x] = min(distance[y, x], straight, across)
    for y in range(rows - 2, 0, -1):
        for x in range(columns - 2, 0, -1):
            straight = min(distance[y, x + 1], distance[y + 1, x]) + np.float32(1.0)
            across = min(distance[y + 1, x + 1], distance[y + 1, x - 1]) + np.float32(math.sqrt(2))
            distance[y, x] = min(distance[y, x], straight, across)
