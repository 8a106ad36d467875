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
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.exploration import frontiers, sight
from heightmap25d_ros.exploration.boundary import Boundary, confined
from heightmap25d_ros.exploration.frontiers import Frontiers
from heightmap25d_ros.exploration.sight import Scenery
from heightmap25d_ros.grid.height_map import Cell, Geometry, HeightMap
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.graph import TransitionGraph, transition_graph
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.planning.search import to_cell
from heightmap25d_ros.planning.start_clearing import clear_start

NEAR_LOOK = 3.0
"""A look from within this distance counts twice [m]."""

GIVEN_UP_RADIUS = 0.6
"""Places so near to one that was given up are not goals either [m]."""

OPENING = 0.25
"""Of ``min_gain``: so much of a way to new ground must a place show, to be worth the way."""

LEDGE = 3.0
"""Known cells that are higher than the ground beside them by so many steps are no ground."""

_CHUNK = 400
"""Places whose gains are predicted at a time, those that promise most first."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Survey:
    """What one map offers to a robot.

    Attributes
    ----------
    geometry : Geometry
    robot : Pose2D
    costs : (rows, columns) float64 [m of flat open ground]
        Between the robot and each cell where its centre may be; infinite elsewhere.
    frontiers : Frontiers
    scenery : Scenery
        With what is wanted.
    occupied : (rows, columns) bool
    """

    geometry: Geometry
    robot: Pose2D
    costs: NDArray[np.float64]
    frontiers: Frontiers
    scenery: Scenery
    occupied: NDArray[np.bool_]

    @property
    def cell_area(self) -> float:
        """Of a cell [m^2]."""
        return self.geometry.resolution**2

    @property
    def covered_area(self) -> float:
        """Of the known cells where the robot's centre may be [m^2]."""
        return float((np.isfinite(self.costs) & self.scenery.known).sum()) * self.cell_area

    @property
    def wanted_area(self) -> float:
        """Of the unknown that matters [m^2]."""
        return float(self.scenery.wanted.sum()) * self.cell_area

    def cell_of(self, place: Pose2D) -> Cell:
        """The cell of a place, which may lie outside of the map."""
        return to_cell(self.geometry.cell_at((place.x, place.y)))

    def cost_of(self, place: Pose2D) -> float:
        """Of the way between the robot and a place [m]; infinite where there is none."""
        cell = self.cell_of(place)
        return float(self.costs[cell]) if self.geometry.contains(cell) else math.inf

    def unseen_around(self, place: Pose2D) -> Array:
        """(N, 2) [m], map: the wanted cells that a full turn at a place is expected to show."""
        cell = self.cell_of(place)
        if not self.geometry.contains(cell):
            return np.empty((0, 2))
        return self.geometry.cell_center(np.argwhere(sight.seen_from(self.scenery, cell)))

    def gain_of(self, place: Pose2D) -> float:
        """Area that a full turn at a place is expected to show [m^2]."""
        cell = self.cell_of(place)
        if not self.geometry.contains(cell):
            return 0.0
        return float(sight.gains(self.scenery, np.array([cell]))[0]) * self.cell_area


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
        self._boundary = boundary or Boundary.of(params.exploration.boundary)
        self._looks = np.zeros((0, 0), np.int16)
        self._looks_geometry: Geometry | None = None
        self.given_up: list[Pose2D] = []

    def survey(
        self, height_map: HeightMap, robot: Pose2D, graph: TransitionGraph | None = None
    ) -> Survey:
        """Look over a map.

        Parameters
        ----------
        height_map : HeightMap
        robot : Pose2D
        graph : TransitionGraph, optional
            Of the map, if it has been made already.

        Raises
        ------
        InputError
            If the robot's radius is more than 100 cells, or the memory is not available.
        """
        terrain, own = self._params.traversability, self._params.exploration
        if graph is None:
            graph = transition_graph(height_map, terrain, self._params.planner)
        graph = confined(graph, self._boundary)
        geometry = height_map.geometry
        cell = to_cell(geometry.cell_at((robot.x, robot.y)))
        costs = np.full(geometry.shape, np.inf)
        if geometry.contains(cell):
            cleared = clear_start(graph, robot, terrain, self._params.planner, is_robot_there=True)
            costs = frontiers.travel_costs(cleared, cell) * geometry.resolution
        is_inside = self._boundary.mask(geometry)
        costs[~is_inside] = np.inf
        allowed = is_inside & (self._looks_in(geometry) < own.looks)
        margin = terrain.robot_radius + self._params.planner.unknown_margin
        found = frontiers.find(
            height_map.known,
            graph.occupied,
            np.isfinite(costs),
            allowed,
            radius=margin / geometry.resolution,
            depth=own.frontier_depth / geometry.resolution,
        )
        scenery = Scenery(
            height=graph.height,
            known=height_map.known,
            wanted=found.wanted,
            sensor_height=own.sensor_height,
            reach=own.sight / geometry.resolution,
            blind=own.blind_radius / geometry.resolution,
        )
        return Survey(
            geometry=geometry,
            robot=robot,
            costs=costs,
            frontiers=found,
            scenery=scenery,
            occupied=graph.occupied,
        )

    def choose(self, survey: Survey) -> Choice:
        """The place that is worth most, among those of at least ``min_gain``.

        Where there is none, that from which most is seen of ways to that much new ground.
        """
        own = self._params.exploration
        choice = self._best(survey, survey.scenery, own.min_gain)
        if choice.goal is not None:
            return choice
        opened = self._openings(survey)
        if not opened.any():
            return choice
        scenery = replace(survey.scenery, wanted=survey.scenery.wanted & opened)
        return self._best(survey, scenery, OPENING * own.min_gain)

    def _openings(self, survey: Survey) -> NDArray[np.bool_]:
        """Where the robot might come to ``min_gain`` of new ground."""
        own, side = self._params.exploration, survey.geometry.resolution
        allowed = self._boundary.mask(survey.geometry)
        allowed &= survey.scenery.known | (self._looks_in(survey.geometry) < own.looks)
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

    def _best(self, survey: Survey, scenery: Scenery, least: float) -> Choice:
        """The place with the highest utility that shows at least so much [m^2]."""
        own, side = self._params.exploration, survey.geometry.resolution
        reach = math.ceil(scenery.reach)
        cells = frontiers.viewpoints(np.isfinite(survey.costs), max(1, round(own.spacing / side)))
        cells = cells[~self._are_given_up(survey.geometry, cells)]
        bound = frontiers.count_around(scenery.wanted, cells, reach) * survey.cell_area
        cells, bound = cells[bound >= least], bound[bound >= least]
        discount = np.exp(-own.distance_weight * survey.costs[tuple(cells.T)])
        order = np.argsort(-bound * discount, kind="stable")
        cells, bound, discount = cells[order], bound[order], discount[order]
        gains, utility = np.empty(0), np.zeros(0)
        # No place can be worth more than all that is wanted around it.
        for begin in range(0, len(cells), _CHUNK):
            if bound[begin] * discount[begin] <= utility.max(initial=0.0):
                break
            counted = sight.gains(scenery, cells[begin : begin + _CHUNK]) * survey.cell_area
            gains = np.concatenate([gains, counted])
            utility = np.where(gains >= least, gains * discount[: len(gains)], 0.0)
        places = survey.geometry.cell_center(cells[: len(gains)])
        if not utility.any():
            return Choice(goal=None, gain=0.0, places=places, gains=gains)
        best = int(utility.argmax())
        goal = Pose2D(*places[best].tolist())
        return Choice(goal=goal, gain=float(gains[best]), places=places, gains=gains)

    def note_look(self, survey: Survey) -> None:
        """The robot has turned around where it is: what should have been seen was looked for."""
        cell = survey.cell_of(survey.robot)
        if not survey.geometry.contains(cell):
            return
        looks = self._looks_in(survey.geometry)
        missed = np.argwhere(sight.seen_from(survey.scenery, cell))
        away = np.hypot(*(missed - cell).T) * survey.geometry.resolution
        looks[tuple(missed.T)] += np.where(away < NEAR_LOOK, 2, 1).astype(np.int16)

    def give_up(self, goal: Pose2D) -> None:
        """Do not choose a place, nor those right beside it, any more."""
        self.given_up.append(goal)

    def forget(self) -> None:
        """The map was begun anew."""
        self._looks_geometry, self.given_up = None, []

    def _are_given_up(self, geometry: Geometry, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        result = np.zeros(len(cells), np.bool_)
        places = geometry.cell_center(cells)
        for place in self.given_up:
            result |= np.hypot(places[:, 0] - place.x, places[:, 1] - place.y) < GIVEN_UP_RADIUS
        return result

    def _looks_in(self, geometry: Geometry) -> NDArray[np.int16]:
        """(rows, columns) int16: looks in vain, for the cells of a map; kept as they are."""
        before = self._looks_geometry
        if before == geometry:
            return self._looks
        looks = np.zeros(geometry.shape, np.int16)
        if before is not None and before.resolution == geometry.resolution:
            corner = np.array(before.origin) + 0.5 * before.resolution
            iy, ix = (int(n) for n in geometry.cell_at(corner))
            rows, columns = before.shape
            y = slice(max(iy, 0), max(min(iy + rows, geometry.shape[0]), 0))
            x = slice(max(ix, 0), max(min(ix + columns, geometry.shape[1]), 0))
            looks[y, x] = self._looks[y.start - iy : y.stop - iy, x.start - ix : x.stop - ix]
        self._looks, self._looks_geometry = looks, replace(geometry)
        return looks
