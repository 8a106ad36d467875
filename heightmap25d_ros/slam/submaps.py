# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Submaps: what was seen along some metres, rigid in itself, kept by cell.

A submap has the cells of the map in which it was made. As long as it is not moved, submaps that are
joined give the cells of one map; a moved one is joined by the mean places of its cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array, cells_of_mask
from heightmap25d_ros.grid.height_grid import HeightGrid, anchor_at
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, Area, Geometry, HeightMap
from heightmap25d_ros.kernels import inlined_kernel, kernel
from heightmap25d_ros.localization.layers import NAMES, SLAB, LayerMap, LocalizationLayers, average
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params import sources
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.sightings import Sightings
from heightmap25d_ros.slam.trimming import is_in, squares_of

_MARGIN = 4.0  # [m] of a submap's grid beyond what its lasers reach from its last pose


class SubmapCells(NamedTuple):
    """The cells of a submap in which something was seen.

    Attributes
    ----------
    places : (N, 2) int64
        iy, ix: the cell with the corner (ix, iy) times the resolution.
    layers : (N, 12) float32
        As of `LayerMap`, in the order of `layers.NAMES`; heights from the submap's level.
    top : (N,) float32 [m]
        Height of the height map from that level; NaN where unknown.
    """

    places: NDArray[np.int64]
    layers: NDArray[np.float32]
    top: NDArray[np.float32]


def cells_of(height_map: HeightMap, layers: LayerMap) -> SubmapCells:
    """The cells of a map with layers of the same cells, from its first row and column."""
    is_seen = height_map.known | (layers.ground_count > 0)
    top = height_map.height * np.float32(HEIGHT_RESOLUTION)
    top[~height_map.known] = np.nan
    stacked = np.stack([getattr(layers, name)[is_seen] for name in NAMES], axis=1)
    is_ground = stacked[:, NAMES.index("ground_count")] > 0
    level = np.float32(height_map.geometry.ground_zero)
    stacked[:, NAMES.index("ground_height")] -= np.where(is_ground, level, 0)
    return SubmapCells(cells_of_mask(is_seen), stacked, top[is_seen])


class RigidCells(Protocol):
    """Cells that are somewhere in the map, as a whole."""

    @property
    def T_map_submap(self) -> se3.Matrix:
        """Where they are (4, 4): shifted, and turned by a yaw."""

    @property
    def level(self) -> float:
        """The z [m] of height 0, in their own frame."""

    def cells(self) -> SubmapCells:
        """The cells."""


class MappedCells(RigidCells, Protocol):
    """What scans are held against, see `own_map`."""

    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest x, y (2,) [m] of the cells in the map, not less than these."""

    def confirmed(self) -> NDArray[np.int64]:
        """(N, 2): the places, as of `SubmapCells`, that were seen again, see `sightings`."""


class Submap:
    """A submap, growing until it is finished.

    Parameters
    ----------
    T_map_base : (4, 4) float64
        The robot where it begins.
    params : Params

    Attributes
    ----------
    start : (4, 4) float64
        That pose, in the submap's own frame.
    T_map_submap : (4, 4) float64
        Where the submap is now: shifted, and turned by a yaw. At first its frame is the map's.
    level : float [m]
        z of the heights of its cells, in its own frame.
    """

    def __init__(self, T_map_base: se3.Matrix, params: Params) -> None:
        self.start = T_map_base.copy()
        self.T_map_submap = np.eye(4)
        self._params = params
        resolution = params.grid.resolution
        anchor = anchor_at(T_map_base[:3, 3], resolution)
        self.level = anchor[2]
        extent = 2.0 * (sources.max_range(params) + params.slam.submap_length + _MARGIN)
        self._grid: HeightGrid | None = HeightGrid(replace(params.grid, extent=extent), anchor)
        self._mapper = Mapper(self._grid, params.sensor, params.mapper)
        self._layers = LocalizationLayers(self._grid)
        self._sightings = Sightings(self._grid)
        self._cells: SubmapCells | None = None
        self._confirmed = np.empty((0, 2), np.int64)
        self._squares: NDArray[np.int64] | None = None

    def integrate(self, beams: Beams, distance: float) -> None:
        """Take beams in, in the submap's frame, a distance [m] after the drive began."""
        self._mapper.integrate(beams)
        self._layers.integrate(beams)
        self._sightings.integrate(beams, distance)
        self._cells = None

    def finish(self) -> None:
        """Nothing more will be seen: only the cells are kept."""
        self._cells = self.cells()
        self._confirmed = self.confirmed()
        del self._mapper, self._layers, self._sightings
        self._grid = None

    def squares(self) -> NDArray[np.int64]:
        """(K, 3): the squares, as of `trimming`, in which it has cells, when it is finished."""
        if self._squares is None:
            self._squares = squares_of(self._lowest())
        return self._squares

    def drop(self, is_dropped: NDArray[np.bool_]) -> None:
        """Forget what is in some (K,) of the squares, when it is finished."""
        dropped, cells = self.squares()[is_dropped], self.cells()
        kept = ~is_in(self._lowest(), dropped)
        self._cells = SubmapCells(cells.places[kept], cells.layers[kept], cells.top[kept])
        is_kept = np.isin(_numbered(self._confirmed), _numbered(cells.places[kept]))
        self._confirmed = self._confirmed[is_kept]
        self._squares = self.squares()[~is_dropped]

    def _lowest(self) -> Array:
        """x, y, z (N, 3) [m] of the lowest of each cell, in its own frame."""
        places, layers, top = self.cells()
        is_ground = layers[:, NAMES.index("ground_count")] > 0
        z = np.where(is_ground, layers[:, NAMES.index("ground_height")], top) + self.level
        return np.column_stack([(places[:, ::-1] + 0.5) * self._params.grid.resolution, z])

    def cells(self) -> SubmapCells:
        """What was seen so far."""
        if self._cells is None:
            assert self._grid is not None
            area = self._grid.observed_area()
            height_map = self._grid.read(self._params.mapper.probability_threshold, area)
            resolution = self._params.grid.resolution
            x, y = np.rint(np.array(height_map.geometry.origin) / resolution).astype(np.int64)
            cells = cells_of(height_map, self._layers.read(area))
            self._cells = cells._replace(places=cells.places + (y, x))
        return self._cells

    def confirmed(self) -> NDArray[np.int64]:
        """(N, 2): the places, as of `SubmapCells`, that were seen again, see `sightings`."""
        if self._grid is None:
            return self._confirmed
        area = self._grid.observed_area()
        x, y = self._grid.geometry.part(area).origin
        corner = np.rint(np.array([y, x]) / self._params.grid.resolution).astype(np.int64)
        return np.argwhere(self._sightings.read(area)) + corner

    @property
    def pose(self) -> Array:
        """(4,) float64: x, y, yaw, z of its beginning, in the map."""
        x, y, z, _, _, yaw = se3.to_xyz_rpy(self.T_map_submap @ self.start)
        return np.array([x, y, yaw, z])

    def move_to(self, pose: Array) -> None:
        """Put its beginning to x, y, yaw, z (4,) in the map."""
        x, y, z, _, _, yaw = se3.to_xyz_rpy(self.start)
        turn = se3.from_xyz_rpy([0.0, 0.0, 0.0, 0.0, 0.0, pose[2] - yaw])
        turn[:3, 3] = pose[[0, 1, 3]] - turn[:3, :3] @ (x, y, z)
        self.T_map_submap = turn

    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest x, y (2,) [m] of its cells in the map, not less than these."""
        index, resolution = self.cells().places, self._params.grid.resolution
        if not len(index):
            place = (self.T_map_submap @ self.start)[:2, 3]
            return place, place
        low = index.min(axis=0)[::-1] * resolution
        high = (index.max(axis=0)[::-1] + 1) * resolution
        corners = np.array([[low[0], low[1]], [low[0], high[1]], [high[0], low[1]], high])
        turned = corners @ self.T_map_submap[:2, :2].T + self.T_map_submap[:2, 3]
        return turned.min(axis=0), turned.max(axis=0)


def _numbered(places: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,): a number for each place (N, 2), the same for the same place."""
    return np.asarray((places[:, 0] << 32) + places[:, 1])


class Joined(NamedTuple):
    """Cells of several submaps in one rectangle.

    Attributes
    ----------
    layers : (12, rows, columns) float32
        Heights from the level.
    top : (rows, columns) float32 [m]
        From the level; NaN where unknown.
    """

    layers: NDArray[np.float32]
    top: NDArray[np.float32]


def joined(
    submaps: Sequence[RigidCells],
    area: Area,
    resolution: float,
    level: float,
    heights: tuple[float, float] = (-np.inf, np.inf),
    *,
    has_walls_of_levels: bool = False,
) -> Joined:
    """Join submaps where they are now.

    Parameters
    ----------
    submaps : sequence of RigidCells
    area : Area
        Of cells with corners at multiples of the resolution, as in `SubmapCells`.
    resolution : float [m]
    level : float [m], map
        What the heights are above.
    heights : (lowest, highest) [m], optional
        From the level: cells that are wholly below or above are left out.
    has_walls_of_levels : bool, optional
        Whether the walls in these are in the layers all the same.
    """
    layers = np.zeros((len(NAMES), *area.shape), np.float32)
    top = np.full(area.shape, np.nan, np.float32)
    for submap in submaps:
        cells, T = submap.cells(), submap.T_map_submap
        lift = float(T[2, 3]) + submap.level - level
        placed = float(T[0, 0]), float(T[1, 0]), float(T[0, 3]), float(T[1, 3]), lift
        corner = area.iy, area.ix
        _add_cells(cells, placed, corner, resolution, heights, has_walls_of_levels, layers, top)
    return Joined(layers, top)


def joined_layers(submaps: Sequence[RigidCells], geometry: Geometry) -> LayerMap:
    """The layers of submaps in cells, from whose first corner their poses are seen."""
    level, area = geometry.ground_zero, Area(0, 0, *geometry.shape)
    found = joined(submaps, area, geometry.resolution, level)
    dense = dict(zip(NAMES, found.layers, strict=True))
    is_ground = dense["ground_count"] > 0
    dense["ground_height"] = dense["ground_height"] + np.where(is_ground, np.float32(level), 0)
    return LayerMap(geometry=geometry, above=(), **dense)


@kernel
def _add_cells(submap, placed, corner, resolution, heights, has_walls_of_levels, layers, top):
    """Add the cells of a submap to those that others have."""
    index, cells, tops = submap
    counts = layers[0], layers[6]
    for k in range(len(index)):
        lowest, highest = tops[k], tops[k]
        if cells[k, 0] > 0:
            lowest = cells[k, 2]
            highest = tops[k] if tops[k] > lowest else lowest
        is_near = placed[4] + highest >= heights[0] and placed[4] + lowest <= heights[1]
        if not (is_near or has_walls_of_levels):
            continue
        x0 = (index[k, 1] + 0.5) * resolution
        y0 = (index[k, 0] + 0.5) * resolution
        top_cell = (-1, -1)
        if cells[k, 0] > 0 and is_near:
            cell, x, y = _cell_of(x0 + cells[k, 4], y0 + cells[k, 5], placed, corner, resolution,
                                  top.shape)  # fmt: skip
            if cell[0] >= 0:
                _add_ground(cell, x, y, cells[k, 2] + placed[4], cells[k], placed, layers)
            top_cell = cell
        else:
            top_cell, _, _ = _cell_of(x0, y0, placed, corner, resolution, top.shape)
        if cells[k, 6] > 0:
            cell, x, y = _cell_of(x0 + cells[k, 7], y0 + cells[k, 8], placed, corner, resolution,
                                  top.shape)  # fmt: skip
            if cell[0] >= 0:
                spread = layers[9], layers[10], layers[11]
                if counts[1][cell] == 0:
                    spread[0][cell] = spread[1][cell] = spread[2][cell] = 0.0
                average(cell, x, y, cells[k, 6], layers[6], layers[7], layers[8], spread, True)
                _add_spread(cell, cells[k], placed, layers)
            top_cell = cell
        height = tops[k] + placed[4]
        if is_near and top_cell[0] >= 0 and height == height and not top[top_cell] >= height:
            top[top_cell] = height


@inlined_kernel
def _cell_of(x, y, placed, corner, resolution, shape):
    """The cell of a place of a submap, or (-1, -1), and where in it [m]."""
    cos, sin = placed[0], placed[1]
    u = (cos * x - sin * y + placed[2]) / resolution - corner[1]
    v = (sin * x + cos * y + placed[3]) / resolution - corner[0]
    if not (0.0 <= u < shape[1] and 0.0 <= v < shape[0]):
        return (-1, -1), 0.0, 0.0
    ix, iy = int(u), int(v)
    return (iy, ix), (u - ix - 0.5) * resolution, (v - iy - 0.5) * resolution


@inlined_kernel
def _add_ground(cell, x, y, z, source, placed, layers):
    """Take the lowest returns of a cell in as `layers` takes single ones."""
    ground_count, level_count, height, scatter = layers[0], layers[1], layers[2], layers[3]
    spread = layers[9], layers[10], layers[11]
    above, count = z - height[cell], source[0]
    if ground_count[cell] > 0 and above > SLAB:
        if layers[6][cell] == 0:
            spread[0][cell] = spread[1][cell] = spread[2][cell] = 0.0
        average(cell, x, y, count, layers[6], layers[7], layers[8], spread, True)
        if source[6] == 0:
            _add_spread(cell, source, placed, layers)
        return
    if ground_count[cell] > 0 and above < -SLAB:
        average(
            cell, layers[4][cell], layers[5][cell], ground_count[cell],
            layers[6], layers[7], layers[8], spread, True,
        )  # fmt: skip
        ground_count[cell] = level_count[cell] = height[cell] = scatter[cell] = 0.0
        layers[4][cell] = layers[5][cell] = 0.0
    level_count[cell] += source[1]
    is_alone = layers[6][cell] == 0
    before = ground_count[cell]
    average(cell, x, y, count, ground_count, layers[4], layers[5], spread, is_alone)
    if is_alone and source[6] == 0:
        _add_spread(cell, source, placed, layers)
    difference = z - height[cell]
    scatter[cell] += source[3] + difference * difference * before * count / (before + count)
    height[cell] += difference * count / (before + count)


@inlined_kernel
def _add_spread(cell, source, placed, layers):
    """Add the spread of a submap's cell, turned."""
    cos, sin = placed[0], placed[1]
    xx, xy, yy = source[9], source[10], source[11]
    layers[9][cell] += cos * cos * xx - 2.0 * cos * sin * xy + sin * sin * yy
    layers[10][cell] += cos * sin * (xx - yy) + (cos * cos - sin * sin) * xy
    layers[11][cell] += sin * sin * xx + 2.0 * cos * sin * xy + cos * cos * yy
