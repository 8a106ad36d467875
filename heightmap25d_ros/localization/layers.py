# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What localization holds on to, per cell: mean height of the ground, mean place of what stands.

A cell of the height map keeps one height in whole centimetres, and its place is known to the size
of the cell. Here the returns themselves are averaged, so that a wall is known to millimetres.

Which returns are of the ground can change as more is seen: each cell averages the heights of its
lowest returns, and the places of those above. A return below the lowest ones starts them anew, and
they become part of what stands above. Cells of which only a wall's face was seen are recognised by
their surroundings, when the layers are read.

Returns from above a deck of a bridge or a garage, of its ground and of what stands on it, are
averaged by themselves. It is a deck where most cells around have a surface above the lowest one: a
wall of which the lasers have seen parts one above the other is none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_grid import TILE, TOP_BIAS, HeightGrid, TiledArray
from heightmap25d_ros.grid.height_map import (
    HEIGHT_RESOLUTION,
    PROBABILITY_THRESHOLD,
    Area,
    Geometry,
    stored_probability,
)
from heightmap25d_ros.grid.levels import BELIEF, BOTTOM
from heightmap25d_ros.kernels import inlined_kernel, kernel
from heightmap25d_ros.mapping.sensor_model import Beams

SLAB = 0.10
"""Above and below their mean [m] within which returns are a cell's lowest ones."""

_KNOWN = stored_probability(PROBABILITY_THRESHOLD)
_AROUND = 3  # [cells] around a return that tell whether it is above a deck
_OF_DECK = 18  # of these 49 cells, with a surface above the lowest one
_LEVEL = 0.15  # [m] below the laser within which a return is level with it
NAMES = (
    "ground_count", "level_count", "ground_height", "ground_scatter", "ground_x", "ground_y",
    "elevated_count", "elevated_x", "elevated_y", "spread_xx", "spread_xy", "spread_yy",
)  # fmt: skip
"""Of the layers, in the order in which kernels take them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LayerMap:
    """A dense rectangle of the layers: what is saved, and localized in.

    Attributes
    ----------
    geometry : Geometry
    ground_count : (rows, columns) float32
        How many returns were the cell's lowest.
    level_count : (rows, columns) float32
        How many of these were not clearly below the laser, as ground is unless it rises.
    ground_height : (rows, columns) float32 [m], map
        Their mean height; 0 where there is none.
    ground_scatter : (rows, columns) float32 [m^2]
        Sum of the squared differences of their heights from that mean.
    ground_x, ground_y : (rows, columns) float32 [m]
        Their mean place, seen from the centre of the cell.
    elevated_count : (rows, columns) float32
        How many returns were higher than these.
    elevated_x, elevated_y : (rows, columns) float32 [m]
        Their mean place, seen from the centre of the cell.
    spread_xx, spread_xy, spread_yy : (rows, columns) float32 [m^2]
        Sums of the squared differences of places from their mean: of the elevated returns, or of
        the lowest ones where there are no others. On the face of a wall they are small across it,
        on the top of a box they are not.
    above : tuple of LayerMap
        The same of what was seen above decks, from below; it is in none of the arrays here.
    """

    geometry: Geometry
    ground_count: NDArray[np.float32]
    level_count: NDArray[np.float32]
    ground_height: NDArray[np.float32]
    ground_scatter: NDArray[np.float32]
    ground_x: NDArray[np.float32]
    ground_y: NDArray[np.float32]
    elevated_count: NDArray[np.float32]
    elevated_x: NDArray[np.float32]
    elevated_y: NDArray[np.float32]
    spread_xx: NDArray[np.float32]
    spread_xy: NDArray[np.float32]
    spread_yy: NDArray[np.float32]
    above: tuple[LayerMap, ...] = ()


class LocalizationLayers:
    """The layers of a map in the making; memory is taken where something was seen.

    Parameters
    ----------
    grid : HeightGrid
        Whose cells they have. Returns are integrated into it first.
    upper : int, optional
        Number of decks, one above the other, whose returns are averaged by themselves.
    """

    def __init__(self, grid: HeightGrid, upper: int = 0) -> None:
        self._grid = grid
        self._levels = [
            {name: TiledArray(grid.tile_top.shape, np.float32) for name in NAMES}
            for _ in range(1 + upper)
        ]  # fmt: skip
        self._cells = [tuple(arrays[name].cells for name in NAMES) for arrays in self._levels]

    def integrate(self, beams: Beams) -> None:
        """Take in the returns of beams in the map that are not lone ones."""
        geometry, upper = self._grid.geometry, self._grid.upper
        ranks, highest = _find_ranks(
            beams.ends, (*geometry.origin, geometry.ground_zero), geometry.resolution,
            upper.heights, upper.beliefs, upper.tile_span, _KNOWN, len(self._levels) - 1,
        )  # fmt: skip
        for number in range(highest + 1):
            _integrate(
                beams.origins, beams.ends, beams.is_hit, beams.is_lone, ranks, number,
                geometry.origin, geometry.resolution, *self._cells[number],
            )  # fmt: skip

    def read(self, area: Area) -> LayerMap:
        """Dense copy of an area."""
        lowest, *above = (
            LayerMap(
                geometry=self._grid.geometry.part(area),
                above=(),
                **{name: array.read(area) for name, array in arrays.items()},
            )
            for arrays in self._levels
        )
        while above and not above[-1].ground_count.any():
            above.pop()
        return replace(lowest, above=tuple(above))

    def write(self, layers: LayerMap) -> None:
        """Put dense layers in, replacing what is stored under them; same cells as the grid's."""
        area = self._grid.area_of(layers.geometry)
        for arrays, written in zip(self._levels, (layers, *layers.above), strict=False):
            for name, array in arrays.items():
                array.put(area, getattr(written, name))


@kernel
def _find_ranks(ends, corner, resolution, heights, beliefs, spans, known, most):
    """Above how many decks the ends (N, 3) of beams are, `most` at the most; and the largest."""
    ranks, highest = np.zeros(len(ends), np.int64), 0
    rows, columns = spans.shape[0] * TILE, spans.shape[1] * TILE
    counts = np.empty(len(heights) + 1, np.int64)
    for i in range(len(ends)):
        u, v = (ends[i, 0] - corner[0]) / resolution, (ends[i, 1] - corner[1]) / resolution
        if not (_AROUND <= u < columns - _AROUND and _AROUND <= v < rows - _AROUND):
            continue
        ix, iy = int(u), int(v)
        z = (ends[i, 2] - corner[2]) / HEIGHT_RESOLUTION
        if not _is_above_some(iy, ix, z, spans):
            continue
        counts[:] = 0
        for y in range(iy - _AROUND, iy + _AROUND + 1):
            for x in range(ix - _AROUND, ix + _AROUND + 1):
                counts[_number_below(y, x, z, heights, beliefs, known)] += 1
        so_many = 0
        for rank in range(len(heights), 0, -1):
            so_many += counts[rank]
            if so_many >= _OF_DECK:
                ranks[i] = min(rank, most)
                highest = max(highest, ranks[i])
                break
    return ranks, highest


@inlined_kernel
def _is_above_some(iy, ix, z, spans):
    """Whether a tile of the surroundings of a cell has an upper surface below a height [cm]."""
    found = False
    for y in (iy - _AROUND, iy + _AROUND):
        for x in (ix - _AROUND, ix + _AROUND):
            lowest, highest = spans[y // TILE, x // TILE]
            found |= highest != 0 and z >= lowest - TOP_BIAS - SLAB / HEIGHT_RESOLUTION
    return found


@inlined_kernel
def _number_below(y, x, z, heights, beliefs, known):
    """How many upper surfaces of a cell are below a height [cm], or at it."""
    ty, tx, row, column = y // TILE, x // TILE, y % TILE, x % TILE
    number = 0
    for layer in range(len(heights)):
        if beliefs[layer, ty, tx, row, column, BELIEF] >= known:
            bottom = heights[layer, ty, tx, row, column, BOTTOM]
            number += z >= bottom - SLAB / HEIGHT_RESOLUTION
    return number


@kernel
def _integrate(  # noqa: PLR0913
    origins, ends, is_hit, is_lone, ranks, rank, corner, resolution,
    ground_count, level_count, ground_height, ground_scatter, ground_x, ground_y,
    elevated_count, elevated_x, elevated_y, spread_xx, spread_xy, spread_yy,
):  # fmt: skip
    """Average the returns (N, 3) of a rank into the cells [tile y, tile x, y, x] they are in."""
    rows, columns = ground_count.shape[0] * TILE, ground_count.shape[1] * TILE
    spread = spread_xx, spread_xy, spread_yy
    for i in range(len(ends)):
        u, v = (ends[i, 0] - corner[0]) / resolution, (ends[i, 1] - corner[1]) / resolution
        is_used = is_hit[i] and not is_lone[i] and ranks[i] == rank
        if not is_used or not (0.0 <= u < columns and 0.0 <= v < rows):
            continue
        ix, iy = int(u), int(v)
        cell = iy // TILE, ix // TILE, iy % TILE, ix % TILE
        x, y, z = (u - ix - 0.5) * resolution, (v - iy - 0.5) * resolution, ends[i, 2]
        above = z - ground_height[cell]
        if ground_count[cell] > 0 and above > SLAB:
            if elevated_count[cell] == 0:
                spread_xx[cell] = spread_xy[cell] = spread_yy[cell] = 0.0
            average(cell, x, y, 1.0, elevated_count, elevated_x, elevated_y, spread, True)
            continue
        if ground_count[cell] > 0 and above < -SLAB:
            average(
                cell, ground_x[cell], ground_y[cell], ground_count[cell],
                elevated_count, elevated_x, elevated_y, spread, True,
            )  # fmt: skip
            ground_count[cell] = level_count[cell] = ground_height[cell] = ground_scatter[cell] = (
                0.0
            )
            ground_x[cell] = ground_y[cell] = 0.0
        level_count[cell] += z > origins[i, 2] - _LEVEL
        is_alone = elevated_count[cell] == 0
        average(cell, x, y, 1.0, ground_count, ground_x, ground_y, spread, is_alone)
        mean = ground_height[cell] + (z - ground_height[cell]) / ground_count[cell]
        ground_scatter[cell] += (z - ground_height[cell]) * (z - mean)
        ground_height[cell] = mean


@inlined_kernel
def average(  # noqa: PLR0913
    cell, x, y, weight, counts, mean_x, mean_y, spread, is_spread,
):  # fmt: skip
    """Take a place, which counts for as many as its weight, into the mean and the spread.

    A kernel for kernels: `counts`, `mean_x`, `mean_y` and the three arrays of `spread` are the
    layers, `cell` is an index into them.
    """
    before = counts[cell]
    total = before + weight
    dx, dy = x - mean_x[cell], y - mean_y[cell]
    counts[cell] = total
    mean_x[cell] += dx * (weight / total)
    mean_y[cell] += dy * (weight / total)
    if is_spread:
        share = before * weight / total
        spread[0][cell] += share * dx * dx
        spread[1][cell] += share * dx * dy
        spread[2][cell] += share * dy * dy
