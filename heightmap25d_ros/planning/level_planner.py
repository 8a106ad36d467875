# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Paths over a map with several levels: under a bridge and over it, up a ramp to another deck.

`level_graph` tells through which slices of the map the cheapest path leads, and where it changes
from one to the next. The piece on each slice is planned by an ordinary `Planner`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import Cell, HeightMap
from heightmap25d_ros.params.sections import LevelsParams, PlannerParams, TraversabilityParams
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.level_graph import LevelGraph, Place
from heightmap25d_ros.planning.plan import Plan, Pose2D, Status, as_pose, joined
from heightmap25d_ros.planning.planner import Planner, within_time
from heightmap25d_ros.planning.refusals import no_path
from heightmap25d_ros.planning.search import STRAIGHT, CostToGo, to_cell
from heightmap25d_ros.planning.start_clearing import ClearedStart, clear_start

_SAME_LEVEL = 0.35
"""Height difference up to which a pose is on a surface [m]: z of a path is a mean over it."""


class LevelPlanner:
    """Plans over all levels of one map.

    Parameters
    ----------
    levels : LevelGraph
    terrain : TraversabilityParams, optional
    params : PlannerParams, optional
    """

    def __init__(
        self,
        levels: LevelGraph,
        terrain: TraversabilityParams | None = None,
        params: PlannerParams | None = None,
    ) -> None:
        self.levels = levels
        self._terrain, self._params = terrain or TraversabilityParams(), params or PlannerParams()
        self._planners = [Planner(graph, self._terrain, self._params) for graph in levels.graphs]

    def with_params(self, params: PlannerParams) -> LevelPlanner:
        """The same planner with another goal tolerance or timeout."""
        return LevelPlanner(self.levels, self._terrain, params)

    def plan(
        self,
        start: Pose2D | Sequence[float],
        goal: Pose2D | Sequence[float],
        *,
        is_robot_there: bool = False,
        is_field_wanted: bool = False,
    ) -> Plan:
        """A path from a start to a goal, each on the surface that is nearest to its z.

        Without a z the start is on the lowest surface, and the goal on the lowest one that can be
        reached. Otherwise as `Planner.plan`; the cost to go is that of the slice of the start.
        """
        start, goal = as_pose("start", start), as_pose("goal", goal)
        return within_time(
            partial(self._plan, start, goal, is_robot_there, is_field_wanted), self._params.timeout
        )

    def cost_along(self, poses: NDArray[np.float64], robot: Pose2D) -> float | None:
        """The cost of driving along a path over all levels, as of `Planner.cost_along`."""
        total, begin = 0.0, robot
        for index, piece in self._pieces(poses):
            cost = self._planners[index].cost_along(piece, begin)
            if cost is None:
                return None
            total += cost
            begin = Pose2D(float(piece[-1, 0, 3]), float(piece[-1, 1, 3]))
        return total

    def _plan(
        self,
        start: Pose2D,
        goal: Pose2D,
        is_robot_there: bool,
        is_field_wanted: bool,
        deadline: float,
    ) -> Plan:
        geometry = self.levels.stack.geometry
        first_cell, goal_cell = (to_cell(geometry.cell_at((p.x, p.y))) for p in (start, goal))
        is_inside = bool(geometry.contains([first_cell, goal_cell]).all())
        first = self.levels.holding(self._surface(start, first_cell)).slice if is_inside else 0
        if len(self._planners) == 1 or not is_inside:
            return self._planners[first].plan(
                start, goal, is_robot_there=is_robot_there, is_field_wanted=is_field_wanted
            )
        cleared = clear_start(
            self.levels.graphs[first], start, self._terrain, self._params,
            is_robot_there=is_robot_there,
        )  # fmt: skip
        graphs = list(self.levels.graphs)
        graphs[first] = cleared.graph
        refusal: Plan | None = None
        for layer, last in self._ends(goal, goal_cell):
            fields = self.levels.cost_to_go(last, graphs, deadline)
            begin = _beginning(fields[first], cleared, first_cell)
            places = [] if begin is None else self.levels.route(fields, Place(first, begin))
            if places:
                plan = self._along(places, start, goal, is_robot_there)
                if plan.found:
                    return replace(plan, graph=cleared.graph, cost_to_go=fields[first])
            else:
                plan = self._refused(start, goal, first, last, is_robot_there)
                if plan.found:  # ends near the goal
                    return plan
            refusal = refusal or self._with_level(plan, layer, goal_cell)
        reason = "the goal is on unknown ground: another level alone is known there"
        return refusal or Plan(status=Status.GOAL_OCCUPIED, reason=reason)

    def _ends(self, goal: Pose2D, cell: Cell) -> list[tuple[int, Place]]:
        """The layers on which a goal may be, those to be tried first first, and its places there.

        With a z it is on the level of the surface that is nearest to it, on which its own cell may
        be unknown. Nowhere if that cell is known to be of another level.
        """
        if goal.z is None:
            layers = self.levels.stack.layers_at(cell) or [0]
            return [(layer, self.levels.holding((layer, *cell))) for layer in layers]
        surface = self._surface(goal, cell)
        place = Place(self.levels.holding(surface).slice, cell)
        layer = int(self.levels.layers[place.slice][cell])
        z = self.levels.stack.z_of(surface)
        is_level = layer < 0 or self.levels.stack.is_on_level((layer, *cell), z)
        return [(surface[0], place)] if is_level else []

    def _surface(self, pose: Pose2D, cell: Cell) -> tuple[int, int, int]:
        """(layer, iy, ix) of the surface that is nearest to a pose."""
        return self.levels.stack.surface_at(pose.x, pose.y, pose.z) or (0, *cell)

    def _along(
        self, places: Sequence[Place], start: Pose2D, goal: Pose2D, is_robot_there: bool
    ) -> Plan:
        """The plan through places, each at the end of a piece; the goal is the last one."""
        geometry = self.levels.stack.geometry
        ends = [geometry.cell_center(place.cell) for place in places[:-1]]
        poses = [start, *(Pose2D(float(x), float(y)) for x, y in ends), goal]
        plans: list[Plan] = []
        for place, (begin, end) in zip(places, pairwise(poses), strict=True):
            is_first = not plans
            planner = self._planners[place.slice]
            plans.append(planner.plan(begin, end, is_robot_there=is_robot_there and is_first))
            if not plans[-1].found:
                return plans[-1]
        return joined(plans)

    def _refused(
        self, start: Pose2D, goal: Pose2D, first: int, last: Place, is_robot_there: bool
    ) -> Plan:
        """Why no path leads to a place, or one to near it where the start's slice holds it."""
        if self.levels.layers[first][last.cell] == self.levels.layers[last.slice][last.cell]:
            return self._planners[first].plan(start, goal, is_robot_there=is_robot_there)
        graph = self.levels.graphs[last.slice]
        return no_path(graph, graph, last.cell, self._terrain.robot_radius)

    def _with_level(self, plan: Plan, layer: int, cell: Cell) -> Plan:
        """A refusal that tells which level it is of, where there are several."""
        count = len(self.levels.stack.layers_at(cell))
        if count < 2:
            return plan
        return replace(plan, reason=f"{plan.reason} ({level_name(layer, count)})")

    def _pieces(self, poses: NDArray[np.float64]) -> Iterator[tuple[int, NDArray[np.float64]]]:
        """The parts of a path, each with a slice that holds it; neighbours share a pose.

        Where none holds the next pose, the part with it is blocked, in whatever slice it is.
        """
        first, index = 0, self._holding(poses[:1], 0)
        for number in range(1, len(poses)):
            if self._holds(index, poses[number]):
                continue
            following = self._holding(poses[number - 1 : number + 1], index)
            if following != index:
                yield index, poses[first:number]
                first, index = number - 1, following
        yield index, poses[first:]

    def _holding(self, poses: NDArray[np.float64], default: int) -> int:
        """A slice that holds some poses."""
        found = (
            i for i in range(len(self._planners)) if all(self._holds(i, pose) for pose in poses)
        )
        return next(found, default)

    def _holds(self, index: int, pose: NDArray[np.float64]) -> bool:
        """Whether a slice holds the surface of a pose, and the robot may be there."""
        graph = self.levels.graphs[index]
        cell = to_cell(graph.geometry.cell_at(pose[:2, 3]))
        if not graph.geometry.contains(cell):
            return False
        height = float(graph.height[cell]) + graph.geometry.ground_zero
        is_other = abs(height - pose[2, 3]) >= _SAME_LEVEL  # not where the height is unknown
        return bool(graph.enterable[cell]) and not is_other


def planner_over(
    height_map: HeightMap,
    levels: LevelsParams | None = None,
    terrain: TraversabilityParams | None = None,
    params: PlannerParams | None = None,
    graph_of: Callable[[int, HeightMap], TransitionGraph] | None = None,
) -> Planner | LevelPlanner:
    """The planner of a map, whether it has one level or several.

    Parameters
    ----------
    height_map : HeightMap
    levels : LevelsParams, optional
    terrain : TraversabilityParams, optional
    params : PlannerParams, optional
    graph_of : function, optional
        As of `LevelGraph`; a map of one level is its own slice.

    Raises
    ------
    InputError
        As of `LevelGraph`.
    """
    terrain, params = terrain or TraversabilityParams(), params or PlannerParams()
    if len(height_map.upper):
        return LevelPlanner(
            LevelGraph(height_map, levels, terrain, params, graph_of), terrain, params
        )
    if graph_of is None:
        return Planner.from_height_map(height_map, terrain, params)
    return Planner(graph_of(0, height_map), terrain, params)


def level_name(layer: int, count: int) -> str:
    """The name of a level among so many in one cell."""
    if count == 2:
        return "on the upper level" if layer else "on the lower level"
    return f"on level {layer + 1} of {count}"


def _beginning(field: CostToGo, cleared: ClearedStart, cell: Cell) -> Cell | None:
    """Where a path begins: at the start, or at the best exit from the inflation around it."""
    if cleared.graph.enterable[cell]:
        return cell
    if not len(cleared.exits):
        return None
    remaining = np.array([field[to_cell(exit_cell)] for exit_cell in cleared.exits])
    costs = np.where(remaining >= 0, cleared.costs + remaining / STRAIGHT, np.inf)
    return to_cell(cleared.exits[int((costs + cleared.penalties).argmin())])
