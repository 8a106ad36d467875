# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Along which part of the drive each cell of a submap was seen.

Where a laser meets a slope, and where its line sweeps over the ground, the returns stand in a row
like those of a wall. Such a row goes with the robot: a scan that is held against it finds the robot
where it was a moment before, and the map follows. What is seen at the same place after the robot
has moved on is there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_grid import TILE, HeightGrid, TiledArray
from heightmap25d_ros.grid.height_map import Area
from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.mapping.sensor_model import Beams

STAYING = 0.3
"""Distance [m] that the robot travels from the first sight of a cell to one that confirms it."""

_STANDING = 0.05  # [m] from the start, within which what is seen cannot have gone with the robot


class Sightings:
    """The cells of a growing submap that were seen again.

    Parameters
    ----------
    grid : HeightGrid
        Whose cells they are.
    """

    def __init__(self, grid: HeightGrid) -> None:
        self._geometry = grid.geometry
        self._first = TiledArray(grid.tile_top.shape, np.float32)
        self._is_confirmed = TiledArray(grid.tile_top.shape, np.bool_)

    def integrate(self, beams: Beams, distance: float) -> None:
        """Take in returns that were seen after a distance [m] from the start of the drive."""
        _integrate(
            beams.ends, beams.is_hit & ~beams.is_lone, self._geometry.origin,
            self._geometry.resolution, np.float32(distance), self._first.cells,
            self._is_confirmed.cells,
        )  # fmt: skip

    def read(self, area: Area) -> NDArray[np.bool_]:
        """Whether the cells (rows, columns) of an area were seen again."""
        return self._is_confirmed.read(area)


@kernel
def _integrate(ends, is_used, corner, resolution, distance, first, is_confirmed):
    rows, columns = first.shape[0] * TILE, first.shape[1] * TILE
    for i in range(len(ends)):
        u, v = (ends[i, 0] - corner[0]) / resolution, (ends[i, 1] - corner[1]) / resolution
        if not is_used[i] or not (0.0 <= u < columns and 0.0 <= v < rows):
            continue
        ix, iy = int(u), int(v)
        cell = iy // TILE, ix // TILE, iy % TILE, ix % TILE
        if first[cell] == 0.0:
            first[cell] = 1.0 + distance  # 0: never
        along = 1.0 + distance - first[cell]
        is_confirmed[cell] |= along >= STAYING or distance <= _STANDING
