# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map of another day that a robot goes on from, as submaps that stay where they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, Area, HeightMap
from heightmap25d_ros.localization import surface
from heightmap25d_ros.localization.landmarks import Landmarks
from heightmap25d_ros.localization.layers import LayerMap
from heightmap25d_ros.localization.long_term_map import LongTermMap, OneLevelMaps
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.map_registration import layers_of_heights
from heightmap25d_ros.slam.submaps import SubmapCells, cells_of

_PART = 8.0  # [m] side of a part: only those around the robot are joined
_AROUND = 2  # [cells] within which a place is on the map
_STOREY = 0.5  # [m] by which the robot may be off what it stands on


class SavedPart:
    """Some metres of a saved map, see `MappedCells`."""

    def __init__(
        self, cells: SubmapCells, T_map_submap: se3.Matrix, level: float, resolution: float
    ) -> None:
        self.T_map_submap, self.level = T_map_submap, level
        self._cells = cells
        corner, low, high = T_map_submap[:2, 3], cells.places.min(axis=0), cells.places.max(axis=0)
        self._bounds = corner + low[::-1] * resolution, corner + (high[::-1] + 1) * resolution

    def cells(self) -> SubmapCells:
        """The cells."""
        return self._cells

    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest x, y (2,) [m] of the cells in the map."""
        return self._bounds

    def confirmed(self) -> NDArray[np.int64]:
        """(N, 2): the places of all cells, since the map was finished."""
        return self._cells.places


class SavedMap:
    """A finished map.

    Parameters
    ----------
    height_map : HeightMap
    layers : LayerMap or None
        Without layers, walls and ground are those of the heights.
    params : Params

    Attributes
    ----------
    long_term : LongTermMap
        In which the robot is found.

    Raises
    ------
    InputError
        If the memory is not available.
    """

    def __init__(self, height_map: HeightMap, layers: LayerMap | None, params: Params) -> None:
        levels = OneLevelMaps.of(height_map, layers, params)
        self.long_term = LongTermMap.of_levels(levels, params)
        self._levels = [of_level for of_level, _ in levels.maps]
        self._geometry = height_map.geometry
        self._parts = [
            _parts(of_level, layers_of_level or _layers_of_heights(of_level, params))
            for of_level, layers_of_level in levels.maps
        ]

    def parts_at(self, T_map_base: se3.Matrix) -> list[SavedPart]:
        """What the scans of a robot at a pose (4, 4) are held against: the level that it is on."""
        return self._parts[self.long_term.number_at(T_map_base)]

    def covers(self, T_map_base: se3.Matrix) -> bool:
        """Whether a robot at a pose (4, 4) stands on the map, or beside a cell that it could."""
        height_map = self._levels[self.long_term.number_at(T_map_base)]
        iy, ix = (int(index) - _AROUND for index in self._geometry.cell_at(T_map_base[:2, 3]))
        side = 2 * _AROUND + 1
        whole = Area(0, 0, *self._geometry.shape)
        cells = Area(iy, ix, side, side).within(whole).slices(whole)
        heights = height_map.height[cells] * HEIGHT_RESOLUTION + self._geometry.ground_zero
        is_near = np.abs(heights - T_map_base[2, 3]) < _STOREY
        return bool((height_map.known[cells] & is_near).any())

    def landmarks_at(self, T_map_base: se3.Matrix) -> Landmarks | None:
        """Of the level that a robot at a pose (4, 4) is on; None where it is not on the map."""
        return self.long_term.at(T_map_base).landmarks if self.covers(T_map_base) else None

    def away(self, xy: Array) -> float:
        """How far [m] a place (2,) [m, map] is from the map's bounding rectangle."""
        low = np.array(self._geometry.origin)
        high = low + np.array(self._geometry.shape[::-1]) * self._geometry.resolution
        return float(np.linalg.norm(np.clip(xy, low, high) - xy))


def _layers_of_heights(height_map: HeightMap, params: Params) -> LayerMap:
    return layers_of_heights(
        height_map, surface.surface_of(height_map, params.registration.edge_step)
    )


def _parts(height_map: HeightMap, layers: LayerMap) -> list[SavedPart]:
    """The cells by the square that they are in."""
    cells, geometry = cells_of(height_map, layers), height_map.geometry
    T = se3.from_xyz_rpy([*geometry.origin, 0.0, 0.0, 0.0, 0.0])
    side = max(round(_PART / geometry.resolution), 1)
    columns = -(-geometry.shape[1] // side)
    square = cells.places[:, 0] // side * columns + cells.places[:, 1] // side
    order = np.argsort(square, kind="stable")
    begins = np.flatnonzero(np.diff(square[order], prepend=-1))
    return [
        SavedPart(
            SubmapCells(cells.places[index], cells.layers[index], cells.top[index]),
            T, geometry.ground_zero, geometry.resolution,
        )
        for index in np.split(order, begins[1:]) if len(index)
    ]  # fmt: skip
