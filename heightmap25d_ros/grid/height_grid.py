# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The map that grows: tiled storage that takes memory only where cells were observed.

`TiledArray` stores one number per cell; `HeightGrid` holds the arrays of the map, reads and writes
dense rectangles of it, and records which tiles have changed.
"""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import PROBABILITY_THRESHOLD, Area, Geometry, HeightMap
from heightmap25d_ros.params.sections import GridParams

TILE = 16
"""Side of a tile in cells: cells are stored tile by tile, not row by row."""

TOP_BIAS = 32768
"""Added to a height in ``tile_top``, so that zero can mean a tile without any height."""


def _zeros_committed_lazily(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Zeros of which only pages that have been written take memory.

    Anonymous private pages are allocated when they are first written; ``MAP_NORESERVE``
    keeps the kernel from accounting for the rest. Huge pages are refused: a single cell would
    commit 2 MiB (and numpy asks for them on its own for large arrays).
    """
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    map_noreserve = getattr(mmap, "MAP_NORESERVE", 0x4000)  # in Python's mmap since 3.13
    try:
        pages = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | map_noreserve)
    except OSError as error:
        raise InputError(
            f"parameter grid.extent: cannot reserve {size / 2**30:.1f} GiB of addresses ({error})"
        ) from None
    pages.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(pages, dtype=dtype).reshape(shape)


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
        self.cells = _zeros_committed_lazily((*tiles, TILE, TILE), dtype)

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


class HeightGrid:
    """The growing map: a height and a probability per cell, and a candidate.

    The whole extent is addressable from the start. Cell boundaries lie on multiples of the
    resolution in the map frame. Memory is committed by the page (64 x 16 cells) as cells are
    written, and no cell is ever moved or copied as the robot drives.

    Parameters
    ----------
    params : GridParams, optional

    Attributes
    ----------
    geometry : Geometry
    height : TiledArray of int16 [cm]
    probability : TiledArray of uint16
    candidate_height, candidate_probability : TiledArray
        A contradicting higher reading that awaits confirmation; probability 0: none.
    tile_top : (tile rows, tile columns) uint16
        Upper bound of the heights in a tile, plus `TOP_BIAS`; 0 where nothing was observed.
    tile_changed : (tile rows, tile columns) uint8
        Tiles in which a height changed, or a cell became known or unknown, since `take_changed`.

    Examples
    --------
    >>> grid = HeightGrid()
    >>> grid.write(HeightMap.from_metres([[0.0, 0.25]]))
    >>> grid.read().height[0, :2]
    array([ 0, 25], dtype=int16)
    """

    def __init__(self, params: GridParams | None = None) -> None:
        params = params or GridParams()
        half = int(np.ceil(params.extent / (2 * params.resolution * TILE)))
        # An odd number of tiles in a row: with a power of two, all tiles above one another
        # would fall into the same few cache sets.
        tiles = 2 * half, 2 * half + 1
        corner = -half * TILE * params.resolution
        self.geometry = Geometry(
            resolution=params.resolution,
            origin=(corner, corner),
            shape=(tiles[0] * TILE, tiles[1] * TILE),
        )
        self.height = TiledArray(tiles, np.int16)
        self.probability = TiledArray(tiles, np.uint16)
        self.candidate_height = TiledArray(tiles, np.int16)
        self.candidate_probability = TiledArray(tiles, np.uint16)
        self.tile_top: NDArray[np.uint16] = _zeros_committed_lazily(tiles, np.uint16)
        self.tile_changed: NDArray[np.uint8] = _zeros_committed_lazily(tiles, np.uint8)

    @property
    def area(self) -> Area:
        """All addressable cells."""
        return Area(0, 0, *self.geometry.shape)

    def observed_area(self) -> Area:
        """The tile-aligned bounding box of all cells ever observed; empty at first."""
        rows = np.flatnonzero(self.tile_top.any(axis=1))
        columns = np.flatnonzero(self.tile_top.any(axis=0))
        if not len(rows):
            return Area(self.area.rows // 2, self.area.rows // 2, 0, 0)
        return Area(
            int(rows[0]) * TILE,
            int(columns[0]) * TILE,
            int(rows[-1] - rows[0] + 1) * TILE,
            int(columns[-1] - columns[0] + 1) * TILE,
        )

    def take_changed(self) -> NDArray[np.int64]:
        """(K, 2) tiles (ty, tx) that changed since the last call."""
        observed = self.observed_area()
        ty, tx = observed.iy // TILE, observed.ix // TILE
        flags = self.tile_changed[
            ty : ty + observed.rows // TILE, tx : tx + observed.columns // TILE
        ]
        changed = np.argwhere(flags) + (ty, tx)
        flags[:] = 0
        return changed

    def mark_changed(self) -> None:
        """Mark all observed tiles as changed."""
        tiles = np.argwhere(self.tile_top)
        self.tile_changed[tuple(tiles.T)] = 1

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
        )

    def write(self, height_map: HeightMap) -> None:
        """Write a dense map into the grid; it replaces the cells that it covers.

        Raises
        ------
        ValueError
            If its resolution differs, its cells do not coincide with those of the grid, or it
            reaches beyond the extent.
        """
        area = self._area_of(height_map.geometry)
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
        observed = self.probability.cells[tiles] > 0
        top = np.where(observed, self.height.cells[tiles].astype(np.int32) + TOP_BIAS, 0)
        self.tile_top[tiles] = top.max(axis=(2, 3))
        self.tile_changed[tiles] = 1

    def _area_of(self, geometry: Geometry) -> Area:
        if not np.isclose(geometry.resolution, self.geometry.resolution, rtol=1e-6):
            raise ValueError(
                f"resolution is {geometry.resolution} m, the grid's {self.geometry.resolution} m"
            )
        exact = (np.subtract(geometry.origin, self.geometry.origin)) / self.geometry.resolution
        ix, iy = np.rint(exact).astype(int)
        if np.abs(exact - (ix, iy)).max() > 0.01:
            raise ValueError(f"origin {geometry.origin} is not on a cell boundary of the grid")
        area = Area(int(iy), int(ix), *geometry.shape)
        if area.within(self.area) != area:
            raise ValueError("reaches beyond the extent of the grid (parameter grid.extent)")
        return area
