# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Walls and ground of a long-term map, as the scan filter looks them up by cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.localization.ground_planes import fit_planes
from heightmap25d_ros.localization.layers import LayerMap
from heightmap25d_ros.localization.surface import NEAR
from heightmap25d_ros.localization.wall_lines import fit_lines

ELEVATED = 0.12
"""Above the lowest ground within two cells a return is of something that stands there [m]."""

_LEAST_RETURNS = 2  # of ground or wall in a cell; one alone may be a phantom
_MOST_THICKNESS = 0.025  # [m] standard deviation across a wall; the top of a box has 0.036
_MOST_ROUGHNESS = 0.06  # [m] rms about a plane, above which it is no ground to hold on to
_AROUND = 5  # [cells] side of a cell's surroundings
_BORDER = 4
"""Unknown cells around the map: returns of a wall at its edge fall beside it, and walls are looked
for two cells around each."""
_UNKNOWN = 1e6  # [m] lowest ground where there is none
_MAP = np.s_[_BORDER:-_BORDER, _BORDER:-_BORDER]


@dataclass(frozen=True, eq=False, kw_only=True)
class Landmarks:
    """What returns are held against: the cells of a map, with a border of unknown ones.

    Attributes
    ----------
    lowest : (rows, columns) float32 [m]
        The lowest ground within two cells.
    is_near : (rows, columns) bool
        The cells of the map of which a known one is at most `surface.NEAR` cells away. It can tell
        nothing of what lies farther out: lasers may see beyond it.
    is_open : (rows, columns) bool
        Where the map tells that nothing stands but its walls: anything else contradicts it.
    wall_of, plane_of : (rows, columns) int32
        Row of a cell in the tables; -1: none.
    walls : (K, 9) float64
        Mean place x, y; normal x, y; a point x, y of the line [m, map]; variance of the normal
        [rad^2]; variance across the line [m^2]; height of the top [m]. The normal is NaN where
        something stands that is no line.
    planes : (M, 5) float64
        As of `ground_planes.fit_planes`.
    origin : (2,) float [m], map
    resolution : float [m]
    """

    lowest: NDArray[np.float32]
    is_near: NDArray[np.bool_]
    is_open: NDArray[np.bool_]
    wall_of: NDArray[np.int32]
    plane_of: NDArray[np.int32]
    walls: Array
    planes: Array
    origin: tuple[float, float]
    resolution: float

    @property
    def geometry(self) -> Geometry:
        """Of all cells."""
        return Geometry(resolution=self.resolution, origin=self.origin, shape=self.lowest.shape)

    @property
    def is_wall(self) -> NDArray[np.bool_]:
        """The cells (rows, columns) of the map, without the border, in which something stands."""
        return np.asarray(self.wall_of[_MAP] >= 0)

    def arrays(self) -> tuple[Any, ...]:
        """All of it, as the kernels take it."""
        return (
            self.lowest, self.wall_of, self.plane_of, self.walls, self.planes,
            self.origin[0], self.origin[1], 1.0 / self.resolution, self.is_near, self.is_open,
        )  # fmt: skip


def sample_landmarks() -> Landmarks:
    """One wall in 8 x 8 cells of 1 m: something to compile kernels with."""
    nothing = np.full((8, 8), -1, np.int32)
    return Landmarks(
        lowest=np.zeros((8, 8), np.float32), is_near=np.ones((8, 8), bool),
        is_open=np.ones((8, 8), bool), wall_of=nothing, plane_of=nothing, walls=np.zeros((1, 9)),
        planes=np.zeros((1, 5)), origin=(0.0, 0.0), resolution=1.0,
    )  # fmt: skip


def landmarks_of(height_map: HeightMap, layers: LayerMap, *, is_growing: bool = False) -> Landmarks:
    """Walls and ground of a map with layers of the same cells.

    What a map that is growing does not know yet, also close to what it knows, is not open.
    """
    geometry = height_map.geometry
    is_seen = layers.ground_count >= _LEAST_RETURNS
    is_standing = _standing(layers, is_seen)
    is_low = is_seen & ~is_standing
    height = np.where(is_low, layers.ground_height, _UNKNOWN).astype(np.float32)
    lowest = ndimage.minimum_filter(_bordered(height, _UNKNOWN), _AROUND, mode="nearest")
    is_above = is_standing | (is_low & (height > lowest[_MAP] + ELEVATED))
    tops = height_map.metres
    count, places = _elevated_places(layers, is_above)
    is_high = is_standing | (tops > lowest[_MAP] + ELEVATED)
    is_wall = (count >= _LEAST_RETURNS) & height_map.known & is_high
    is_face = is_wall & (_thickness(layers) <= _MOST_THICKNESS**2)
    cells, lines = fit_lines(places, np.where(is_face, count, 0.0), geometry.resolution)
    tops_of_boxes = np.argwhere(is_wall & ~is_face)
    cells = np.concatenate([cells, tops_of_boxes])
    lines = np.concatenate([lines, np.full((len(tops_of_boxes), 5), np.nan)])
    index = tuple(cells.T)
    at, (normal_x, normal_y, offset, variance, scatter) = places[index], lines.T
    on_line = at + offset[:, None] * lines[:, :2]
    walls = np.column_stack([at, normal_x, normal_y, on_line, variance, scatter, tops[index]])
    is_ground = is_seen & ~is_above & ~is_wall
    plane_cells, planes = fit_planes(height.astype(np.float64), is_ground, geometry.resolution)
    is_used = (planes[:, 3] <= _MOST_ROUGHNESS) & _is_inside(plane_cells, geometry.shape)
    is_open = lowest < _UNKNOWN
    if is_growing:
        is_open &= _bordered(height_map.known, False)
    return Landmarks(
        lowest=lowest,
        is_near=_bordered(
            ndimage.maximum_filter(height_map.known, 2 * NEAR + 1, mode="constant"), False
        ),
        is_open=is_open,
        wall_of=_indexed(geometry.shape, cells),
        plane_of=_indexed(geometry.shape, plane_cells[is_used]),
        walls=np.ascontiguousarray(walls),
        planes=np.ascontiguousarray(planes[is_used]),
        origin=tuple(geometry.cell_corner((-_BORDER, -_BORDER)).tolist()),
        resolution=geometry.resolution,
    )


def _bordered(cells: NDArray[Any], outside: float) -> NDArray[Any]:
    """The cells (rows, columns) of a map as `Landmarks` has them: with a border of a value."""
    return np.pad(cells, _BORDER, constant_values=outside)


def _standing(layers: LayerMap, is_seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(rows, columns): what level lasers alone see, without any ground around it."""
    is_level = is_seen & (layers.level_count >= 0.5 * layers.ground_count)
    has_ground = ndimage.maximum_filter(is_seen & ~is_level, _AROUND, mode="constant")
    return np.asarray(is_level & ~has_ground)


def _elevated_places(
    layers: LayerMap, is_above: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], Array]:
    """Count (rows, columns) and mean place (rows, columns, 2) [m, map] of what stands.

    Where even a cell's lowest returns are above its surroundings, they count as well.
    """
    lower = np.where(is_above, layers.ground_count, np.float32(0.0))
    count = layers.elevated_count + lower
    total = np.maximum(count, 1.0)
    geometry = layers.geometry
    centres = geometry.cell_center(np.moveaxis(np.indices(geometry.shape), 0, -1))
    offsets = np.stack([
        (layers.elevated_count * layers.elevated_x + lower * layers.ground_x) / total,
        (layers.elevated_count * layers.elevated_y + lower * layers.ground_y) / total,
    ], axis=-1)  # fmt: skip
    return count, centres + offsets


def _thickness(layers: LayerMap) -> Array:
    """(rows, columns) [m^2]: variance of the places in a cell along their shortest axis."""
    count = np.where(layers.elevated_count > 0, layers.elevated_count, layers.ground_count)
    total = np.maximum(count, 1.0)
    xx, xy, yy = (s / total for s in (layers.spread_xx, layers.spread_xy, layers.spread_yy))
    return np.asarray(0.5 * (xx + yy - np.hypot(xx - yy, 2.0 * xy)), np.float64)


def _is_inside(cells: NDArray[np.int64], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Whether cells (N, 2) are not at the edge, where the foot of a wall looks like a slope."""
    half = _AROUND // 2
    return np.asarray(((cells >= half) & (cells < np.array(shape) - half)).all(axis=1))


def _indexed(shape: tuple[int, int], cells: NDArray[np.int64]) -> NDArray[np.int32]:
    """(rows, columns) with the border: row of each cell in a table; -1: none."""
    index = _bordered(np.full(shape, -1, np.int32), -1)
    index[tuple(cells.T + _BORDER)] = np.arange(len(cells))
    return index
