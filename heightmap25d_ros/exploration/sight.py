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

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import Cell
from heightmap25d_ros.kernels import kernel

_STEP = 0.7
"""Between two samples of a ray [cells]."""

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
    >>> outlook.gain((0, 0))
    0
    """

    def __init__(self, scenery: Scenery) -> None:
        self._optics = scenery.sensor_height, scenery.blind
        self._rays = _rays(scenery.reach)
        self._height = np.ascontiguousarray(scenery.height)
        self._known = np.ascontiguousarray(scenery.known)
        self.wanted = scenery.wanted.copy()
        self._stamps = np.zeros(scenery.height.shape, np.int32)
        self._turns = 0
        self._cells = np.empty((math.ceil(2.0 * scenery.reach + 3.0) ** 2, 2), np.int64)

    def gain(self, cell: Cell) -> int:
        """How many wanted cells a full turn at a cell would show."""
        return len(self._seen(cell))

    def show(self, cell: Cell) -> None:
        """Take away what a full turn at a cell would show."""
        self.wanted[tuple(self._seen(cell).T)] = False

    def _seen(self, cell: Cell) -> Cells:
        self._turns += 1
        terrain = self._height, self._known, self.wanted
        stamps = self._stamps, self._turns
        count = _look(terrain, *self._optics, self._rays, *cell, *stamps, self._cells)
        return self._cells[:count]


def seen_from(scenery: Scenery, cell: Cell) -> NDArray[np.bool_]:
    """(rows, columns): the wanted cells that a full turn at a cell would show."""
    outlook = Outlook(scenery)
    outlook.show(cell)
    return scenery.wanted & ~outlook.wanted


@functools.cache
def _rays(reach: float) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.int64]]:
    """The cells that rays cross: offsets (K, 2) as (dy, dx), distances (K,), and where rays begin.

    So many rays that at ``reach`` [cells] neighbouring ones are about a cell apart.
    """
    count = max(8, math.ceil(2.0 * math.pi * reach))
    angles = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    directions = np.column_stack([np.sin(angles), np.cos(angles)])
    samples = np.arange(1.0, reach + 1e-9, _STEP)
    crossed = [np.floor(0.5 + samples[:, None] * direction) for direction in directions]
    crossed = [cells[np.append(True, np.diff(cells, axis=0).any(axis=1))] for cells in crossed]
    offsets = np.concatenate(crossed)
    begins = np.cumsum([0, *(len(cells) for cells in crossed)])
    return offsets.astype(np.int32), np.hypot(*offsets.T).astype(np.float32), begins


@kernel
def _look(  # noqa: PLR0913
    terrain, sensor_height, blind, rays, iy, ix, stamps, stamp, seen
):
    """The number of wanted cells that are seen from a cell: they are listed, and get the stamp."""
    height, known, wanted = terrain
    offsets, distances, begins = rays
    rows, columns = height.shape
    eye = height[iy, ix] + np.float32(sensor_height)
    count = 0
    for ray in range(len(begins) - 1):
        steepest = np.float32(-np.inf)
        for n in range(begins[ray], begins[ray + 1]):
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
