# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The cells of the 2 1/2-D map: storage that follows what was seen, and its geometry.

`HeightGrid` is the map that grows; `HeightMap` is a dense rectangle of it, for whoever reads.
"""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import Area, Geometry, HeightMap
from heightmap25d_ros.params.sections import GridParams

TILE = 16
"""Side of a tile in cells: cells are stored tile by tile, not row by row."""

TOP_BIAS = 32768
"""Added to a height in ``tile_top``, so that zero can mean a tile without any height."""


def _zeros_committed_lazily(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Zeros of which only the pages that are written to take memory.

    Anonymous private pages come into being when they are first written; ``MAP_NORESERVE``
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

    Cells lie tile by tile, in ``cells[ty, tx, y, x]``: what is near in the world is near in
    memory, in the same page and under few cache sets.

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
    """The map that grows by itself: a height and a probability per cell, and its candidate.

    The whole extent is addressable from the start and cell boundaries lie on multiples of the
    resolution in the map frame; memory is committed by the page (64 x 16 cells) as cells are
    written. Nothing is ever moved or copied as the robot drives.

    Parameters
    ----------
    params : GridParams

    Attributes
    ----------
    geometry : Geometry
    height : TiledArray of int16 [cm]
    probability : TiledArray of uint16
    candidate_height, candidate_probability : TiledArray
        A contradicting higher reading that waits for a second one; probability 0: none.
    tile_top : (tile rows, tile columns) uint16
        Upper bound of the heights in a tile, plus `TOP_BIAS`; 0 where nothing was observed.
    tile_changed : (tile rows, tile columns) uint8
        Tiles where a height or its being known changed since `take_changed`.
    """

    def __init__(self, params: GridParams) -> None:
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
        """Have `take_changed` return all observed tiles once more."""
        tiles = np.argwhere(self.tile_top)
        self.tile_changed[tuple(tiles.T)] = 1

    def read(self, probability_threshold: float, area: Area | None = None) -> HeightMap:
        """Dense copy of an area, or of all that was observed."""
        area = self.observed_area() if area is None else area
        return HeightMap(
            geometry=self.geometry.part(area),
            height=self.height.read(area),
            probability=self.probability.read(area),
            probability_threshold=probability_threshold,
        )

    def write(self, height_map: HeightMap) -> None:
        """Put a dense map into the grid, replacing what is stored under it.

        Raises
        ------
        ValueError
            If its resolution is another one, its cells do not coincide with the grid's, or it
            reaches beyond the extent.
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
        observed = self.probability.cells[tiles] > 0
        top = np.where(observed, self.height.cells[tiles].astype(np.int32) + TOP_BIAS, 0)
        self.tile_top[tiles] = top.max(axis=(2, 3))
        self.tile_changed[tiles] = 1

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
        area = Area(int(iy), int(ix), *geometry.shape)
        if area.within(self.area) != area:
            raise ValueError("reaches beyond the extent of the grid (parameter grid.extent)")
        return area
