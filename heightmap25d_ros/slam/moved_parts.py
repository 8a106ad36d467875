# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Submaps of a drive are moved, as by a loop; the map that was made with them follows.

The map remembers of each cell from which submap it was seen last. Where that one moves, the cell
goes with it, whatever is in it. Where cells of several submaps come to lie on one another, the
newest one counts: it is what a robot that had known its pose would have seen last. So no scan is
kept, and memory grows with the area alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_grid import TILE, HeightGrid, TiledArray
from heightmap25d_ros.grid.height_map import (
    HEIGHT_LIMIT,
    HEIGHT_RESOLUTION,
    SUSPECTED,
    Area,
    Geometry,
    HeightMap,
)
from heightmap25d_ros.kernels import inlined_kernel, kernel
from heightmap25d_ros.localization.layers import NAMES, LayerMap
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.slam.submaps import SubmapCells, cells_of, joined_layers

_GAP = 1  # [cells] from either side of a gap that is filled

FIXED = 0
"""Number of what was not seen from any submap, and does not move."""


def compile_kernels() -> None:
    """Compile, or load from numba's cache, all that a map needs to follow."""
    grid = HeightGrid()
    beam = np.zeros((1, 3))
    hit, lone = np.ones(1, bool), np.zeros(1, bool)
    CellParts(grid).integrate(Beams(origins=beam, ends=beam, is_hit=hit, is_lone=lone), 1)
    height_map = HeightMap.from_metres(np.zeros((1, 1)))
    dense = {name: np.zeros((1, 1), np.float32) for name in NAMES}
    layers = LayerMap(geometry=height_map.geometry, above=(), **dense)
    parts = np.zeros((1, 1), np.uint32)
    moved(PartedMap(height_map, layers, parts), np.eye(4)[None], grid.geometry)


class CellParts:
    """From which submap each cell of a growing map was seen last, counted from 1.

    Parameters
    ----------
    grid : HeightGrid
        Whose cells they are.
    """

    def __init__(self, grid: HeightGrid) -> None:
        self._geometry = grid.geometry
        self._parts = TiledArray(grid.tile_top.shape, np.uint32)

    def integrate(self, beams: Beams, number: int) -> None:
        """Returns were seen from a submap."""
        _mark(
            beams.ends, beams.is_hit & ~beams.is_lone, self._geometry.origin,
            self._geometry.resolution, np.uint32(number), self._parts.cells,
        )  # fmt: skip

    def read(self, area: Area) -> NDArray[np.uint32]:
        """The submaps (rows, columns) of the cells of an area."""
        return self._parts.read(area)

    def write(self, area: Area, parts: NDArray[np.uint32]) -> None:
        """Put the submaps (rows, columns) of an area in."""
        self._parts.put(area, parts)


class PartedMap(NamedTuple):
    """A map of which parts can move.

    Attributes
    ----------
    height_map : HeightMap
    layers : LayerMap or None
    parts : (rows, columns) uint32
        See `CellParts`.
    """

    height_map: HeightMap
    layers: LayerMap | None
    parts: NDArray[np.uint32]


def moved(source: PartedMap, motions: Array, within: Geometry) -> PartedMap:
    """Move the parts of a map.

    Parameters
    ----------
    source : PartedMap
    motions : (K, 4, 4) float64
        From where each part was to where it is: a shift, and a turn by a yaw. Parts from K on stay.
    within : Geometry
        The cells, of the same grid, beyond which nothing is moved.
    """
    geometry = source.height_map.geometry
    parts = np.where(source.parts < len(motions), source.parts, FIXED)
    is_used = (source.height_map.probability > 0) | source.height_map.suspected
    cells = np.argwhere(is_used)
    of_cells = parts[is_used]
    order = np.argsort(of_cells, kind="stable")
    cells, of_cells = cells[order], of_cells[order]
    area = _hull(geometry, cells, motions[of_cells], within)
    target = geometry.part(area)
    index = np.full(target.shape, -1, np.int64)
    backward = np.stack([se3.inverse(motion) for motion in motions])
    _place(
        cells, of_cells, motions, backward, geometry.resolution, geometry.origin, target.origin,
        index,
    )  # fmt: skip
    _fill_gaps(
        cells, of_cells, motions, geometry.resolution, geometry.origin, target.origin,
        _gaps(index, _part_of(is_used, area)), index,
    )  # fmt: skip
    flat = np.where(index >= 0, (cells[:, 0] * geometry.shape[1] + cells[:, 1])[index], -1)
    lifts = np.rint(motions[:, 2, 3] / HEIGHT_RESOLUTION).astype(np.int32)
    placed = np.where(index >= 0, of_cells[index], FIXED).astype(np.uint32)
    layers = source.layers
    return PartedMap(
        height_map=_filled(source.height_map, target, flat, lifts[placed]),
        layers=None if layers is None else _moved_layers(source, layers, parts, motions, target),
        parts=placed,
    )


def _hull(geometry: Geometry, cells: NDArray[np.int64], motions: Array, within: Geometry) -> Area:
    """The cells in which cells (N, 2) can be after their motions (N, 4, 4)."""
    xy = geometry.cell_center(cells)
    xy = np.einsum("nij,nj->ni", motions[:, :2, :2], xy) + motions[:, :2, 3]
    reached = geometry.cell_at(xy)
    low, high = reached.min(axis=0) - 1, reached.max(axis=0) + 2
    area = Area(int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1]))
    y, x = (int(index) for index in geometry.cell_at(within.cell_center((0, 0))))
    return area.within(Area(y, x, *within.shape))


def _part_of(mask: NDArray[np.bool_], area: Area) -> NDArray[np.bool_]:
    """An area of a mask; false where it is beyond."""
    whole = Area(0, 0, *mask.shape)
    shared = whole.within(area)
    found = np.zeros(area.shape, np.bool_)
    found[shared.slices(area)] = mask[shared.slices(whole)]
    return found


def _gaps(index: NDArray[np.int64], was_known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(rows, columns): the cells that parts have left as they moved apart.

    Parts are interleaved, and what is torn between them is not unknown. Nothing is a gap that was
    not known before, nor what lies at the edge of all parts.
    """
    around, margin = np.ones((2 * _GAP + 1, 2 * _GAP + 1), np.bool_), 2 * _GAP
    closed = ndimage.binary_closing(np.pad(index >= 0, margin), around)
    return np.asarray(was_known & (index < 0) & closed[margin:-margin, margin:-margin])


def _filled(
    source: HeightMap, geometry: Geometry, index: NDArray[np.int64], lift: NDArray[np.int32]
) -> HeightMap:
    """Cells with what those of a flat index have, or nothing at -1, lifted [cm]."""
    inside = index >= 0
    suspected = inside & source.suspected.ravel()[index]
    lifted = source.height.ravel()[index] + lift
    fits = inside & (np.abs(lifted) <= HEIGHT_LIMIT)
    height = np.where(fits, lifted, 0).astype(np.int16)
    height[suspected] = SUSPECTED
    probability = np.where(fits, source.probability.ravel()[index], 0).astype(np.uint16)
    return replace(
        source, geometry=geometry, height=height, probability=probability,
        upper=source.upper.at(index, source.geometry.shape[1], lift),
    )  # fmt: skip


class _MovedPart(NamedTuple):
    """See `RigidCells`."""

    T_map_submap: se3.Matrix
    level: float
    content: SubmapCells

    def cells(self) -> SubmapCells:
        """The cells."""
        return self.content


def _moved_layers(
    source: PartedMap,
    layers: LayerMap,
    parts: NDArray[np.uint32],
    motions: Array,
    geometry: Geometry,
) -> LayerMap:
    """The layers of all parts where these are, those above decks by themselves."""
    begun = source.height_map.geometry
    to_target = se3.from_xyz_rpy([-geometry.origin[0], -geometry.origin[1], 0.0, 0.0, 0.0, 0.0])
    from_source = se3.from_xyz_rpy([*begun.origin, 0.0, 0.0, 0.0, 0.0])

    def of_parts(level: LayerMap) -> Iterator[_MovedPart]:
        cells = cells_of(source.height_map, level)
        numbers = parts[tuple(cells.places.T)]
        for number in np.unique(numbers):
            chosen = SubmapCells(*(array[numbers == number] for array in cells))
            T = np.asarray(to_target @ motions[number] @ from_source)
            yield _MovedPart(T, begun.ground_zero, chosen)

    lowest, *above = (
        joined_layers(list(of_parts(level)), geometry) for level in (layers, *layers.above)
    )
    return replace(lowest, above=tuple(above))


@kernel
def _mark(ends, is_used, corner, resolution, number, parts):
    """Write a number into the cells that returns (N, 3) are in."""
    rows, columns = parts.shape[0] * TILE, parts.shape[1] * TILE
    for i in range(len(ends)):
        u, v = (ends[i, 0] - corner[0]) / resolution, (ends[i, 1] - corner[1]) / resolution
        if is_used[i] and 0.0 <= u < columns and 0.0 <= v < rows:
            ix, iy = int(u), int(v)
            parts[iy // TILE, ix // TILE, iy % TILE, ix % TILE] = number


@kernel
def _place(cells, parts, forward, backward, resolution, corner, target_corner, index):
    """Fill in which cell each cell of the target gets: the last one whose square its centre is in.

    So no holes open where a part turns.
    """
    rows, columns = index.shape
    for k in range(len(cells)):
        back = backward[parts[k]]
        u, v = _landed(cells[k], forward[parts[k]], resolution, corner, target_corner)
        for iy in range(max(int(v) - 1, 0), min(int(v) + 2, rows)):
            for ix in range(max(int(u) - 1, 0), min(int(u) + 2, columns)):
                x = target_corner[0] + (ix + 0.5) * resolution
                y = target_corner[1] + (iy + 0.5) * resolution
                source_x = (back[0, 0] * x + back[0, 1] * y + back[0, 3] - corner[0]) / resolution
                source_y = (back[1, 0] * x + back[1, 1] * y + back[1, 3] - corner[1]) / resolution
                if np.floor(source_x) == cells[k, 1] and np.floor(source_y) == cells[k, 0]:
                    index[iy, ix] = k


@inlined_kernel
def _landed(cell, motion, resolution, corner, target_corner):
    """Where the middle of a cell is after its motion, in cells of the target: column, row."""
    x = corner[0] + (cell[1] + 0.5) * resolution
    y = corner[1] + (cell[0] + 0.5) * resolution
    u = (motion[0, 0] * x + motion[0, 1] * y + motion[0, 3] - target_corner[0]) / resolution
    v = (motion[1, 0] * x + motion[1, 1] * y + motion[1, 3] - target_corner[1]) / resolution
    return u, v


@kernel
def _fill_gaps(cells, parts, motions, resolution, corner, target_corner, is_gap, index):
    """Each gap gets the cell that has landed nearest to it."""
    rows, columns = index.shape
    nearest = np.full(index.shape, np.inf)
    for k in range(len(cells)):
        u, v = _landed(cells[k], motions[parts[k]], resolution, corner, target_corner)
        for iy in range(max(int(v) - _GAP, 0), min(int(v) + _GAP + 1, rows)):
            for ix in range(max(int(u) - _GAP, 0), min(int(u) + _GAP + 1, columns)):
                apart = max(abs(ix + 0.5 - u), abs(iy + 0.5 - v))
                if is_gap[iy, ix] and apart < nearest[iy, ix]:
                    nearest[iy, ix], index[iy, ix] = apart, k
