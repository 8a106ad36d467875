# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a map and where the robot is to a `Survey`: costs of ways, and the unknown that matters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.exploration import frontiers
from heightmap25d_ros.exploration.doubtful_obstacles import doubtful
from heightmap25d_ros.exploration.looks import Looks
from heightmap25d_ros.exploration.sight import Scenery
from heightmap25d_ros.exploration.survey import LEVEL, Survey
from heightmap25d_ros.exploration.travel_costs import travel_costs, travel_costs_over_levels
from heightmap25d_ros.exploration.unseen_decks import deck_edges
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
        Whether obstacles that may be noise are as good as unknown; on maps of one level.
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
        return self._in_doubt(survey, height_map) if self.is_doubting else survey

    def _in_doubt(self, survey: Survey, height_map: HeightMap) -> Survey:
        """The same, with what lies behind ground that the robot might come to after all.

        Obstacles that may be noise are unknown, and all ground that goes on from where the robot
        can be counts as touched, as far as the robot sees.
        """
        own, side = self._params.exploration, survey.geometry.resolution
        doubted = doubtful(survey.occupied, height_map, self._params.traversability.max_step)
        known, occupied = survey.scenery.known & ~doubted, survey.occupied & ~doubted
        near = frontiers.touched(known, occupied, np.isfinite(survey.costs), own.sight / side)
        looks = self._looks.of(survey.geometry)
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
        own, geometry = self._params.exploration, survey.geometry
        edges = deck_edges(
            layer,
            survey.scenery.height,
            np.isfinite(survey.costs),
            depth=own.frontier_depth / geometry.resolution,
            clear_height=self._params.levels.clear_height,
            max_step=self._params.traversability.max_step,
        )
        if edges is None:
            return None
        known = survey.scenery.known & ~edges.beyond
        looks = self._looks.of(geometry, edges.height)
        allowed = edges.beyond & self.inside(geometry)
        costs = np.where(edges.deck, survey.costs, np.inf)
        closed = survey.occupied & ~edges.rim
        wanted, fresh = self._wanted(known, closed, costs, allowed, looks, geometry)
        scenery = replace(survey.scenery, height=edges.height, known=known, wanted=wanted)
        nothing = np.zeros(known.shape, np.bool_)
        return replace(
            survey, costs=costs, scenery=scenery, counted=nothing, fresh=fresh, certain=wanted
        )

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
        wanted, fresh = self._wanted(known, graph.occupied, costs, is_inside, looks, geometry)
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
        occupied: Mask,
        costs: NDArray[np.float64],
        allowed: Mask,
        looks: NDArray[np.int16],
        geometry: Geometry,
    ) -> tuple[Mask, Mask]:
        """What matters of the unknown where it is allowed; and the same by what was never missed.

        Parameters
        ----------
        known, occupied : (rows, columns) bool
        costs : (rows, columns) float64 [m]
        allowed : (rows, columns) bool
        looks : (rows, columns) int16
            In vain.
        geometry : Geometry
        """
        own, side = self._params.exploration, geometry.resolution
        margin = self._params.traversability.robot_radius + self._params.planner.unknown_margin
        touched = frontiers.touched(known, occupied, np.isfinite(costs), margin / side)
        depth = own.frontier_depth / side
        wanted = frontiers.wanted(known, touched, allowed & (looks < own.looks), depth)
        is_missed = wanted & (looks > 0)
        if not is_missed.any():
            return wanted, wanted
        return wanted, frontiers.wanted(known, touched, wanted & ~is_missed, depth)


def _without_wanted_of(survey: Survey, before: list[Survey]) -> Survey:
    """A survey of a slice, without what is wanted in other slices on the same level."""
    free = np.ones(survey.geometry.shape, np.bool_)
    for other in before:
        is_same = np.abs(other.scenery.height - survey.scenery.height) < LEVEL
        free &= ~(other.scenery.wanted & is_same)
    return survey.restricted(free)
