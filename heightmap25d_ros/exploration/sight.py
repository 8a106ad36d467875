# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What would be seen from a place: unknown cells that known heights do not hide.

Rays go out over the heights of the map from above the ground at a cell. A cell is seen where the
line of sight to it is steeper than that to every known cell before it: walls and ridges hide what
is behind them, edges what is below them. Unknown cells hide nothing, and are as high as the
nearest known cell. Nearer than a radius no ground is seen, since the sensor's beams pass above it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

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

    @property
    def rays(self) -> int:
        """So many rays that at ``reach`` neighbouring ones are about a cell apart."""
        return max(8, math.ceil(2.0 * math.pi * self.reach))


def gains(scenery: Scenery, cells: Cells) -> NDArray[np.int64]:
    """(N,): how many wanted cells a full turn at each cell (N, 2) would show.

    Examples
    --------
    A wall hides what is behind it:

    >>> height = np.zeros((1, 6), np.float32)
    >>> height[0, 3] = 2.0
    >>> known = np.array([[True, True, False, True, False, False]])
    >>> scenery = Scenery(height=height, known=known, wanted=~known, sensor_height=0.5,
    ...                   reach=5.0, blind=0.0)
    >>> gains(scenery, np.array([[0, 0]]))
    array([1])
    """
    terrain, optics = _arguments(scenery)
    return np.asarray(_gains(*terrain, *optics, np.ascontiguousarray(cells, np.int64)))


def seen_from(scenery: Scenery, cell: tuple[int, int]) -> NDArray[np.bool_]:
    """(rows, columns): the wanted cells that a full turn at a cell would show."""
    stamps = np.zeros(scenery.height.shape, np.int32)
    terrain, optics = _arguments(scenery)
    _look(terrain, *optics, *cell, stamps, 1)
    return np.asarray(stamps == 1)


def seen_near(scenery: Scenery, cell: tuple[int, int]) -> Cells:
    """(N, 2): the same cells, found without looking at more of the map than is in reach."""
    reach = math.ceil(scenery.reach) + 1
    corner = np.maximum(np.array(cell) - reach, 0)
    rows, columns = (slice(int(low), int(low) + 2 * reach + 1) for low in corner)
    near = replace(
        scenery,
        height=scenery.height[rows, columns],
        known=scenery.known[rows, columns],
        wanted=scenery.wanted[rows, columns],
    )
    y, x = np.array(cell) - corner
    return np.asarray(np.argwhere(seen_from(near, (int(y), int(x)))) + corner)


def _arguments(scenery: Scenery) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """What the kernels take: the terrain, and how it is looked at."""
    angles = 2.0 * np.pi * (np.arange(scenery.rays) + 0.5) / scenery.rays
    directions = np.column_stack([np.sin(angles), np.cos(angles)])
    arrays = scenery.height, scenery.known, scenery.wanted
    terrain = tuple(np.ascontiguousarray(array) for array in arrays)
    return terrain, (scenery.sensor_height, scenery.reach, scenery.blind, directions)


@kernel
def _gains(height, known, wanted, sensor_height, reach, blind, directions, cells):
    result = np.zeros(len(cells), np.int64)
    stamps = np.zeros(height.shape, np.int32)
    for n in range(len(cells)):
        terrain = height, known, wanted
        result[n] = _look(
            terrain,
            sensor_height,
            reach,
            blind,
            directions,
            cells[n, 0],
            cells[n, 1],
            stamps,
            n + 1,
        )
    return result


@kernel
def _look(  # noqa: PLR0913
    terrain, sensor_height, reach, blind, directions, iy, ix, stamps, stamp
):
    """The number of wanted cells that are seen from a cell; they get the stamp."""
    height, known, wanted = terrain
    rows, columns = height.shape
    eye = height[iy, ix] + sensor_height
    count = 0
    for r in range(len(directions)):
        dy, dx = directions[r]
        steepest = -np.inf
        d = 1.0
        while d <= reach:
            y, x = math.floor(iy + 0.5 + dy * d), math.floor(ix + 0.5 + dx * d)
            if y < 0 or x < 0 or y >= rows or x >= columns:
                break
            slope = (height[y, x] - eye) / d
            if known[y, x]:
                steepest = max(steepest, slope)
            elif d >= blind and slope >= steepest and wanted[y, x] and stamps[y, x] != stamp:
                stamps[y, x] = stamp
                count += 1
            d += _STEP
    return count
