# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Places that together show most of what is wanted: the stops of a tour.

Greedily, each for what none before it shows. What a place shows never becomes more by others that
were taken, so that its value of before is a bound: it is counted anew only when it comes first
(lazy greedy; Minoux, 1978). The first bound is all that is wanted around a place.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.exploration import frontiers
from heightmap25d_ros.exploration.sight import Outlook
from heightmap25d_ros.exploration.survey import Survey
from heightmap25d_ros.grid.height_map import Cell
from heightmap25d_ros.params.sections import ExplorationParams
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.planning.search import to_cell

SHARE = 0.2
"""Stops with less than this share of the utility of the first one are left for later."""


class Stop(NamedTuple):
    """A place, the area [m^2] that it shows and no stop before it does, and its cost [m]."""

    place: Pose2D
    gain: float
    cost: float


class Candidates:
    """The places of one slice at which the robot may look around.

    Parameters
    ----------
    survey : Survey
    cells : (N, 2) int64
        Of the slice, all of them reachable.
    params : ExplorationParams

    Attributes
    ----------
    bound : (N,) float64
        Of their utilities.
    gain : (N,) float64 [m^2]
        As counted last; NaN: not yet.
    """

    def __init__(self, survey: Survey, cells: NDArray[np.int64], params: ExplorationParams) -> None:
        self.survey, self.cells = survey, cells
        self._outlook = Outlook(survey.scenery)
        self._reach = math.ceil(survey.scenery.reach)
        self.cost = survey.costs[tuple(cells.T)]
        self._discount = np.exp(-params.distance_weight * self.cost)
        around = frontiers.count_around(survey.scenery.wanted, cells, self._reach)
        self.most = around * survey.cell_area
        self.bound = self.most * self._discount
        self.gain = np.full(len(cells), np.nan)
        self._is_stale = np.ones(len(cells), np.bool_)

    def is_stale(self, n: int) -> bool:
        """Whether a place may show less than when it was counted last."""
        return bool(self._is_stale[n])

    def least_best(self, least: float) -> float:
        """A utility that the best place has at least, if it is to show so much [m^2]."""
        if not len(self.bound):
            return 0.0
        n = int(self.bound.argmax())
        utility = self.count(n)
        self._is_stale[n] = True  # its bound is still that of before
        return utility if self.gain[n] >= least else 0.0

    def count(self, n: int) -> float:
        """The utility of a place, by what it shows now."""
        self._is_stale[n] = False
        self.gain[n] = self._outlook.gain(self._cell(n)) * self.survey.cell_area
        return float(self.gain[n] * self._discount[n])

    def take(self, n: int) -> Stop:
        """Make a place a stop: what it shows is shown."""
        cell = self._cell(n)
        self._outlook.show(cell)
        self._is_stale |= (np.abs(self.cells - cell) <= 2 * self._reach + 2).all(axis=1)
        x, y = self.survey.geometry.cell_center(cell).tolist()
        place = Pose2D(x, y, z=self.survey.z_of(cell))
        return Stop(place, float(self.gain[n]), float(self.cost[n]))

    def _cell(self, n: int) -> Cell:
        return to_cell(self.cells[n])


def best_stops(slices: Sequence[Candidates], least: float, most: int) -> list[Stop]:
    """At most so many stops that each show at least so much [m^2], the most useful ones first."""
    stops: list[Stop] = []
    enough = SHARE * max(part.least_best(least) for part in slices)
    waiting = [
        (-float(part.bound[n]), index, int(n))
        for index, part in enumerate(slices)
        for n in np.flatnonzero((part.most >= least) & (part.bound >= enough))
    ]
    heapq.heapify(waiting)
    while waiting and len(stops) < most:
        bound, index, n = waiting[0]
        if -bound < enough:
            break
        part = slices[index]
        if not part.is_stale(n):
            heapq.heappop(waiting)
            stops.append(part.take(n))
            enough = max(enough, -SHARE * bound)
            continue
        utility = part.count(n)
        if part.gain[n] < least:
            heapq.heappop(waiting)
        else:
            heapq.heapreplace(waiting, (-utility, index, n))
    return stops
