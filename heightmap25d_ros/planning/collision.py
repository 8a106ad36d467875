# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Clearance of the robot from obstacles: its disc over all cells, its rectangle along a path.

`collision_free` and `closeness` are for the graph, over whole maps; `first_overlap` and
`least_clearance` check one path.
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


def first_overlap(
    solid: NDArray[np.bool_], poses: NDArray[np.float64], length: float, width: float
) -> int:
    """Index of the first pose at which the rectangle contains the centre of a solid cell, or -1.

    Parameters
    ----------
    solid : (rows, columns) bool
    poses : (N, 3) float64 [cells, rad]
        y, x of the rectangle's centre and its heading.
    length, width : float [cells]
        Along the heading and across it.

    Examples
    --------
    >>> solid = np.array([[False, False, False, True]])
    >>> first_overlap(solid, np.array([[0.5, 0.5, 0.0], [0.5, 2.5, 0.0]]), 2.0, 1.0)
    1
    """
    return int(_first_overlap(solid, poses, 0.5 * length, 0.5 * width))


@kernel
def _first_overlap(solid, poses, half_length, half_width):
    reach = math.hypot(half_length, half_width)
    for i in range(len(poses)):
        y, x, heading = poses[i]
        cosine, sine = math.cos(heading), math.sin(heading)
        for iy in range(max(int(y - reach), 0), min(int(y + reach) + 1, solid.shape[0])):
            for ix in range(max(int(x - reach), 0), min(int(x + reach) + 1, solid.shape[1])):
                if solid[iy, ix]:
                    dy, dx = iy + 0.5 - y, ix + 0.5 - x
                    ahead, aside = dx * cosine + dy * sine, dy * cosine - dx * sine
                    if abs(ahead) <= half_length and abs(aside) <= half_width:
                        return i
    return -1


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
