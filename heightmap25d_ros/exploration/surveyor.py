# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a map and where the robot is to a `Survey`: costs of ways, and the unknown that matters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.exploration import frontiers
from heightmap25d_ros.exploration.doubtful_obstacles import doubtful
from heightmap25d_ros.exploration.looks import RISE, Looks
from heightmap25d_ros.exploration.sight import Scenery
from heightmap25d_ros.exploration.survey import LEVEL, Survey
from heightmap25d_ros.exploration.travel_costs import travel_costs, travel_costs_over_levels
from heightmap25d_ros.exploration.unseen_decks import Edges, decks, edges
from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.boundary import Boundary
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.kept_graph import KeptGraphs
from heightmap25d_ros.planning.level_graph import LevelGraph
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.planning.search import to_cell
from heightmap25d_ros.terrain.slices import LevelFollower

Mask = NDArray[np.bool_]


class Surveyor:
    """Looks over one map after the other.

    Parameters
    ----------
    params : Params
    boundary : Boundary
    looks : Looks
        What was looked for in vain is not wanted.

    Attributes
    ----------
    is_doubting : bool
        Whether obstacles that may be noise are as good as unknown; and what is beyond edges, and
        what was looked for in vain from below.
    """

    def __init__(self, params: Params, boundary: Boundary, looks: Looks) -> None:
        self._params, self._boundary, self._looks = params, boundary, looks
        self._graphs = KeptGraphs(
            params.traversability, params.planner, boundary, params.exploration.frontier_depth
        )
        self._level = LevelFollower()
        self.is_doubting = False
        self._inside: tuple[Geometry, Mask] | None = None

    def survey(self, height_map: HeightMap, robot: Pose2D) -> Survey:
        """What a map offers to a robot; see `Explorer.survey`."""
        if len(height_map.upper):
            return self._survey_of_levels(height_map, robot)
        graph, geometry = self._graphs.of(0, height_map), height_map.geometry
        is_there = geometry.contains(geometry.cell_at((robot.x, robot.y)))
        costs = (
            travel_costs(graph, robot, self._params)
            if is_there
            else np.full(geometry.shape, np.inf)
        )
        survey = self._offered(graph, height_map.known, costs, robot, is_one_level=True)
        if not self.is_doubting:
            return survey
        doubted = self._in_doubt(survey, height_map, self._looks.of(geometry))
        no_decks = np.zeros(height_map.geometry.shape, np.bool_)
        beyond = self._beyond_edges(survey, [doubted], no_decks)
        return _with_others([doubted, *beyond, *self._missed(survey)])

    def _in_doubt(self, survey: Survey, height_map: HeightMap, looks: NDArray[np.int16]) -> Survey:
        """The same, with what lies behind ground that the robot might come to after all.

        Obstacles that may be noise are unknown, and all ground that goes on from where the robot
        can be counts as touched, as far as the robot sees.

        Parameters
        ----------
        survey : Survey
            Of a slice.
        height_map : HeightMap
            Of the slice.
        looks : (rows, columns) int16
            In vain.
        """
        own, side = self._params.exploration, survey.geometry.resolution
        doubted = doubtful(survey.occupied, height_map, self._params.traversability.max_step)
        known, occupied = survey.scenery.known & ~doubted, survey.occupied & ~doubted
        near = frontiers.touched(known, occupied, np.isfinite(survey.costs), own.sight / side)
        allowed = self.inside(survey.geometry) & (looks < own.looks)
        behind = frontiers.wanted(known, near, allowed, own.frontier_depth / side)
        scenery = replace(survey.scenery, known=known, wanted=survey.scenery.wanted | behind)
        return replace(survey, scenery=scenery, occupied=occupied)

    def inside(self, geometry: Geometry) -> Mask:
        """(rows, columns): cells inside the boundary."""
        if self._inside is None or self._inside[0] != geometry:
            self._inside = geometry, self._boundary.mask(geometry)
        return self._inside[1]

    def _survey_of_levels(self, height_map: HeightMap, robot: Pose2D) -> Survey:
        terrain, planner = self._params.traversability, self._params.planner
        levels = LevelGraph(height_map, self._params.levels, terrain, planner, self._graphs.of)
        geometry = height_map.geometry
        surface = self._level.surface(levels.stack, robot.x, robot.y, robot.z or 0.0)
        costs, first = np.full((len(levels.graphs), *geometry.shape), np.inf), 0
        cell = to_cell(geometry.cell_at((robot.x, robot.y)))
        if geometry.contains(cell) and surface is not None:
            start = levels.holding((surface[0], *cell))
            first = start.slice
            costs = travel_costs_over_levels(levels, levels.graphs, start, robot, self._params)
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
            if self.is_doubting:
                looks = self._looks.of(geometry, survey.scenery.height)
                survey = self._in_doubt(survey, levels.maps[number], looks)
            before = [
                other.covered & (levels.layers[k] == levels.layers[number])
                for k, other in zip(order, surveys, strict=False)
            ]
            counted = ~np.any(before, axis=0) if before else survey.counted
            surveys.append(replace(_without_those(survey, surveys), counted=counted))
        for number, survey in zip(order, surveys.copy(), strict=True):
            surveys += self._beyond_edges(survey, surveys, decks(levels.layers[number]))
            surveys += self._missed(survey)
        return _with_others(surveys)

    def _missed(self, survey: Survey) -> list[Survey]:
        """What was looked for in vain only from below; and what only from afar.

        While obstacles are doubted.
        """
        if not self.is_doubting:
            return []
        geometry = survey.geometry
        from_below = self._missed_where(survey, self._looks.from_below(geometry))
        from_afar = self._missed_where(survey, self._looks.from_afar(geometry))
        return [*from_below, *(replace(one, is_missed=True) for one in from_afar)]

    def _missed_where(self, survey: Survey, is_excused: Mask) -> list[Survey]:
        """What was looked for in vain in some cells, for those who are high enough to see it."""
        if not is_excused.any():
            return []
        geometry, scenery = survey.geometry, survey.scenery
        looks = np.where(is_excused, np.int16(0), self._looks.of(geometry))
        touched = self._touched(scenery.known, survey.occupied, survey.costs, geometry)
        height, allowed = scenery.height.copy(), self.inside(geometry) & (looks == 0)
        depth = self._params.exploration.frontier_depth / geometry.resolution
        wanted = frontiers.wanted(scenery.known, touched, allowed, depth, height) & ~survey.fresh
        rise = _at_nearest(wanted, height) - scenery.height
        is_seen = rise <= scenery.sensor_height - RISE
        offered = replace(
            survey,
            costs=np.where(is_seen, survey.costs, np.inf),
            scenery=replace(scenery, height=height, wanted=wanted),
        )
        return [_besides(offered)] if wanted.any() else []

    def _beyond_edges(self, survey: Survey, before: list[Survey], decks: Mask) -> list[Survey]:
        """What a slice offers at edges of its decks, besides surveys before.

        While obstacles are doubted, at all edges: above drops, and below what the robot drives on.
        """
        if self._params.levels.max_surfaces == 1:
            return []
        scenery = survey.scenery
        ground = self._touched(scenery.known, survey.occupied, survey.costs, survey.geometry)
        if not self.is_doubting:
            sides = [(ground & decks, scenery.known, scenery.height)]
        else:
            sides = [(ground, scenery.known, scenery.height), (ground, ground, -scenery.height)]
        found: list[Survey] = []
        for side in sides:
            edges_there = edges(
                *side,
                depth=self._params.exploration.frontier_depth / survey.geometry.resolution,
                clear_height=self._params.levels.clear_height,
                max_step=self._params.traversability.max_step,
            )
            if edges_there is not None:
                offered = self._offered_beyond(survey, edges_there)
                found.append(_without_those(offered, [*before, *found]))
        return found

    def _offered_beyond(self, survey: Survey, found: Edges) -> Survey:
        """What edges of a slice offer: to be seen from near, whatever was missed from afar.

        From there a few returns do not tell a deck from what is known already.
        """
        own, geometry, before = self._params.exploration, survey.geometry, survey.scenery
        known, height = before.known & ~found.beyond, before.height.copy()
        allowed, depth = self.inside(geometry), own.frontier_depth / geometry.resolution
        frontiers.wanted(known, found.ground, allowed, depth, height)
        looks = self._looks.of(geometry, height)
        wanted, _ = self._wanted(known, found.ground, allowed, looks, geometry)
        rise = np.abs(before.height - _at_nearest(found.ground, before.height))
        is_level = rise < self._params.levels.clear_height
        offered = replace(
            survey,
            costs=np.where(is_level, survey.costs, np.inf),
            scenery=replace(before, height=height, known=known, wanted=wanted),
            occupied=survey.occupied & ~found.ground & ~found.beyond,
        )
        return replace(_besides(offered), is_beyond_edges=True)

    def _offered(
        self,
        graph: TransitionGraph,
        known: Mask,
        costs: NDArray[np.float64],
        robot: Pose2D,
        *,
        is_one_level: bool,
    ) -> Survey:
        """What one graph, which may change afterwards, offers at costs [m] of the way to cells."""
        own, geometry = self._params.exploration, graph.geometry
        is_inside = self.inside(geometry)
        costs[~is_inside] = np.inf
        # Where no known cell is near nothing is wanted.
        height = np.where(np.isnan(graph.height), np.float32(0.0), graph.height)
        looks = self._looks.of(geometry, None if is_one_level else height)
        touched = self._touched(known, graph.occupied, costs, geometry)
        wanted, fresh = self._wanted(known, touched, is_inside, looks, geometry)
        scenery = Scenery(
            height=height,
            known=known,
            wanted=wanted,
            sensor_height=own.sensor_height,
            reach=own.sight / geometry.resolution,
            blind=own.blind_radius / geometry.resolution,
        )
        return Survey(
            geometry=geometry,
            robot=robot,
            costs=costs,
            scenery=scenery,
            occupied=graph.occupied.copy(),
            counted=np.ones(geometry.shape, np.bool_),
            fresh=fresh,
            certain=wanted,
        )

    def _wanted(
        self,
        known: Mask,
        touched: Mask,
        allowed: Mask,
        looks: NDArray[np.int16],
        geometry: Geometry,
    ) -> tuple[Mask, Mask]:
        """What matters of the unknown where it is allowed; and the same by what was never missed.

        Parameters
        ----------
        known, touched, allowed : (rows, columns) bool
            As of `frontiers.wanted`.
        looks : (rows, columns) int16
            In vain.
        geometry : Geometry
        """
        own = self._params.exploration
        depth = own.frontier_depth / geometry.resolution
        wanted = frontiers.wanted(known, touched, allowed & (looks < own.looks), depth)
        is_missed = wanted & (looks > 0)
        if not is_missed.any():
            return wanted, wanted
        return wanted, frontiers.wanted(known, touched, wanted & ~is_missed, depth)

    def _touched(
        self, known: Mask, occupied: Mask, costs: NDArray[np.float64], geometry: Geometry
    ) -> Mask:
        """The free cells that the robot touches."""
        margin = self._params.traversability.robot_radius + self._params.planner.unknown_margin
        return frontiers.touched(known, occupied, np.isfinite(costs), margin / geometry.resolution)


def _without_those(survey: Survey, before: list[Survey]) -> Survey:
    """A survey of a slice, without what others know, or want, on the same level."""
    free = np.ones(survey.geometry.shape, np.bool_)
    for other in before:
        is_same = np.abs(other.scenery.height - survey.scenery.height) < LEVEL
        free &= ~((other.scenery.known | other.scenery.wanted) & is_same)
    return survey.restricted(free)


def _at_nearest(cells: Mask, height: NDArray[np.float32]) -> NDArray[np.float32]:
    """(rows, columns) [m]: the height of that one of some cells that is nearest to each cell."""
    nearest = ndimage.distance_transform_edt(~cells, return_distances=False, return_indices=True)
    return np.asarray(height[tuple(nearest)])


def _besides(survey: Survey) -> Survey:
    """A survey that holds only what is wanted besides what a slice offers, to be seen from near.

    What was missed from afar counts all the same.
    """
    wanted, nothing = survey.scenery.wanted, np.zeros(survey.geometry.shape, np.bool_)
    return replace(survey, counted=nothing, fresh=wanted, certain=wanted).seen_from_near()


def _with_others(surveys: list[Survey]) -> Survey:
    return replace(surveys[0], others=tuple(surveys[1:]))
