# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What would be seen from a place: unknown cells that known heights do not hide.

Rays go out over the heights of the map from above the ground at a cell. A cell is seen where the
line of sight to it is steeper than that to every known cell before it: walls and ridges hide what
is behind them, edges what is below them. Unknown cells hide nothing, and are as high as the
nearest known cell. Nearer than a radius no ground is seen, since the sensor's beams pass above it.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import Cell
from heightmap25d_ros.kernels import inlined_kernel, kernel

_STEP = 0.7
"""Between two samples of a ray [cells]."""

_SECTORS = 16
"""Of rays: those in which nothing is wanted are not looked along."""

Cells = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scenery:
    """What sight depends on.

    Attributes
    ----------
    height : (rows, columns) float32 [m]
        In unknown cells that of the nearest known one.
    known : (rows, columns) bool
    wanted : (rows, columns) bool
        Unknown cells that are worth being seen.
    sensor_height : float [m]
        Of the sensor above the ground.
    reach, blind : float [cells]
        Cells are seen between these two distances.
    """

    height: NDArray[np.float32]
    known: NDArray[np.bool_]
    wanted: NDArray[np.bool_]
    sensor_height: float
    reach: float
    blind: float


class Outlook:
    """What full turns at places would show, of what others have not shown yet.

    Parameters
    ----------
    scenery : Scenery

    Attributes
    ----------
    wanted : (rows, columns) bool
        What has not been shown.

    Examples
    --------
    A wall hides what is behind it:

    >>> height = np.zeros((1, 6), np.float32)
    >>> height[0, 3] = 2.0
    >>> known = np.array([[True, True, False, True, False, False]])
    >>> scenery = Scenery(height=height, known=known, wanted=~known, sensor_height=0.5,
    ...                   reach=5.0, blind=0.0)
    >>> outlook = Outlook(scenery)
    >>> outlook.gain((0, 0))
    1
    >>> outlook.show((0, 0))
    array([[0, 2]])
    >>> outlook.gain((0, 0))
    0
    """

    def __init__(self, scenery: Scenery) -> None:
        self.wanted = scenery.wanted.copy()
        self._reach = math.ceil(scenery.reach)
        self._sums = _sums(self.wanted)  # tells where nothing is wanted; what is shown still counts
        height, known = map(np.ascontiguousarray, (scenery.height, scenery.known))
        optics = scenery.sensor_height, scenery.blind, _rays(scenery.reach)
        self._arguments = (height, known, self.wanted, self._sums), *optics
        self._stamps = np.zeros(scenery.height.shape, np.int32)
        self._turns = 0
        self._cells = np.empty((math.ceil(2.0 * scenery.reach + 3.0) ** 2, 2), np.int64)

    def most(self, cells: Cells) -> NDArray[np.int64]:
        """(N,): more wanted cells than these a full turn at cells (N, 2) would not show."""
        box = self._reach * np.array([-1, 1, -1, 1])
        return np.asarray(_counts(self._sums, cells, box))

    def gains(self, cells: Cells) -> NDArray[np.int64]:
        """(N,): how many wanted cells a full turn at each cell (N, 2) would show."""
        self._turns += len(cells)
        return np.asarray(_gains(*self._arguments, cells, self._stamps, self._turns, self._cells))

    def gain(self, cell: Cell) -> int:
        """How many wanted cells a full turn at a cell would show."""
        return int(self.gains(np.array([cell]))[0])

    def show(self, cell: Cell) -> Cells:
        """(N, 2): what a full turn at a cell would show; it is not wanted any more."""
        seen = self._cells[: self.gain(cell)].copy()
        self.wanted[tuple(seen.T)] = False
        return seen


def seen_from(scenery: Scenery, cell: Cell) -> NDArray[np.bool_]:
    """(rows, columns): the wanted cells that a full turn at a cell would show."""
    outlook = Outlook(scenery)
    outlook.show(cell)
    return scenery.wanted & ~outlook.wanted


@functools.cache
def _rays(reach: float) -> tuple[NDArray[Any], ...]:
    """The cells that rays cross: offsets (K, 2) as (dy, dx), distances (K,), and the sectors.

    So many rays that at ``reach`` [cells] neighbouring ones are about a cell apart. Of each sector
    the sector's first ray, one after the last one, and the least and largest offset of rows and of
    columns; of each ray where it begins in the list of cells.
    """
    count = _SECTORS * math.ceil(2.0 * math.pi * reach / _SECTORS)
    angles = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    directions = np.column_stack([np.sin(angles), np.cos(angles)])
    samples = np.arange(1.0, reach + 1e-9, _STEP)
    crossed = [np.floor(0.5 + samples[:, None] * direction) for direction in directions]
    crossed = [cells[np.append(True, np.diff(cells, axis=0).any(axis=1))] for cells in crossed]
    offsets = np.concatenate(crossed).astype(np.int64)
    begins = np.cumsum([0, *(len(cells) for cells in crossed)])
    firsts = np.arange(0, count + 1, count // _SECTORS)
    sectors = [
        (first, end, *np.column_stack([cells.min(axis=0), cells.max(axis=0)]).ravel())
        for first, end in pairwise(firsts)
        for cells in (offsets[begins[first] : begins[end]],)
    ]
    distances = np.hypot(*offsets.T).astype(np.float32)
    return offsets.astype(np.int32), distances, begins, np.array(sectors, np.int64)


@kernel
def _sums(mask):
    """(rows + 1, columns + 1): how many cells of a mask are in all rows and columns before."""
    rows, columns = mask.shape
    sums = np.zeros((rows + 1, columns + 1), np.int32)
    for y in range(rows):
        so_far = 0
        for x in range(columns):
            so_far += mask[y, x]
            sums[y + 1, x + 1] = sums[y, x + 1] + so_far
    return sums


@kernel
def _count(sums, iy, ix, box):
    """How many cells are in a box (first and last row, first and last column) around a cell."""
    rows, columns = sums.shape
    top, bottom = max(iy + box[0], 0), min(iy + box[1] + 1, rows - 1)
    left, right = max(ix + box[2], 0), min(ix + box[3] + 1, columns - 1)
    if top >= bottom or left >= right:
        return 0
    return sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]


@kernel
def _counts(sums, cells, box):
    result = np.empty(len(cells), np.int64)
    for n in range(len(cells)):
        result[n] = _count(sums, cells[n, 0], cells[n, 1], box)
    return result


@kernel
def _gains(terrain, sensor_height, blind, rays, cells, stamps, last_stamp, seen):
    """What is seen from each cell; the last one's are listed."""
    result = np.empty(len(cells), np.int64)
    for n in range(len(cells)):
        stamp = last_stamp - len(cells) + 1 + n
        result[n] = _look(
            terrain, sensor_height, blind, rays, cells[n, 0], cells[n, 1], stamps, stamp, seen
        )
    return result


@kernel
def _look(  # noqa: PLR0913
    terrain, sensor_height, blind, rays, iy, ix, stamps, stamp, seen
):
    """The number of wanted cells that are seen from a cell: they are listed, and get the stamp."""
    sums, begins, sectors = terrain[3], rays[2], rays[3]
    place = iy, ix, terrain[0][iy, ix] + np.float32(sensor_height), blind
    count = 0
    for sector in sectors:
        if _count(sums, iy, ix, sector[2:]) == 0:
            continue
        for ray in range(sector[0], sector[1]):
            cells = begins[ray], begins[ray + 1]
            count = _look_along(terrain, rays, cells, place, stamps, stamp, seen, count)
    return count


@inlined_kernel
def _look_along(terrain, rays, cells, place, stamps, stamp, seen, count):
    height, known, wanted, _ = terrain
    offsets, distances, _, _ = rays
    iy, ix, eye, blind = place
    rows, columns = height.shape
    steepest = np.float32(-np.inf)
    for n in range(cells[0], cells[1]):
        y, x = iy + offsets[n, 0], ix + offsets[n, 1]
        if y < 0 or x < 0 or y >= rows or x >= columns:
            break
        if known[y, x]:
            steepest = max(steepest, (height[y, x] - eye) / distances[n])
        elif wanted[y, x] and stamps[y, x] != stamp and distances[n] >= blind:
            if (height[y, x] - eye) / distances[n] < steepest:
                continue
            stamps[y, x] = stamp
            seen[count] = y, x
            count += 1
    return count
