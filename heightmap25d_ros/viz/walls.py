# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Walls and ledges in a map whose foot was not seen: nothing in the map shows their step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.grid.height_map import HeightMap

_WALL = 0.2
"""Least height of a wall above the nearest ground [m]."""


def walls_without_ground(height_map: HeightMap, occupied: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells that are the top of a wall, but not occupied, as the ground beside it is unknown.

    Groups of free cells into which no square of 3 x 3 free cells fits, and which are higher than
    the nearest ground.
    """
    square, is_free = np.ones((3, 3), np.bool_), height_map.known & ~occupied
    ground = ndimage.binary_erosion(is_free, square)
    ground = ndimage.binary_propagation(ground, square, mask=is_free)
    if not ground.any():
        return np.zeros_like(ground)
    nearest = ndimage.distance_transform_edt(~ground, return_distances=False, return_indices=True)
    above = height_map.metres - height_map.metres[tuple(nearest)]
    return np.asarray(is_free & ~ground & (above > _WALL))
