# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What one map offers to a robot: where it can come to, and what it would see there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.exploration import sight
from heightmap25d_ros.exploration.sight import Outlook, Scenery
from heightmap25d_ros.grid.height_map import Cell, Geometry
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.planning.search import to_cell

LEVEL = 0.7
"""Heights that are farther apart are of different levels [m]."""

NEAR_LOOK = 3.0
"""A look from within this distance counts twice [m]: returns are dense there."""

_SAME_Z = 0.3
"""Slices whose ground is as near to a place are both around it [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Survey:
    """What one map offers to a robot.

    Of a map with several levels this is the slice that the robot is in, and with it the others.

    Attributes
    ----------
    geometry : Geometry
    robot : Pose2D
    costs : (rows, columns) float64 [m of flat open ground]
        Between the robot and each cell where its centre may be; infinite elsewhere.
    scenery : Scenery
        With what is wanted.
    occupied : (rows, columns) bool
    counted : (rows, columns) bool
        Cells whose surface no slice before this one holds.
    fresh : (rows, columns) bool
        Of what is wanted, what is not, nor lies behind, what was looked for in vain.
    certain : (rows, columns) bool
        Of what is wanted, what does not lie behind obstacles that are doubted.
    is_beyond_edges : bool
        Whether what is wanted is where another level is known; see `unseen_decks`.
    is_missed : bool
        Whether what is wanted was looked for in vain, only from afar: it counts at last.
    others : tuple of Survey
        Of the other slices.
    """

    geometry: Geometry
    robot: Pose2D
    costs: NDArray[np.float64]
    scenery: Scenery
    occupied: NDArray[np.bool_]
    counted: NDArray[np.bool_]
    fresh: NDArray[np.bool_]
    certain: NDArray[np.bool_]
    is_beyond_edges: bool = False
    is_missed: bool = False
    others: tuple[Survey, ...] = ()

    @property
    def slices(self) -> tuple[Survey, ...]:
        """All of them, with the one that the robot is in first."""
        return self, *self.others

    @property
    def cell_area(self) -> float:
        """Of a cell [m^2]."""
        return self.geometry.resolution**2

    @property
    def covered(self) -> NDArray[np.bool_]:
        """(rows, columns): known cells where the robot's centre may be."""
        return np.isfinite(self.costs) & self.scenery.known

    @property
    def covered_area(self) -> float:
        """Of the known cells where the robot's centre may be [m^2]."""
        return self.cell_area * sum(float((s.covered & s.counted).sum()) for s in self.slices)

    @property
    def wanted_area(self) -> float:
        """Of the unknown that matters [m^2]."""
        offered = [one.scenery.wanted for one in self.slices if not one.is_missed]
        return self.cell_area * sum(float(wanted.sum()) for wanted in offered)

    def cell_of(self, place: Pose2D) -> Cell:
        """The cell of a place, which may lie outside of the map."""
        return to_cell(self.geometry.cell_at((place.x, place.y)))

    def z_of(self, cell: Cell) -> float:
        """Height [m], map, of the ground in a cell."""
        return float(self.scenery.height[cell]) + self.geometry.ground_zero

    def around(self, place: Pose2D) -> list[Survey]:
        """The slices that a place inside of the map is in, by its z; this one where it has none."""
        cell, z = self.cell_of(place), place.z
        if z is None or not self.others:
            return [self]
        off = np.array([abs(one.z_of(cell) - z) for one in self.slices])
        off += [0.0 if one.scenery.known[cell] else LEVEL for one in self.slices]
        return [one for one, far in zip(self.slices, off, strict=True) if far < off.min() + _SAME_Z]

    def cost_of(self, place: Pose2D) -> float:
        """Of the way between the robot and a place [m]; infinite where there is none."""
        cell = self.cell_of(place)
        if not self.geometry.contains(cell):
            return math.inf
        return min(float(one.costs[cell]) for one in self.around(place))

    def unseen_around(self, place: Pose2D) -> Array:
        """(N, 2) [m], map: the wanted cells that a full turn at a place is expected to show."""
        cell = self.cell_of(place)
        if not self.geometry.contains(cell):
            return np.empty((0, 2))
        seen = [sight.seen_from(one.scenery, cell) for one in self.around(place)]
        return self.geometry.cell_center(np.argwhere(np.any(seen, axis=0)))

    def gain_of(self, place: Pose2D) -> float:
        """Area that a full turn at a place is expected to show [m^2]."""
        cell = self.cell_of(place)
        if not self.geometry.contains(cell):
            return 0.0
        return max(Outlook(one.scenery).gain(cell) for one in self.around(place)) * self.cell_area

    def restricted(self, wanted: NDArray[np.bool_]) -> Survey:
        """The survey of a slice in which only a part (rows, columns) of what is wanted counts."""
        scenery = replace(self.scenery, wanted=self.scenery.wanted & wanted)
        return replace(self, scenery=scenery)

    def seen_from_near(self) -> Survey:
        """The survey of a slice in which places show only what is near, as by a near look."""
        reach = min(self.scenery.reach, NEAR_LOOK / self.geometry.resolution)
        return replace(self, scenery=replace(self.scenery, reach=reach))
