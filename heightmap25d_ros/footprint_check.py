# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robot's rectangle along a path: where it would be over a cell that it must not be over."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FARTHEST = 5.0
"""Clearances beyond this are not looked for [m]."""


def first_overlap(
    solid: NDArray[np.bool_], poses: NDArray[np.float64], size: tuple[float, float]
) -> int:
    """Index of the first pose at which the centre of a solid cell is in the rectangle, or -1.

    Parameters
    ----------
    solid : (rows, columns) bool
    poses : (N, 3) float64 [cells, rad]
        y, x of the rectangle's middle and its heading.
    size : (2,) float [cells]
        Length, along the heading, and width.
    """
    return int(_first_overlap(solid, poses, 0.5 * size[0], 0.5 * size[1]))


@njit(cache=True)
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

    ``reach`` [cells] where none is nearer.
    """
    return float(_least_clearance(solid, points, reach))


@njit(cache=True)
def _least_clearance(solid, points, reach):
    for i in range(len(points)):
        y, x = points[i, 0], points[i, 1]
        # What is nearer already bounds how far the next points have to look.
        for iy in range(max(int(y - reach), 0), min(int(y + reach) + 1, solid.shape[0])):
            for ix in range(max(int(x - reach), 0), min(int(x + reach) + 1, solid.shape[1])):
                if solid[iy, ix]:
                    reach = min(reach, math.hypot(iy + 0.5 - y, ix + 0.5 - x))
    return reach
