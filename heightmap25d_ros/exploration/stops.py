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

from heightmap25d_ros.exploration.sight import Outlook
from heightmap25d_ros.exploration.survey import Survey
from heightmap25d_ros.params.sections import ExplorationParams
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.planning.search import to_cell

MOST_LOOKS = 700
"""So many places are counted, and more only until the first stop has been found."""

_AT_ONCE = 16
"""Places that are counted in one go."""


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
    cells : (K, 2) int64
        Of the slice, all of them reachable.
    params : ExplorationParams

    Attributes
    ----------
    cells : (N, 2) int64
        Those of them with something wanted around them.
    cost : (N,) float64 [m]
    most : (N,) float64 [m^2]
        More than that they do not show.
    bound : (N,) float64
        Of their utilities.
    gain : (N,) float64 [m^2]
        As counted last; NaN: not yet.
    """

    def __init__(self, survey: Survey, cells: NDArray[np.int64], params: ExplorationParams) -> None:
        self._outlook = Outlook(survey.scenery)
        most = self._outlook.most(cells)
        self.survey, self.cells = survey, cells[most > 0]
        self._reach = math.ceil(survey.scenery.reach)
        self.cost = survey.costs[tuple(self.cells.T)]
        self._discount = np.exp(-params.distance_weight * self.cost)
        self.most = most[most > 0] * survey.cell_area
        self.bound = self.most * self._discount
        self.gain = np.full(len(self.cells), np.nan)
        self._is_stale = np.ones(len(self.cells), np.bool_)

    def is_stale(self, n: int) -> bool:
        """Whether a place may show less than when it was counted last."""
        return bool(self._is_stale[n])

    def count(self, numbers: NDArray[np.int64]) -> NDArray[np.float64]:
        """The utilities of some places, by what they show now."""
        self._is_stale[numbers] = False
        self.gain[numbers] = self._outlook.gains(self.cells[numbers]) * self.survey.cell_area
        return np.asarray(self.gain[numbers] * self._discount[numbers])

    def take(self, n: int) -> Stop:
        """Make a place a stop: what it shows is shown."""
        cell = to_cell(self.cells[n])
        shown = self._outlook.show(cell)
        near = (self.cells >= shown.min(axis=0) - self._reach - 1).all(axis=1)
        near &= (self.cells <= shown.max(axis=0) + self._reach + 1).all(axis=1)
        self._is_stale |= near
        x, y = self.survey.geometry.cell_center(cell).tolist()
        place = Pose2D(x, y, z=self.survey.z_of(cell))
        return Stop(place, float(self.gain[n]), float(self.cost[n]))


def best_stops(slices: Sequence[Candidates], least: float, most: int) -> list[Stop]:
    """At most so many stops that each show at least so much [m^2], the most useful ones first."""
    stops: list[Stop] = []
    bound = np.concatenate([np.where(part.most >= least, part.bound, -1.0) for part in slices])
    first = np.cumsum([0, *(len(part.cells) for part in slices)])
    order = np.argsort(-bound, kind="stable")[: int((bound >= 0.0).sum())]
    counted: list[tuple[float, int, int]] = []  # a heap: less their utilities
    begun = looks = 0
    while len(stops) < most and (looks < MOST_LOOKS or not stops):
        if begun < len(order) and not (counted and -counted[0][0] > bound[order[begun]]):
            those = order[begun : begun + _AT_ONCE]
            begun += len(those)
        elif counted:
            _, at, best = heapq.heappop(counted)
            if not slices[at].is_stale(best):
                stops.append(slices[at].take(best))
                continue
            those = np.array([first[at] + best])
        else:
            break
        looks += len(those)
        for index, part in enumerate(slices):
            numbers = those[(those >= first[index]) & (those < first[index + 1])] - first[index]
            for n, utility in zip(numbers.tolist(), part.count(numbers).tolist(), strict=True):
                if part.gain[n] >= least:
                    heapq.heappush(counted, (-utility, index, n))
    return stops
