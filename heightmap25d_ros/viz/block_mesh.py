# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The visible faces of the blocks of a height map, as in Fig. 2(c) of the paper."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import (
    HEIGHT_RESOLUTION,
    PROBABILITY_SCALE,
    Geometry,
    HeightMap,
)
from heightmap25d_ros.grid.levels import NO_UPPER, UpperSurfaces
from heightmap25d_ros.viz import palette

_SHADE_TOP, _SHADE_SIDE_X, _SHADE_SIDE_Y = 1.0, 0.72, 0.55
_SHADE_CHECKERED = 0.93
_LEAST_SLAB = 0.05  # [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class Faces:
    """Upright and level rectangles, those farther from the viewer first.

    Attributes
    ----------
    corners : (N, 4, 3) float64 [m], map
    height : (N,) float64 [m]
        Of the cell that a face belongs to.
    shade : (N,) float64, 0 .. 1.5
        Brightness: by the face's direction, with the hillshade of its cell, and checkered, to
        distinguish neighbours.
    """

    corners: NDArray[np.float64]
    height: NDArray[np.float64]
    shade: NDArray[np.float64]


def colours(faces: Faces, norm: Normalize) -> NDArray[np.float64]:
    """Colours (N, 3) of faces by their heights and brightness, 0 .. 1."""
    return palette.lit(palette.HEIGHTS(norm(faces.height))[:, :3], faces.shade)


def faces(geometry: Geometry, metres: NDArray[np.float64], azimuth: float) -> Faces:
    """Faces of all cells, each a block from its height down to its lowest neighbour.

    Of two cells the one in the nearer row, or in the same row in the nearer column, is never
    behind the other. So the order of rows and columns is the painter's order: faces that are
    drawn later may cover earlier ones, never the reverse.

    Parameters
    ----------
    geometry : Geometry
    metres : (rows, columns) float64 [m]
        Heights, NaN where unknown.
    azimuth : float [rad]
        Direction from the map to the viewer, who is above it and far away.
    """
    step_x, step_y = (1 if toward > 0.0 else -1 for toward in (np.cos(azimuth), np.sin(azimuth)))
    # From here on, the next row and the next column are nearer to the viewer.
    top = metres[::step_y, ::step_x]
    corner_x, corner_y = (
        geometry.origin[axis] + geometry.resolution * np.arange(geometry.shape[1 - axis])
        for axis in (0, 1)
    )
    x0, y0 = (grid[::step_y, ::step_x] for grid in np.meshgrid(corner_x, corner_y))
    x1, y1 = x0 + geometry.resolution, y0 + geometry.resolution
    near_x, near_y = (x1 if step_x > 0 else x0), (y1 if step_y > 0 else y0)

    around = np.pad(np.where(np.isnan(top), np.inf, top), 1, constant_values=np.inf)
    windows = np.lib.stride_tricks.sliding_window_view(around, (3, 3))
    bottom = windows.min(axis=(2, 3))
    side_x, side_y = (
        (bottom < top) & (np.isinf(beside) | (beside < top))
        for beside in (windows[:, :, 1, 2], windows[:, :, 2, 1])
    )
    quads = np.stack([
        _quad((near_x, y0, bottom), (near_x, y1, bottom), (near_x, y1, top), (near_x, y0, top)),
        _quad((x0, near_y, bottom), (x1, near_y, bottom), (x1, near_y, top), (x0, near_y, top)),
        _quad((x0, y0, top), (x1, y0, top), (x1, y1, top), (x0, y1, top)),
    ], axis=2)  # fmt: skip
    visible = np.stack([side_x, side_y, ~np.isnan(top)], axis=2)
    checkered = np.where(np.indices(top.shape).sum(axis=0) % 2, _SHADE_CHECKERED, 1.0)
    relief = palette.hillshade(metres, geometry.resolution)[::step_y, ::step_x]
    shade = (checkered * relief)[..., None] * (_SHADE_SIDE_X, _SHADE_SIDE_Y, _SHADE_TOP)
    height = np.broadcast_to(top[..., None], visible.shape)
    return Faces(corners=quads[visible], height=height[visible], shade=shade[visible])


def all_faces(geometry: Geometry, metres: NDArray[np.float64]) -> Faces:
    """The faces as of `faces` for viewers on any side, unordered.

    Seen from outside, the corners of each face are in counter-clockwise order.
    """
    parts = []
    for azimuth, side in ((np.pi / 4, 1.0), (-3 * np.pi / 4, -1.0)):
        visible = faces(geometry, metres, azimuth)
        normal = np.cross(
            visible.corners[:, 1] - visible.corners[:, 0],
            visible.corners[:, 2] - visible.corners[:, 1],
        )
        is_new = (normal[:, 2] == 0.0) | (side > 0.0)  # tops are the same from both sides
        points_in = normal[:, :2].sum(axis=1) * side < 0.0
        corners = np.where(points_in[:, None, None], visible.corners[:, ::-1], visible.corners)
        parts.append((corners[is_new], visible.height[is_new], visible.shade[is_new]))
    corners, height, shade = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return Faces(corners=corners, height=height, shade=shade)


def slabs(shown: HeightMap) -> Faces:
    """The faces of the surfaces above the lowest ones, for viewers on any side, unordered.

    Each reaches from its top to its bottom, and is at least `_LEAST_SLAB` thick.
    """
    upper, geometry = shown.upper, shown.geometry
    x0, y0 = geometry.cell_corner(upper.cell).T
    x1, y1 = x0 + geometry.resolution, y0 + geometry.resolution
    z1 = upper.top * HEIGHT_RESOLUTION + geometry.ground_zero
    z0 = np.minimum(upper.bottom * HEIGHT_RESOLUTION + geometry.ground_zero, z1 - _LEAST_SLAB)
    sides = [
        (_SHADE_TOP, [(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)]),
        (_SHADE_SIDE_Y, [(x0, y1, z0), (x1, y1, z0), (x1, y0, z0), (x0, y0, z0)]),
        (_SHADE_SIDE_Y, [(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)]),
        (_SHADE_SIDE_Y, [(x1, y1, z0), (x0, y1, z0), (x0, y1, z1), (x1, y1, z1)]),
        (_SHADE_SIDE_X, [(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)]),
        (_SHADE_SIDE_X, [(x0, y1, z0), (x0, y0, z0), (x0, y0, z1), (x0, y1, z1)]),
    ]
    corners = [np.stack([np.column_stack(c) for c in side], axis=1) for _, side in sides]
    checkered = np.where(upper.cell.sum(axis=1) % 2, _SHADE_CHECKERED, 1.0)
    return Faces(
        corners=np.concatenate(corners),
        height=np.tile(z1, len(sides)),
        shade=np.concatenate([shade * checkered for shade, _ in sides]),
    )


def coarser(shown: HeightMap, max_cells: int) -> HeightMap:
    """The map in larger cells, at most this many, each as high as its highest known cell."""
    rows, columns = shown.geometry.shape
    factor = 1
    while -(-rows // factor) * -(-columns // factor) > max_cells:
        factor += 1
    if factor == 1:
        return shown
    fill = ((0, -rows % factor), (0, -columns % factor))
    lowest = np.iinfo(np.int16).min
    height = np.pad(np.where(shown.known, shown.height, lowest), fill, constant_values=lowest)
    shape = height.shape[0] // factor, height.shape[1] // factor
    merged = height.reshape(shape[0], factor, shape[1], factor).max(axis=(1, 3))
    resolution = shown.geometry.resolution * factor
    return replace(
        shown,
        geometry=replace(shown.geometry, resolution=resolution, shape=shape),
        height=merged,
        probability=np.where(merged > lowest, np.uint16(PROBABILITY_SCALE), np.uint16(0)),
        upper=_highest_of(replace(shown.upper, cell=shown.upper.cell // factor)),
    )


def _highest_of(upper: UpperSurfaces) -> UpperSurfaces:
    """The highest of the surfaces that are in one cell, from the lowest bottom up."""
    cells, inverse = np.unique(upper.cell, axis=0, return_inverse=True)
    if not len(cells):
        return NO_UPPER
    top = np.full(len(cells), np.iinfo(np.int16).min, np.int16)
    bottom = np.full(len(cells), np.iinfo(np.int16).max, np.int16)
    np.maximum.at(top, inverse.ravel(), upper.top)
    np.minimum.at(bottom, inverse.ravel(), upper.bottom)
    return UpperSurfaces.of(cells, top, bottom)


def _quad(*corners: tuple[NDArray[np.float64], ...]) -> NDArray[np.float64]:
    """(rows, columns, 4, 3) of four corners, each x, y, z."""
    return np.stack([np.stack(corner, axis=-1) for corner in corners], axis=2)
