# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where to look next.

A place is worth its *gain*, the unknown area that a full turn there is expected to show, less what
the way to it costs: ``gain * exp(-distance_weight * cost)``, as of next-best-view planning
(Bircher et al., 2016) over the frontiers of Yamauchi (1997). What was looked for and not seen,
below drop-offs or behind glass, is not wanted any more, so that the exploration ends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.exploration import frontiers
from heightmap25d_ros.exploration.looks import Looks
from heightmap25d_ros.exploration.stops import Candidates, best_stops
from heightmap25d_ros.exploration.survey import LEVEL, Survey
from heightmap25d_ros.exploration.surveyor import Surveyor
from heightmap25d_ros.exploration.tour import MOST, least_between, soonest_tour
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning import planner
from heightmap25d_ros.planning.boundary import Boundary
from heightmap25d_ros.planning.plan import Pose2D

GIVEN_UP_RADIUS = 0.6
"""Places so near to one that was given up are not goals either [m]."""

OPENING = 0.25
"""Of ``min_gain``: so much of a way to new ground must a place show, to be worth the way."""

AGAIN = 2.0
"""Of the way that the robot sees: so far it goes to look again for what it has missed from afar."""

BARREN = 3
"""So many doubtful looks in a row may show less than half of ``min_gain`` of ground to drive on."""

SPARE = 0.5
"""Of the way so far: so much of it may doubtful looks in a row cost that show as little."""

LEDGE = 3.0
"""Known cells that are higher than the ground beside them by so many steps are no ground."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Choice:
    """The next place to look from, among others.

    Attributes
    ----------
    goal : Pose2D or None
        None: no place is worth a way.
    gain : float [m^2]
        Of the goal.
    places : (N, 2) float64 [m], map
        That were compared.
    gains : (N,) float64 [m^2]
    """

    goal: Pose2D | None
    gain: float
    places: Array
    gains: Array


class Explorer:
    """Chooses places to look from, and remembers looks in vain and places that were given up.

    Parameters
    ----------
    params : Params
    boundary : Boundary, optional
        In place of that of the parameters.

    Examples
    --------
    A room with a door at its right, seen but for what is behind the door:

    >>> metres = np.full((40, 80), np.nan)
    >>> metres[:, :40] = 0.0
    >>> metres[:15, 38:40] = metres[25:, 38:40] = 2.0
    >>> explorer = Explorer(Params())
    >>> survey = explorer.survey(HeightMap.from_metres(metres), Pose2D(2.0, 2.5))
    >>> goal = explorer.choose(survey).goal
    >>> goal.x > 2.0
    True
    """

    def __init__(self, params: Params, boundary: Boundary | None = None) -> None:
        self._params = params
        boundary = boundary or Boundary.of(params.exploration.boundary)
        self._looks = Looks()
        self._surveyor = Surveyor(params, boundary, self._looks)
        self.given_up: list[Pose2D] = []
        self._covered = 0.0  # [m^2] after the last look
        self._barren = 0  # looks in a row
        self._fruitful = 0.0  # [m] driven until the last look that was not

    def survey(self, height_map: HeightMap, robot: Pose2D) -> Survey:
        """Look over a map.

        Raises
        ------
        InputError
            If the robot's radius is more than 100 cells, or the memory is not available.
        """
        return self._surveyor.survey(height_map, robot)

    def choose(self, survey: Survey, driven: float = 0.0) -> Choice:
        """Where to go first, of the places that show at least ``min_gain``.

        Where there is none, what was looked for in vain, and may be seen from elsewhere, counts as
        well for places that are as near as the robot sees. Then what opens ways to ``min_gain`` of
        new ground; and at last what was missed from afar, to be seen from near.

        While obstacles are doubted nowhere, once `BARREN` looks in a row were not worth their way;
        and no farther than what is left of `SPARE`.

        Parameters
        ----------
        survey : Survey
        driven : float [m]
            Since the exploration began; 0: not known.
        """
        least, sight = self._params.exploration.min_gain, self._params.exploration.sight
        if self._barren >= BARREN:
            return Choice(goal=None, gain=0.0, places=np.empty((0, 2)), gains=np.empty(0))
        reach = math.inf
        if self._surveyor.is_doubting and driven > 0.0:
            # At the start there is no way yet of which a share could be spared.
            spare = max(SPARE * self._fruitful, AGAIN * sight)
            reach = spare - (driven - self._fruitful)
        offered = [part for part in survey.slices if not part.is_missed]
        choice = self._best(_with_slices([s.restricted(s.fresh) for s in offered]), least, reach)
        if choice.goal is None:
            certain = _with_slices([s.restricted(s.certain) for s in offered])
            choice = self._best(certain, least, min(sight, reach))
        if choice.goal is not None:
            return choice
        opened = self._opened(survey)
        if any(part.scenery.wanted.any() for part in opened):
            choice = self._best(_with_slices(opened), OPENING * least, reach)
        missed = [part for part in survey.slices if part.is_missed]
        if choice.goal is None and missed:
            choice = self._best(_with_slices(missed), least, min(AGAIN * sight, reach))
        return choice

    def _opened(self, survey: Survey) -> list[Survey]:
        """What opens ways; obstacles that are doubted have to be seen from near."""
        parts = [part for part in survey.slices if not part.is_missed]
        return [self._opened_in(part) for part in parts if not part.is_beyond_edges]

    def _opened_in(self, survey: Survey) -> Survey:
        doubted = survey.scenery.wanted & ~survey.certain
        opened = survey.restricted((survey.fresh | doubted) & self._openings(survey))
        return opened.seen_from_near() if doubted.any() else opened

    def doubt_obstacles(self) -> bool:
        """Look from now on, from near, for what else may be unknown; whether that is new.

        That is low obstacles that may be noise, what is beyond edges, and what was looked for in
        vain from below.
        """
        is_new, self._surveyor.is_doubting = not self._surveyor.is_doubting, True
        return is_new

    def _openings(self, survey: Survey) -> NDArray[np.bool_]:
        """Where the robot might come to ``min_gain`` of new ground."""
        own, side = self._params.exploration, survey.geometry.resolution
        looks = self._looks.of(survey.geometry, survey.scenery.height)
        # What is wanted may have been looked for in vain from where it could not be seen.
        allowed = self._surveyor.inside(survey.geometry) & (
            survey.scenery.known | survey.scenery.wanted | (looks < own.looks)
        )
        reachable = np.isfinite(survey.costs)
        return frontiers.openings(
            survey.occupied | self._out_of_reach(survey, reachable),
            reachable,
            allowed,
            self._params.traversability.robot_radius / side,
            math.ceil(own.min_gain / survey.cell_area),
        )

    def _out_of_reach(self, survey: Survey, reachable: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Known cells too high or too low for a way there: walls of which no foot was seen."""
        terrain = self._params.traversability
        if not reachable.any():
            return reachable
        height = survey.scenery.height
        away, nearest = ndimage.distance_transform_edt(~reachable, return_indices=True)
        rise = np.abs(height - height[tuple(nearest)])
        climbed = math.tan(terrain.max_slope) * survey.geometry.resolution * away
        return np.asarray(survey.scenery.known & (rise > LEDGE * terrain.max_step + climbed))

    def _best(self, survey: Survey, least: float, farthest: float) -> Choice:
        """The first place of a tour of those, in all slices, that show at least so much [m^2].

        Those to which the way costs more than a length [m] are left out.
        """
        slices = [self._candidates(part) for part in survey.slices]
        stops = [s for s in best_stops(slices, least, MOST) if s.cost <= farthest]
        counted = [~np.isnan(part.gain) for part in slices]
        compared = list(zip(slices, counted, strict=True))
        places = np.concatenate(
            [survey.geometry.cell_center(part.cells[those]) for part, those in compared]
        )
        gains = np.concatenate([part.gain[those] for part, those in compared])
        if not stops:
            return Choice(goal=None, gain=0.0, places=places, gains=gains)
        costs = np.array([stop.cost for stop in stops])
        at = np.array([(stop.place.x, stop.place.y, stop.place.z) for stop in stops])
        gain = np.array([stop.gain for stop in stops])
        best = stops[soonest_tour(costs, least_between(costs, at), gain)[0]]
        return Choice(goal=best.place, gain=best.gain, places=places, gains=gains)

    def _candidates(self, survey: Survey) -> Candidates:
        own = self._params.exploration
        spacing = max(1, round(own.spacing / survey.geometry.resolution))
        cells = frontiers.viewpoints(survey.costs, spacing)
        return Candidates(survey, cells[~self._are_given_up(survey, cells)], own)

    def note_look(self, survey: Survey, driven: float = 0.0) -> None:
        """The robot has turned around where it is: what should have been seen was looked for.

        Parameters
        ----------
        survey : Survey
        driven : float [m]
            As of `choose`.
        """
        self._looks.note(survey)
        shown, self._covered = survey.covered_area - self._covered, survey.covered_area
        is_barren = shown < 0.5 * self._params.exploration.min_gain
        if is_barren and self._surveyor.is_doubting:
            self._barren += 1
        else:
            self._barren, self._fruitful = 0, driven

    def give_up(self, goal: Pose2D) -> None:
        """Do not choose a place, nor those right beside it, any more."""
        self.given_up.append(goal)

    def take_back(self, goals: Sequence[Pose2D]) -> None:
        """Some of the places that were given up may be chosen after all."""
        self.given_up = [place for place in self.given_up if place not in goals]
        self._barren = 0

    def forget(self) -> None:
        """The map was begun anew."""
        self._looks.forget()
        self._surveyor.is_doubting = False
        self._covered, self._barren = 0.0, 0
        self.given_up = []

    def _are_given_up(self, survey: Survey, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        result = np.zeros(len(cells), np.bool_)
        places = survey.geometry.cell_center(cells)
        z = survey.scenery.height[tuple(cells.T)] + survey.geometry.ground_zero
        for place in self.given_up:
            is_near = np.hypot(places[:, 0] - place.x, places[:, 1] - place.y) < GIVEN_UP_RADIUS
            is_same = not survey.others or place.z is None or np.abs(z - place.z) < LEVEL
            result |= is_near & is_same
        return result


def _with_slices(slices: Sequence[Survey]) -> Survey:
    return replace(slices[0], others=tuple(slices[1:]))


@cache
def compile_kernels() -> None:
    """Compile, or load from numba's cache, all that a choice needs."""
    planner.compile_kernels()
    metres = np.full((48, 96), np.nan)
    metres[:, :56] = 0.0
    metres[10, 20:50] = 0.15  # a low step, which is doubted
    explorer, robot = Explorer(Params()), Pose2D(2.0, 3.0)
    for column in (56, 58):  # the second map has changed
        metres[:, :column] = np.nan_to_num(metres[:, :column])
        height_map = HeightMap.from_metres(metres)
        seldom = replace(
            height_map, probability=height_map.probability - height_map.probability // 4
        )
        survey = explorer.survey(seldom, robot)
        explorer.choose(survey)
        explorer.note_look(survey)
        explorer.doubt_obstacles()
    known, height = survey.scenery.known, survey.scenery.height.copy()
    frontiers.wanted(known, survey.covered, np.ones_like(known), 4.0, height)
