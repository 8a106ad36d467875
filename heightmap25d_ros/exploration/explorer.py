# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where to look next.

A place is worth its *gain*, the unknown area that a full turn there is expected to show, less what
the way to it costs: ``gain * exp(-distance_weight * cost)``, as of next-best-view planning
(Bircher et al., 2016) over the frontiers of Yamauchi (1997). What was looked for and not seen,
below drop-offs or behind glass, is not wanted any more, so that the exploration ends.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.exploration import frontiers, sight
from heightmap25d_ros.exploration.boundary import Boundary, confined
from heightmap25d_ros.exploration.frontiers import Frontiers
from heightmap25d_ros.exploration.sight import Scenery
from heightmap25d_ros.exploration.tour import MOST, least_between, shortest_tour
from heightmap25d_ros.exploration.unseen_decks import deck_edges
from heightmap25d_ros.grid.height_map import Cell, Geometry, HeightMap
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.graph import TransitionGraph, transition_graph
from heightmap25d_ros.planning.level_graph import LevelGraph
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.planning.search import to_cell
from heightmap25d_ros.planning.start_clearing import clear_start
from heightmap25d_ros.terrain.slices import LevelFollower

NEAR_LOOK = 3.0
"""A look from within this distance counts twice [m]."""

GIVEN_UP_RADIUS = 0.6
"""Places so near to one that was given up are not goals either [m]."""

OPENING = 0.25
"""Of ``min_gain``: so much of a way to new ground must a place show, to be worth the way."""

LEDGE = 3.0
"""Known cells that are higher than the ground beside them by so many steps are no ground."""

LEVEL = 0.7
"""Heights that are farther apart are of different levels [m]."""

_SAME_Z = 0.3
"""Slices whose ground is as near to a place are both around it [m]."""

_CHUNK = 400
"""Places whose gains are predicted at a time, those that promise most first."""


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
    frontiers : Frontiers
    scenery : Scenery
        With what is wanted.
    occupied : (rows, columns) bool
    counted : (rows, columns) bool
        Cells whose surface no slice before this one holds.
    others : tuple of Survey
        Of the other slices.
    """

    geometry: Geometry
    robot: Pose2D
    costs: NDArray[np.float64]
    frontiers: Frontiers
    scenery: Scenery
    occupied: NDArray[np.bool_]
    counted: NDArray[np.bool_]
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
        return self.cell_area * sum(float(s.scenery.wanted.sum()) for s in self.slices)

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
        gains = [sight.gains(one.scenery, np.array([cell]))[0] for one in self.around(place)]
        return float(max(gains)) * self.cell_area


class _Compared(NamedTuple):
    """Places of one slice: cells (N, 2), places (N, 2) [m], gains [m^2] and utilities (N,)."""

    cells: NDArray[np.int64]
    places: Array
    gains: Array
    utility: Array


class _Stop(NamedTuple):
    """A place of a tour, the area [m^2] that it shows and no other does, and its cost [m]."""

    place: Pose2D
    gain: float
    cost: float


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
        self._looked_at = np.zeros((0, 0), np.float32)  # [m] height of the cells then
        self._level = LevelFollower()
        self._kept: tuple[HeightMap, TransitionGraph] | None = None
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
        if len(height_map.upper):
            return self._survey_of_levels(height_map, robot)
        terrain, planner = self._params.traversability, self._params.planner
        graph = confined(graph or self._graph_of(height_map), self._boundary)
        geometry = height_map.geometry
        cell = to_cell(geometry.cell_at((robot.x, robot.y)))
        costs = np.full(geometry.shape, np.inf)
        if geometry.contains(cell):
            cleared = clear_start(graph, robot, terrain, planner, is_robot_there=True)
            costs = frontiers.travel_costs(cleared, cell) * geometry.resolution
        return self._offered(graph, height_map.known, costs, robot, is_one_level=True)

    def _graph_of(self, height_map: HeightMap) -> TransitionGraph:
        """The graph of a map, which is kept until another map comes."""
        if self._kept is None or self._kept[0] is not height_map:
            terrain, planner = self._params.traversability, self._params.planner
            self._kept = height_map, transition_graph(height_map, terrain, planner)
        return self._kept[1]

    def _survey_of_levels(self, height_map: HeightMap, robot: Pose2D) -> Survey:
        terrain, planner = self._params.traversability, self._params.planner
        levels = LevelGraph(height_map, self._params.levels, terrain, planner)
        levels.graphs = [confined(graph, self._boundary) for graph in levels.graphs]
        geometry = height_map.geometry
        surface = self._level.surface(levels.stack, robot.x, robot.y, robot.z or 0.0)
        costs, first = np.full((len(levels.graphs), *geometry.shape), np.inf), 0
        cell = to_cell(geometry.cell_at((robot.x, robot.y)))
        if geometry.contains(cell) and surface is not None:
            start = levels.holding((surface[0], *cell))
            first = start.slice
            cleared = clear_start(
                levels.graphs[first], robot, terrain, planner, is_robot_there=True
            )
            costs = frontiers.travel_costs_over_levels(levels, levels.graphs, cleared, start)
            costs *= geometry.resolution
        surveys: list[Survey] = []
        order = [first, *(n for n in range(len(levels.graphs)) if n != first)]
        for number in order:
            survey = self._offered(
                levels.graphs[number],
                levels.layers[number] >= 0,
                costs[number],
                robot,
                is_one_level=False,
            )
            before = [
                other.covered & (levels.layers[k] == levels.layers[number])
                for k, other in zip(order, surveys, strict=False)
            ]
            counted = ~np.any(before, axis=0) if before else survey.counted
            surveys.append(replace(_without_wanted_of(survey, surveys), counted=counted))
        beyond = [
            self._beyond_decks(survey, levels.layers[number])
            for number, survey in zip(order, surveys, strict=True)
        ]
        others = *surveys[1:], *(survey for survey in beyond if survey is not None)
        return replace(surveys[0], others=others)

    def _beyond_decks(self, survey: Survey, layer: NDArray[np.int8]) -> Survey | None:
        """What a slice, of which each cell is in a layer, offers to one who is on its decks."""
        own, side = self._params.exploration, survey.geometry.resolution
        terrain = self._params.traversability
        depth = own.frontier_depth / side
        edges = deck_edges(
            layer,
            survey.scenery.height,
            np.isfinite(survey.costs),
            depth=depth,
            clear_height=self._params.levels.clear_height,
            max_step=terrain.max_step,
        )
        if edges is None:
            return None
        known = survey.scenery.known & ~edges.beyond
        looks = self._looks_in(survey.geometry, edges.height)
        allowed = edges.beyond & self._boundary.mask(survey.geometry) & (looks < own.looks)
        costs = np.where(edges.deck, survey.costs, np.inf)
        margin = terrain.robot_radius + self._params.planner.unknown_margin
        found = frontiers.find(
            known,
            survey.occupied & ~edges.rim,
            np.isfinite(costs),
            allowed,
            radius=margin / side,
            depth=depth,
        )
        scenery = replace(survey.scenery, height=edges.height, known=known, wanted=found.wanted)
        nothing = np.zeros(known.shape, np.bool_)
        return replace(survey, costs=costs, frontiers=found, scenery=scenery, counted=nothing)

    def _offered(
        self,
        graph: TransitionGraph,
        known: NDArray[np.bool_],
        costs: NDArray[np.float64],
        robot: Pose2D,
        *,
        is_one_level: bool,
    ) -> Survey:
        """What one graph offers, at costs [m] of the way to its cells."""
        terrain, own, geometry = (
            self._params.traversability,
            self._params.exploration,
            graph.geometry,
        )
        is_inside = self._boundary.mask(geometry)
        costs = np.where(is_inside, costs, np.inf)
        looks = self._looks_in(geometry, None if is_one_level else graph.height)
        margin = terrain.robot_radius + self._params.planner.unknown_margin
        found = frontiers.find(
            known,
            graph.occupied,
            np.isfinite(costs),
            is_inside & (looks < own.looks),
            radius=margin / geometry.resolution,
            depth=own.frontier_depth / geometry.resolution,
        )
        scenery = Scenery(
            height=graph.height,
            known=known,
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
            counted=np.ones(geometry.shape, np.bool_),
        )

    def choose(self, survey: Survey) -> Choice:
        """Where to go first, of the places that show at least ``min_gain``.

        Where there is none, of those from which ways to that much new ground are seen.
        """
        own = self._params.exploration
        choice = self._best(survey, own.min_gain)
        if choice.goal is not None:
            return choice
        opened = [_with_wanted(part, self._openings(part)) for part in survey.slices]
        if not any(part.scenery.wanted.any() for part in opened):
            return choice
        return self._best(replace(opened[0], others=tuple(opened[1:])), OPENING * own.min_gain)

    def _openings(self, survey: Survey) -> NDArray[np.bool_]:
        """Where the robot might come to ``min_gain`` of new ground."""
        own, side = self._params.exploration, survey.geometry.resolution
        looks = self._looks_in(survey.geometry, survey.scenery.height)
        allowed = self._boundary.mask(survey.geometry)
        allowed &= survey.scenery.known | (looks < own.looks)
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

    def _best(self, survey: Survey, least: float) -> Choice:
        """The first place of a tour of those, in all slices, that show at least so much [m^2]."""
        found = [self._compared(part, least) for part in survey.slices]
        places = np.concatenate([compared.places for compared in found])
        gains = np.concatenate([compared.gains for compared in found])
        stops = self._stops(survey, found, least)
        if not stops:
            return Choice(goal=None, gain=0.0, places=places, gains=gains)
        costs = np.array([stop.cost for stop in stops])
        at = np.array([(stop.place.x, stop.place.y, stop.place.z) for stop in stops])
        best = stops[shortest_tour(costs, least_between(costs, at))[0]]
        return Choice(goal=best.place, gain=best.gain, places=places, gains=gains)

    def _compared(self, survey: Survey, least: float) -> _Compared:
        """The places of one slice with the highest utilities, and what they show."""
        own, side, scenery = self._params.exploration, survey.geometry.resolution, survey.scenery
        reach = math.ceil(scenery.reach)
        cells = frontiers.viewpoints(np.isfinite(survey.costs), max(1, round(own.spacing / side)))
        cells = cells[~self._are_given_up(survey, cells)]
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
        cells = cells[: len(gains)]
        places = survey.geometry.cell_center(cells)
        return _Compared(cells=cells, places=places, gains=gains, utility=utility)

    def _stops(self, survey: Survey, found: Sequence[_Compared], least: float) -> list[_Stop]:
        """Places that together show most of what is wanted, the one with the highest utility first.

        Greedily: each shows at least so much [m^2] that none before it does.
        """
        weight = self._params.exploration.distance_weight
        stops: list[_Stop] = []
        left = [part.scenery.wanted.copy() for part in survey.slices]
        waiting = [
            (-float(compared.utility[n]), index, n)
            for index, compared in enumerate(found)
            for n in np.flatnonzero(compared.utility > 0.0)
        ]
        heapq.heapify(waiting)
        while waiting and len(stops) < MOST:
            promised, index, n = heapq.heappop(waiting)
            part, cell = survey.slices[index], to_cell(found[index].cells[n])
            seen = sight.seen_near(replace(part.scenery, wanted=left[index]), cell)
            gain, cost = len(seen) * part.cell_area, float(part.costs[cell])
            utility = gain * math.exp(-weight * cost)
            if gain < least:
                continue
            if waiting and utility < -waiting[0][0] and utility < -promised:
                heapq.heappush(waiting, (-utility, index, n))  # others have shown a part of it
                continue
            left[index][tuple(seen.T)] = False
            x, y = found[index].places[n].tolist()
            stops.append(_Stop(Pose2D(x, y, z=part.z_of(cell)), gain, cost))
        return stops

    def note_look(self, survey: Survey) -> None:
        """The robot has turned around where it is: what should have been seen was looked for."""
        cell = survey.cell_of(survey.robot)
        if not survey.geometry.contains(cell):
            return
        for one in survey.around(survey.robot):
            height = one.scenery.height
            looks = self._looks_in(survey.geometry, height if survey.others else None)
            missed = np.argwhere(sight.seen_from(one.scenery, cell))
            at = tuple(missed.T)
            away = np.hypot(*(missed - cell).T) * survey.geometry.resolution
            self._looks[at] = looks[at] + np.where(away < NEAR_LOOK, 2, 1).astype(np.int16)
            self._looked_at[at] = height[at]

    def give_up(self, goal: Pose2D) -> None:
        """Do not choose a place, nor those right beside it, any more."""
        self.given_up.append(goal)

    def forget(self) -> None:
        """The map was begun anew."""
        self._looks_geometry, self.given_up = None, []

    def _are_given_up(self, survey: Survey, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        result = np.zeros(len(cells), np.bool_)
        places = survey.geometry.cell_center(cells)
        z = survey.scenery.height[tuple(cells.T)] + survey.geometry.ground_zero
        for place in self.given_up:
            is_near = np.hypot(places[:, 0] - place.x, places[:, 1] - place.y) < GIVEN_UP_RADIUS
            is_same = not survey.others or place.z is None or np.abs(z - place.z) < LEVEL
            result |= is_near & is_same
        return result

    def _looks_in(
        self, geometry: Geometry, height: NDArray[np.float32] | None = None
    ) -> NDArray[np.int16]:
        """(rows, columns) int16: looks in vain, for the cells of a map; kept as they are.

        Those at other heights [m] do not count, if heights are given.
        """
        before = self._looks_geometry
        if before != geometry:
            self._looks, self._looked_at = (
                _moved(kept, before, geometry) for kept in (self._looks, self._looked_at)
            )
            self._looks_geometry = replace(geometry)
        if height is None:
            return self._looks
        return np.where(np.abs(self._looked_at - height) < LEVEL, self._looks, np.int16(0))


def _with_wanted(survey: Survey, wanted: NDArray[np.bool_]) -> Survey:
    """A survey in which only a part of what is wanted counts."""
    scenery = replace(survey.scenery, wanted=survey.scenery.wanted & wanted)
    return replace(survey, scenery=scenery)


def _without_wanted_of(survey: Survey, before: Sequence[Survey]) -> Survey:
    """A survey of a slice, without what is wanted in other slices on the same level."""
    free = np.ones(survey.geometry.shape, np.bool_)
    for other in before:
        is_same = np.abs(other.scenery.height - survey.scenery.height) < LEVEL
        free &= ~(other.scenery.wanted & is_same)
    return _with_wanted(survey, free)


def _moved(kept: NDArray[Any], before: Geometry | None, geometry: Geometry) -> NDArray[Any]:
    """An array of the cells of one geometry for those of another one; zeros elsewhere."""
    result = np.zeros(geometry.shape, kept.dtype)
    if before is not None and before.resolution == geometry.resolution:
        corner = np.array(before.origin) + 0.5 * before.resolution
        iy, ix = (int(n) for n in geometry.cell_at(corner))
        rows, columns = before.shape
        y = slice(max(iy, 0), max(min(iy + rows, geometry.shape[0]), 0))
        x = slice(max(ix, 0), max(min(ix + columns, geometry.shape[1]), 0))
        result[y, x] = kept[y.start - iy : y.stop - iy, x.start - ix : x.stop - ix]
    return result
