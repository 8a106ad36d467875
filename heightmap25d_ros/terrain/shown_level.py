# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The level of a growing map that is shown where one surface per cell is wanted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_grid import TILE, HeightGrid
from heightmap25d_ros.grid.height_map import Area, HeightMap
from heightmap25d_ros.grid.levels import NO_UPPER
from heightmap25d_ros.params.sections import LevelsParams, TraversabilityParams
from heightmap25d_ros.terrain.slices import LevelFollower, SurfaceStack


class ShownLevel:
    """Where the level that is shown has other heights than the lowest surfaces.

    Parameters
    ----------
    which : "robot", "top" or "lowest"
        The level that the robot is on, followed as it drives; or the highest or the lowest surface
        of each cell. What the robot does not fit under is solid in all of them.
    levels : LevelsParams
    terrain : TraversabilityParams
    """

    def __init__(self, which: str, levels: LevelsParams, terrain: TraversabilityParams) -> None:
        self._which, self._levels, self._terrain = which, levels, terrain
        self._follower = LevelFollower()
        # iy, ix of the grid, height and probability of each cell that differs.
        self._other = np.empty((0, 4), np.int64)

    def update(
        self,
        grid: HeightGrid,
        probability_threshold: float,
        area: Area,
        robot: tuple[float, float, float] | None,
    ) -> None:
        """Find the level anew; tiles in which it has changed are marked as changed in the grid.

        Parameters
        ----------
        grid : HeightGrid
        probability_threshold : float
        area : Area
            Of the grid.
        robot : (x, y, z) [m], map
            None: nobody knows; the lowest surfaces are shown.
        """
        if not grid.has_upper and not len(self._other):
            return
        height_map = grid.read(probability_threshold, area)
        shown = self._level(height_map, robot)
        is_other = (shown.height != height_map.height) & shown.known
        is_other |= shown.known != height_map.known
        cells = np.argwhere(is_other)
        values = shown.height[is_other], shown.probability[is_other]
        before = self._other
        self._other = np.column_stack([cells + (area.iy, area.ix), *values]).astype(np.int64)
        rows, count = np.unique(
            np.concatenate([before[:, :3], self._other[:, :3]]), axis=0, return_counts=True
        )
        for ty, tx in np.unique(rows[count == 1, :2] // TILE, axis=0):
            grid.mark_changed((slice(ty, ty + 1), slice(tx, tx + 1)))

    def seen_in(self, lowest: HeightMap, area: Area) -> HeightMap:
        """The level in place of the lowest surfaces of an area of the grid."""
        inside = self._within(area)
        height, probability = lowest.height.copy(), lowest.probability.copy()
        at = inside[:, 0] - area.iy, inside[:, 1] - area.ix
        height[at], probability[at] = inside[:, 2], inside[:, 3]
        return replace(lowest, height=height, probability=probability, upper=NO_UPPER)

    def _within(self, area: Area) -> NDArray[np.int64]:
        cell = self._other[:, :2] - (area.iy, area.ix)
        return self._other[((cell >= 0) & (cell < area.shape)).all(axis=1)]

    def _level(self, height_map: HeightMap, robot: tuple[float, float, float] | None) -> HeightMap:
        stack = SurfaceStack(height_map, self._levels, self._terrain)
        if self._which == "top":
            return stack.highest().height_map
        start = None
        if robot is not None and self._which == "robot":
            start = self._follower.surface(stack, *robot)
        return (stack.lowest() if start is None else stack.followed(start)).height_map
