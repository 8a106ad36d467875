# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A long-term map in the form that registration uses: heights in metres, and edges.

An *edge* is a known cell that stands above another one within two cells, or belongs to a thin
object with unknown cells on both sides: a wall, a post. Lasers measure faces, not tops, so the
stored height of an edge depends on where the robot was, and only its position can be compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros import memory
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, HeightMap
from heightmap25d_ros.localization.height_pyramid import HeightPyramid, pyramid_of

NEAR = 8  # [cells] from known cells within which unknown cells count
BORDER = NEAR + 2  # [cells] width of the unknown border around a surface
_BYTES_OF_CELL = 32  # heights, edges, the same with their border, and what is between


@dataclass(frozen=True, eq=False)
class Surface:
    """A long-term map for the kernels of `matching`.

    Attributes
    ----------
    heights : (rows, columns) float32 [m], map
        z of the surface, NaN where unknown.
    is_edge : (rows, columns) bool
    origin : (2,) float [m], map
        The outer corner of cell (0, 0).
    resolution : float [m]
    """

    heights: NDArray[np.float32]
    is_edge: NDArray[np.bool_]
    origin: tuple[float, float]
    resolution: float

    @cached_property
    def bordered(self) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_]]:
        """Heights, edges, and cells near known ones, with a border of unknown cells.

        Cached: a map may be large.
        """
        heights = np.pad(self.heights, BORDER, constant_values=np.nan)
        around = 2 * NEAR + 1
        counts = ndimage.maximum_filter(~np.isnan(heights), around, mode="constant")
        return heights, np.pad(self.is_edge, BORDER), counts

    @cached_property
    def pyramid(self) -> HeightPyramid:
        """What windows of the map hold, for the search of the whole map; cached."""
        return pyramid_of(*self.bordered, BORDER)


def surface_of(height_map: HeightMap, edge_step: float) -> Surface:
    """The known heights of a map, and its edges.

    Raises
    ------
    InputError
        If the memory is not available.
    """
    memory.require(height_map.height.size * _BYTES_OF_CELL, "localization in this map")
    # Not `HeightMap.metres`: kernels and edges work in single precision.
    heights = height_map.height.astype(np.float32) * np.float32(HEIGHT_RESOLUTION)
    heights[~height_map.known] = np.nan
    geometry = height_map.geometry
    is_edge = edges(heights, edge_step)
    heights += np.float32(geometry.ground_zero)
    return Surface(heights, is_edge, geometry.origin, geometry.resolution)


def edges(heights: NDArray[np.float32], step: float) -> NDArray[np.bool_]:
    """Known cells that are by a step above another one within two cells, or in a thin object.

    A thin object has unknown cells on both sides within two cells, in a row or in a column. Where
    ground ends at unknown cells there is no edge: it is only the end of the observed area.
    """
    rows, columns = heights.shape
    around = np.pad(heights, 2, constant_values=np.nan)

    def shifted(dy: int, dx: int) -> NDArray[np.float32]:
        return around[2 + dy : 2 + dy + rows, 2 + dx : 2 + dx + columns]

    is_edge: NDArray[np.bool_] = np.zeros(heights.shape, bool)
    for dy, dx in np.ndindex(5, 5):
        is_edge |= heights - shifted(dy - 2, dx - 2) > step
    for dy, dx in ((0, 1), (1, 0)):
        before, after = (
            np.isnan(shifted(s * dy, s * dx)) | np.isnan(shifted(2 * s * dy, 2 * s * dx))
            for s in (-1, 1)
        )
        is_edge |= before & after
    is_edge &= ~np.isnan(heights)
    return is_edge
