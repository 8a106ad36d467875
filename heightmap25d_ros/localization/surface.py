# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How well the points of a short-term map lie on a long-term map.

A hypothesis (x, y, yaw) turns the points about a pivot by the yaw and shifts them. Its score is
the mean of what the points cost, in metres, the lower the better:

- The error of z is eliminated first: the median of the differences in height is taken out.
- What is left of a point's difference costs, up to ``clip``.
- Two *edges* cost nothing. An edge is a cell that stands above one beside it, or of a thin thing
  with unknown cells on both sides: a wall, a post. Lasers see faces, not tops, so the stored
  height of an edge depends on where the robot was, and only its place can be compared.
- An edge over an unknown cell costs the part ``unknown`` of ``clip``, so that a world of one
  height, as a level laser alone sees it, is matched by where there is something. Beyond what the
  map knows nothing counts, neither edges farther than `_NEAR` cells from known ones nor other
  points over unknown cells: a robot that looks farther than the map reaches must not be drawn
  back into it. Half of the points count in any case, as over unknown cells where they are not
  over others, so that no hypothesis wins by having little to compare.

The paper's score, the sum of the absolute differences over cells that are valid in both maps, is
this one without clip, edges, unknown cells, elimination of z and mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, HeightMap

_NEAR = 8  # [cells] from known cells to unknown ones that count
BORDER = _NEAR + 2  # [cells] of unknown ones around a surface


@dataclass(frozen=True, eq=False)
class Surface:
    """A long-term map as the kernels take it.

    Attributes
    ----------
    heights : (rows, columns) float32 [m]
        NaN where unknown.
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
        """Heights, edges and what counts, with a border of unknown cells.

        Made once: a map may be large.
        """
        heights = np.pad(self.heights, BORDER, constant_values=np.nan)
        around = 2 * _NEAR + 1
        counts = ndimage.maximum_filter(~np.isnan(heights), around, mode="constant")
        return heights, np.pad(self.is_edge, BORDER), counts


def surface_of(height_map: HeightMap, edge_step: float) -> Surface:
    """The known heights of a map, and its edges."""
    heights = height_map.height.astype(np.float32) * np.float32(HEIGHT_RESOLUTION)
    heights[~height_map.known] = np.nan
    geometry = height_map.geometry
    is_edge = edges(heights, edge_step)
    return Surface(heights, is_edge, geometry.origin, geometry.resolution)


def edges(heights: NDArray[np.float32], step: float) -> NDArray[np.bool_]:
    """Known cells that stand above another one within two cells by a step, or are of a thin thing.

    Thin things have unknown cells on both sides within two cells, in a row or in a column. Where
    ground ends in unknown cells it is no edge: that is as far as was seen.
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


def coarser(surface: Surface) -> Surface:
    """At half the resolution: the highest of four cells; an edge where one of them is."""
    rows, columns = (-(-side // 2) * 2 for side in surface.heights.shape)
    grow = ((0, rows - surface.heights.shape[0]), (0, columns - surface.heights.shape[1]))
    blocks = (rows // 2, 2, columns // 2, 2)
    heights = np.pad(surface.heights, grow, constant_values=np.nan).reshape(blocks)
    return Surface(
        np.fmax.reduce(np.fmax.reduce(heights, axis=3), axis=1),
        np.asarray(np.pad(surface.is_edge, grow).reshape(blocks).any(axis=(1, 3))),
        surface.origin,
        2 * surface.resolution,
    )
