# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The obstacles of a growing map, kept up to date by converting only what has changed.

The conversion itself is `traversability.to_obstacle_map`.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_grid import TILE, HeightGrid, TiledArray
from heightmap25d_ros.grid.height_map import Area, Geometry
from heightmap25d_ros.params.sections import TraversabilityParams
from heightmap25d_ros.terrain.shown_level import ShownLevel
from heightmap25d_ros.terrain.traversability import (
    OCCUPIED,
    ObstacleMap,
    covering_disc,
    to_obstacle_map,
)

_SUSPECTED = np.int8(OCCUPIED + 2)  # a stored cost

BLOCK = 16
"""Side [tiles] of the squares that are converted together."""


class ObstacleGrid:
    """The obstacles of a `HeightGrid`, converted again where it changed.

    After each update it equals `to_obstacle_map` of the whole observed area. Like the height
    grid it takes memory only where cells were observed.

    Parameters
    ----------
    geometry : Geometry
        The height grid's.
    params : TraversabilityParams

    Raises
    ------
    InputError
        If the robot's radius is more than 100 cells.
    """

    def __init__(self, geometry: Geometry, params: TraversabilityParams) -> None:
        self._geometry = geometry
        self._params = params
        radius = covering_disc(params, geometry.resolution).radius
        self._influence = radius + max(radius, 1)  # of inflation, and of the ground of a cell
        tiles = geometry.shape[0] // TILE, geometry.shape[1] // TILE
        # A cost is stored plus 1: what was never written is unknown. `_SUSPECTED` is unknown, too.
        self._cost = TiledArray(tiles, np.int8)
        self._blocked = TiledArray(tiles, np.uint8)

    def update(
        self, grid: HeightGrid, probability_threshold: float, level: ShownLevel | None = None
    ) -> NDArray[np.int64]:
        """Convert the area that changes of the grid since the last update can affect.

        Parameters
        ----------
        grid : HeightGrid
        probability_threshold : float
        level : ShownLevel, optional
            The surfaces to convert; the lowest ones, by default.

        Returns
        -------
        (K, 2) int64
            Tiles (ty, tx) that were converted.
        """
        tiles = self._influenced(grid.take_changed(), grid)
        for area in _areas(tiles):
            window = area.grown(self._influence)
            heights = grid.read(probability_threshold, window)
            if level is not None:
                heights = level.seen_in(heights, window)
            converted = to_obstacle_map(heights, self._params)
            inside = area.slices(window)
            is_suspected = (converted.cost == OCCUPIED) & (converted.occupancy < 0)
            stored = np.where(is_suspected, _SUSPECTED, converted.cost + np.int8(1))
            self._cost.write(area, stored[inside])
            self._blocked.write(area, converted.blocked[inside])
        return tiles

    def read(self, area: Area) -> ObstacleMap:
        """Dense copy of an area; unknown outside of the grid."""
        stored = self._cost.read(area)
        is_suspected = stored == _SUSPECTED
        cost = np.where(is_suspected, np.int8(OCCUPIED), stored - np.int8(1))
        occupancy = np.where(cost == OCCUPIED, cost, np.minimum(cost, np.int8(0)))
        return ObstacleMap(
            geometry=self._geometry.part(area),
            occupancy=np.where(is_suspected, np.int8(-1), occupancy),
            cost=cost,
            blocked=self._blocked.read(area),
        )

    def _influenced(self, changed: NDArray[np.int64], grid: HeightGrid) -> NDArray[np.int64]:
        """Changed tiles and the observed ones within their influence, in row-major order."""
        reach = -(-self._influence // TILE)
        offsets = np.indices((2 * reach + 1, 2 * reach + 1)).reshape(2, 1, -1) - reach
        around = (changed.T[:, :, None] + offsets).reshape(2, -1)
        shape = grid.tile_top.shape
        ty, tx = around[:, ((around >= 0) & np.less(around.T, shape).T).all(axis=0)]
        observed = grid.tile_top[ty, tx] > 0
        near = np.ravel_multi_index((ty[observed], tx[observed]), shape)
        tiles = np.union1d(near, np.ravel_multi_index(tuple(changed.T), shape))
        return np.column_stack(np.unravel_index(tiles, shape))


def covering(tiles: NDArray[np.int64]) -> Area:
    """The smallest area that contains all of some tiles (K, 2); empty without tiles."""
    if not len(tiles):
        return Area(0, 0, 0, 0)
    first, sides = tiles.min(axis=0), np.ptp(tiles, axis=0) + 1
    return Area(*(int(number) * TILE for number in (*first, *sides)))


def _areas(tiles: NDArray[np.int64]) -> Iterator[Area]:
    """Areas that cover the tiles: the smallest rectangle in every square of `BLOCK` tiles."""
    blocks = tiles // BLOCK
    order = np.lexsort((blocks[:, 1], blocks[:, 0]))
    new = np.diff(blocks[order], axis=0).any(axis=1)
    for group in np.split(tiles[order], np.flatnonzero(new) + 1):
        if len(group):
            yield covering(group)
