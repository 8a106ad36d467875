# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The map that grows: tiled storage that takes memory only where cells were observed.

`TiledArray` stores one number per cell; `HeightGrid` holds the arrays of the map, reads and writes
dense rectangles of it, and records which tiles have changed.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from scipy import ndimage

from heightmap25d_ros.grid.height_map import (
    HEIGHT_RESOLUTION,
    PROBABILITY_THRESHOLD,
    Area,
    Geometry,
    HeightMap,
    stored_probability,
)
from heightmap25d_ros.grid.lazy_zeros import lazy_zeros
from heightmap25d_ros.grid.levels import (
    BELIEF,
    BOTTOM,
    CANDIDATE,
    CANDIDATE_BELIEF,
    NO_UPPER,
    TOP,
    UpperLayers,
    UpperSurfaces,
)
from heightmap25d_ros.params.sections import GridParams, LevelsParams

TILE = 16
"""Side of a tile in cells: cells are stored tile by tile, not row by row."""

TOP_BIAS = 32768
"""Added to a height in ``tile_top``, so that zero can mean a tile without any height."""

_NO_TILES = (2**62, 2**62, -1, -1, 0)


def anchor_at(position: ArrayLike, resolution: float) -> tuple[float, float, float]:
    """The anchor (x, y, z) [m] of a map that begins at a position (3,) [m], map.

    x and y are the nearest corner of a tile, so that cell boundaries stay on multiples of the
    resolution; z is the nearest whole metre. A map that begins near zero is anchored at zero.
    """
    x, y, z = (float(coordinate) for coordinate in np.asarray(position))
    tile = TILE * resolution
    return (math.floor(x / tile + 0.5) * tile, math.floor(y / tile + 0.5) * tile,
            float(math.floor(z + 0.5)))  # fmt: skip


class TiledArray:
    """A very large 2-D array that takes memory only where it was written.

    Cells are stored tile by tile, in ``cells[ty, tx, y, x]``: neighbours in the world are
    neighbours in memory, in the same page and in few cache sets.

    Parameters
    ----------
    tiles : (rows, columns)
    dtype : one of numpy's
    """

    def __init__(self, tiles: tuple[int, int], dtype: DTypeLike) -> None:
        self.cells = lazy_zeros((*tiles, TILE, TILE), dtype)

    def read(self, area: Area) -> NDArray[Any]:
        """Dense copy (rows, columns) of an area; zeros outside of the array."""
        tiles_y = slice(max(area.iy // TILE, 0), max(-(-(area.iy + area.rows) // TILE), 0))
        tiles_x = slice(max(area.ix // TILE, 0), max(-(-(area.ix + area.columns) // TILE), 0))
        block = self.cells[tiles_y, tiles_x]
        rows, columns = block.shape[0] * TILE, block.shape[1] * TILE
        dense = block.transpose(0, 2, 1, 3).reshape(rows, columns)
        covered = Area(tiles_y.start * TILE, tiles_x.start * TILE, rows, columns)
        inside = area.within(covered)
        result = np.zeros(area.shape, self.cells.dtype)
        result[inside.slices(area)] = dense[inside.slices(covered)]
        return result

    def write(self, area: Area, values: NDArray[Any]) -> None:
        """Store a dense array (rows, columns) at a tile-aligned area inside of the array."""
        if area.iy % TILE or area.ix % TILE or area.rows % TILE or area.columns % TILE:
            raise ValueError("only whole tiles are written")
        tiles_y, tiles_x = area.rows // TILE, area.columns // TILE
        block = values.reshape(tiles_y, TILE, tiles_x, TILE).transpose(0, 2, 1, 3)
        ty, tx = area.iy // TILE, area.ix // TILE
        self.cells[ty : ty + tiles_y, tx : tx + tiles_x] = block

    def put(self, area: Area, values: NDArray[Any]) -> None:
        """Store a dense array (rows, columns) at any area inside of the array."""
        iy, ix = area.iy // TILE * TILE, area.ix // TILE * TILE
        rows = -(-(area.iy + area.rows) // TILE) * TILE - iy
        columns = -(-(area.ix + area.columns) // TILE) * TILE - ix
        whole = Area(iy, ix, rows, columns)
        dense = self.read(whole)
        dense[area.slices(whole)] = values
        self.write(whole, dense)


class HeightGrid:
    """The growing map: a height and a probability per cell, and a candidate.

    The whole extent is addressable from the start. Cell boundaries lie on multiples of the
    resolution in the map frame. Memory is committed by the page (64 x 16 cells) as cells are
    written, and no cell is ever moved or copied as the robot drives. Bounds of the observed and
    of the changed tiles are kept, so that no operation looks at more than was observed.

    Parameters
    ----------
    params : GridParams, optional
    anchor : (x, y, z) float [m], map
        Middle of the extent, moved to the nearest corner of a tile, and the z of height 0.
    levels : LevelsParams, optional
        How many surfaces a cell may hold, and the clear height between them.

    Attributes
    ----------
    geometry : Geometry
    anchor : (x, y, z) float [m], map
    levels : LevelsParams
    upper : UpperLayers
        Surfaces above the lowest ones, which all other arrays hold.
    height : TiledArray of int16 [cm]
    probability : TiledArray of uint16
    candidate_height, candidate_probability : TiledArray
        A contradicting higher reading that awaits confirmation; probability 0: none.
    tile_top : (tile rows, tile columns) uint16
        Upper bound of the heights in a tile, plus `TOP_BIAS`; 0 where nothing was observed.
    tile_changed : (tile rows, tile columns) uint8
        Tiles in which a height changed, or a cell became known or unknown, since `take_changed`.
    observed, changed : (5,) int64
        Bounds of the tiles with a ``tile_top``, and of those with ``tile_changed``: first row,
        first column, last row, last column, and their number. `mapper` updates them.

    Examples
    --------
    >>> grid = HeightGrid()
    >>> grid.write(HeightMap.from_metres([[0.0, 0.25]]))
    >>> grid.read().height[0, :2]
    array([ 0, 25], dtype=int16)
    """

    def __init__(
        self,
        params: GridParams | None = None,
        anchor: tuple[float, float, float] = (0.0, 0.0, 0.0),
        levels: LevelsParams | None = None,
    ) -> None:
        params, self.levels = params or GridParams(), levels or LevelsParams()
        half = int(np.ceil(params.extent / (2 * params.resolution * TILE)))
        # An odd number of tiles in a row: with a power of two, all tiles above one another
        # would fall into the same few cache sets.
        tiles = 2 * half, 2 * half + 1
        x, y = (
            (math.floor(middle / (TILE * params.resolution) + 0.5) - half)
            * TILE * params.resolution
            for middle in anchor[:2]
        )  # fmt: skip
        self.geometry = Geometry(
            resolution=params.resolution,
            origin=(x, y),
            shape=(tiles[0] * TILE, tiles[1] * TILE),
            ground_zero=anchor[2],
        )
        corner = half * TILE * params.resolution
        self.anchor = x + corner, y + corner, anchor[2]
        self.height = TiledArray(tiles, np.int16)
        self.probability = TiledArray(tiles, np.uint16)
        self.candidate_height = TiledArray(tiles, np.int16)
        self.candidate_probability = TiledArray(tiles, np.uint16)
        self.upper = UpperLayers(self.levels.max_surfaces - 1, (*tiles, TILE, TILE))
        self.tile_top: NDArray[np.uint16] = lazy_zeros(tiles, np.uint16)
        self.tile_changed: NDArray[np.uint8] = lazy_zeros(tiles, np.uint8)
        self.observed = np.array(_NO_TILES, np.int64)
        self.changed = np.array(_NO_TILES, np.int64)

    @property
    def area(self) -> Area:
        """All addressable cells."""
        return Area(0, 0, *self.geometry.shape)

    def observed_area(self) -> Area:
        """The tile-aligned bounding box of all cells ever observed; empty at first."""
        first_y, first_x, last_y, last_x, count = self.observed.tolist()
        if not count:
            return Area(self.area.rows // 2, self.area.rows // 2, 0, 0)
        rows, columns = last_y - first_y + 1, last_x - first_x + 1
        return Area(first_y * TILE, first_x * TILE, rows * TILE, columns * TILE)

    def main_area(self, most_cells: float) -> Area:
        """The part of `observed_area` without what is far off and small.

        The largest connected group of observed tiles, and of the others, from large to small, each
        one with which the bounding box has no more cells. Of two groups of one size the one nearer
        to the anchor counts first.

        Parameters
        ----------
        most_cells : float
            Of the bounding box; the largest group may have more by itself.
        """
        area = self.observed_area()
        if area.rows * area.columns <= most_cells:
            return area
        first_y, first_x, last_y, last_x, _ = self.observed.tolist()
        seen = self.tile_top[first_y : last_y + 1, first_x : last_x + 1] > 0
        labels, _ = ndimage.label(seen, np.ones((3, 3)))
        sizes = np.bincount(labels.ravel())[1:]
        boxes = np.array([
            (rows.start + first_y, columns.start + first_x, rows.stop + first_y,
             columns.stop + first_x) for rows, columns in ndimage.find_objects(labels)
        ])  # fmt: skip
        middle = self.tile_top.shape[0] / 2  # on both axes; there is a column more
        away = np.hypot(*(boxes.reshape(-1, 2, 2).mean(axis=1) - middle).T)
        order = np.lexsort((away, -sizes))
        low, high = np.split(boxes[order[0]], 2)
        for box in boxes[order[1:]]:
            lower, higher = np.minimum(low, box[:2]), np.maximum(high, box[2:])
            if np.prod(higher - lower) * TILE**2 <= most_cells:
                low, high = lower, higher
        rows, columns = (high - low) * TILE
        return Area(int(low[0]) * TILE, int(low[1]) * TILE, int(rows), int(columns))

    @property
    def observed_cells(self) -> int:
        """Number of cells of the tiles with observed cells."""
        return int(self.observed[4]) * TILE**2

    def take_changed(self) -> NDArray[np.int64]:
        """(K, 2) tiles (ty, tx) that changed since the last call."""
        first_y, first_x, last_y, last_x, count = self.changed.tolist()
        if not count:
            return np.empty((0, 2), np.int64)
        flags = self.tile_changed[first_y : last_y + 1, first_x : last_x + 1]
        changed = np.argwhere(flags)
        flags[tuple(changed.T)] = 0
        self.changed[:] = _NO_TILES
        return np.asarray(changed + (first_y, first_x))

    def mark_changed(self, tiles: tuple[slice, slice] | None = None) -> None:
        """Mark a rectangle of tiles as changed, by default all observed ones."""
        is_marked: NDArray[np.bool_] | np.bool_ = np.True_
        if tiles is None:
            first_y, first_x, last_y, last_x, count = self.observed.tolist()
            if not count:
                return
            tiles = np.s_[first_y : last_y + 1, first_x : last_x + 1]
            is_marked = self.tile_top[tiles] > 0
        flags = self.tile_changed[tiles]
        _include(self.changed, (flags == 0) & is_marked, tiles)
        flags[...] |= is_marked

    def read(
        self, probability_threshold: float = PROBABILITY_THRESHOLD, area: Area | None = None
    ) -> HeightMap:
        """Dense copy of an area, by default of the observed one."""
        area = self.observed_area() if area is None else area
        return HeightMap(
            geometry=self.geometry.part(area),
            height=self.height.read(area),
            probability=self.probability.read(area),
            probability_threshold=probability_threshold,
            upper=self.upper_surfaces(probability_threshold, area),
        )

    @property
    def has_upper(self) -> bool:
        """Whether there are surfaces above the lowest ones."""
        first_y, first_x, last_y, last_x, count = self.observed.tolist()
        spans = self.upper.tile_span[first_y : last_y + 1, first_x : last_x + 1]
        return bool(count and spans.any())

    def upper_surfaces(self, probability_threshold: float, area: Area) -> UpperSurfaces:
        """The surfaces above the lowest ones of an area: the known ones, and what continues them.

        A reading that the robot fits below waits until a second one confirms it. Beside known
        surfaces of its height it is one of them: far ahead many cells of a deck are read once.
        """
        around = area.grown(1)
        ty, tx = self._tiles_with_upper(around)
        if not len(ty):
            return NO_UPPER
        known = stored_probability(probability_threshold)
        confirmed = self._confirmed(known, ty, tx)
        waiting = self._waiting(known, ty, tx)
        found = confirmed.with_others(waiting.where(confirmed.continued_by(waiting)))
        return found.part(area.iy, area.ix, area.rows, area.columns)

    def _tiles_with_upper(self, area: Area) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and columns of the tiles of an area with known surfaces above the lowest ones."""
        tiles = tuple(
            np.s_[max(first // TILE, 0) : max(-(-(first + count) // TILE), 0)]
            for first, count in ((area.iy, area.rows), (area.ix, area.columns))
        )
        ty, tx = np.nonzero(self.upper.tile_span[tiles][..., 1])
        return ty + tiles[0].start, tx + tiles[1].start

    def _confirmed(self, known: int, ty: NDArray[np.int64], tx: NDArray[np.int64]) -> UpperSurfaces:
        """The surfaces above the lowest ones of some tiles, in cells of the grid."""
        beliefs = self.upper.beliefs[:, ty, tx][..., BELIEF]
        layer, tile, y, x = np.nonzero(beliefs >= known)
        heights = self.upper.heights[layer, ty[tile], tx[tile], y, x]
        return UpperSurfaces.of(
            np.column_stack([ty[tile] * TILE + y, tx[tile] * TILE + x]),
            heights[:, TOP],
            heights[:, BOTTOM],
            beliefs[layer, tile, y, x],
        )

    def _waiting(self, known: int, ty: NDArray[np.int64], tx: NDArray[np.int64]) -> UpperSurfaces:
        """The candidates of some tiles that the robot fits below, in cells of the grid."""
        upper, beliefs = self.upper.heights[:, ty, tx], self.upper.beliefs[:, ty, tx]
        lowest = (self.height, self.probability, self.candidate_height, self.candidate_probability)
        top, belief, candidate, held = (
            np.concatenate([array.cells[None, ty, tx], above])
            for array, above in zip(
                lowest,
                (upper[..., TOP], beliefs[..., BELIEF],
                 upper[..., CANDIDATE], beliefs[..., CANDIDATE_BELIEF]),
                strict=True,
            )
        )  # fmt: skip
        clear = round(self.levels.clear_height / HEIGHT_RESOLUTION)
        is_clear = candidate.astype(np.int32) - top >= clear
        layer, tile, y, x = np.nonzero((belief >= known) & (held > 0) & is_clear)
        z = candidate[layer, tile, y, x]
        return UpperSurfaces.of(
            np.column_stack([ty[tile] * TILE + y, tx[tile] * TILE + x]),
            z, z, held[layer, tile, y, x],
        )  # fmt: skip

    def _write_upper(self, upper: UpperSurfaces, area: Area) -> None:
        """Replace the surfaces above the lowest ones of an area of whole tiles; none are hidden.

        Of a cell with more surfaces than there are layers the lower ones are kept.
        """
        ty, tx = area.iy // TILE, area.ix // TILE
        tiles = np.s_[ty : ty + area.rows // TILE, tx : tx + area.columns // TILE]
        span, heights, beliefs = self.upper.tile_span, self.upper.heights, self.upper.beliefs
        stored = self.upper.stored[1]
        used = np.argwhere(stored[(slice(None), *tiles)].any(axis=(0, 3, 4, 5))) + (ty, tx)
        stored[:, used[:, 0], used[:, 1]] = 0
        span[tiles] = 0
        kept = upper.where(upper.rank < self.upper.count)
        layer, (y, x) = kept.rank, (kept.cell + (area.iy, area.ix)).T
        tile = y // TILE, x // TILE
        at = layer, *tile, y % TILE, x % TILE
        heights[(*at, TOP)], heights[(*at, BOTTOM)] = kept.top, kept.bottom
        beliefs[(*at, BELIEF)] = kept.probability
        span[(*tile, 0)] = 2 * TOP_BIAS
        np.minimum.at(span, (*tile, 0), kept.bottom + np.int32(TOP_BIAS))
        np.maximum.at(span, (*tile, 1), kept.top + np.int32(TOP_BIAS))

    def write(self, height_map: HeightMap) -> None:
        """Write a dense map into the grid; it replaces the cells that it covers.

        Raises
        ------
        ValueError
            If its resolution or its ground zero differs, its cells do not coincide with those of
            the grid, or it reaches beyond the extent.
        """
        area = self.area_of(height_map.geometry)
        ty, tx = area.iy // TILE, area.ix // TILE
        whole = Area(ty * TILE, tx * TILE, 0, 0)
        rows = -(-(area.iy + area.rows) // TILE) * TILE - whole.iy
        columns = -(-(area.ix + area.columns) // TILE) * TILE - whole.ix
        whole = Area(whole.iy, whole.ix, rows, columns)
        for stored, values in (
            (self.height, height_map.height),
            (self.probability, height_map.probability),
            (self.candidate_probability, np.zeros(area.shape, np.uint16)),
        ):
            dense = stored.read(whole)
            dense[area.slices(whole)] = values
            stored.write(whole, dense)
        tiles = np.s_[ty : ty + rows // TILE, tx : tx + columns // TILE]
        y, x = area.iy - whole.iy, area.ix - whole.ix
        confirmed = self._confirmed(1, *self._tiles_with_upper(whole))
        beside = confirmed.moved(-whole.iy, -whole.ix).outside(y, x, *area.shape)
        self._write_upper(beside.with_others(height_map.upper.moved(y, x)), whole)
        is_observed = self.probability.cells[tiles] > 0
        biased = np.where(is_observed, self.height.cells[tiles].astype(np.int32) + TOP_BIAS, 0)
        top = np.maximum(biased.max(axis=(2, 3)), self.upper.tile_span[tiles][..., 1] > 0)
        self.observed[4] -= np.count_nonzero(self.tile_top[tiles])
        _include(self.observed, top > 0, tiles)
        self.tile_top[tiles] = top
        self.mark_changed(tiles)

    def area_of(self, geometry: Geometry) -> Area:
        """The cells that a geometry has; ValueError where they are not the grid's."""
        if not np.isclose(geometry.resolution, self.geometry.resolution, rtol=1e-6):
            raise ValueError(
                f"resolution is {geometry.resolution} m, the grid's {self.geometry.resolution} m"
            )
        exact = (np.subtract(geometry.origin, self.geometry.origin)) / self.geometry.resolution
        ix, iy = np.rint(exact).astype(int)
        if np.abs(exact - (ix, iy)).max() > 0.01:
            raise ValueError(f"origin {geometry.origin} is not on a cell boundary of the grid")
        if geometry.ground_zero != self.geometry.ground_zero:
            raise ValueError(
                f"ground zero is at {geometry.ground_zero} m, the grid's at "
                f"{self.geometry.ground_zero} m"
            )
        area = Area(int(iy), int(ix), *geometry.shape)
        if area.within(self.area) != area:
            raise ValueError("reaches beyond the extent of the grid (parameter grid.extent)")
        return area


def _include(
    bounds: NDArray[np.int64], chosen: NDArray[np.bool_], tiles: tuple[slice, slice]
) -> None:
    """Extend bounds, as of `HeightGrid.observed`, by the chosen ones of a rectangle of tiles."""
    found = np.argwhere(chosen) + (tiles[0].start, tiles[1].start)
    if len(found):
        bounds[:2] = np.minimum(bounds[:2], found.min(axis=0))
        bounds[2:4] = np.maximum(bounds[2:4], found.max(axis=0))
        bounds[4] += len(found)
