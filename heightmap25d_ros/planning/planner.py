# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a start to a goal: a path that the robot can drive, or the reason why there is none.

`Planner` combines the other modules of this room: it clears the start, searches, smooths the
cells into a path, checks the rectangle along it, and puts it on the surface.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import Area, Cell, HeightMap
from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.planning import collision
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.kept_graph import KeptGraph
from heightmap25d_ros.planning.plan import Plan, Pose2D, Status, as_pose, in_cells
from heightmap25d_ros.planning.rectangle_check import (
    cell_to_close,
    first_blocked,
    fits_at,
    line_fits,
)
from heightmap25d_ros.planning.refusals import no_path, no_way_out
from heightmap25d_ros.planning.route import Route, cheapest_route, nearest_reachable
from heightmap25d_ros.planning.search import SearchTimeoutError, to_cell
from heightmap25d_ros.planning.smoothing import (
    SPACING,
    headings,
    path_points,
    round_corners,
    sampled,
)
from heightmap25d_ros.planning.start_clearing import (
    ClearedStart,
    clear_start,
    leaving_straight,
)
from heightmap25d_ros.planning.surface_poses import interpolated, on_surface
from heightmap25d_ros.terrain import slices

_ATTEMPTS = 40
"""Number of paths that are tried until the rectangle fits along one."""


@dataclass(frozen=True, slots=True)
class _Search:
    """What is asked for, and until when."""

    start: Pose2D
    goal: Pose2D
    start_cell: Cell
    goal_cell: Cell
    deadline: float
    is_field_wanted: bool


class Planner:
    """Plans over the terrain of one map.

    Parameters
    ----------
    graph : TransitionGraph
    terrain : TraversabilityParams, optional
    params : PlannerParams, optional

    Examples
    --------
    Over flat ground of 8 m x 4 m:

    >>> planner = Planner.from_height_map(HeightMap.from_metres(np.zeros((32, 64))))
    >>> plan = planner.plan(Pose2D(1.0, 2.0), Pose2D(7.0, 2.0))
    >>> round(plan.length, 2)
    6.0
    >>> planner.plan(Pose2D(1.0, 2.0), Pose2D(9.0, 2.0)).reason
    'the goal is outside of the map'
    """

    def __init__(
        self,
        graph: TransitionGraph,
        terrain: TraversabilityParams | None = None,
        params: PlannerParams | None = None,
    ) -> None:
        terrain, params = terrain or TraversabilityParams(), params or PlannerParams()
        self.graph = graph
        self._terrain = terrain
        self._params = params
        self._resolution = graph.geometry.resolution
        self._size = params.robot_length / self._resolution, params.robot_width / self._resolution

    @classmethod
    def from_height_map(
        cls,
        height_map: HeightMap,
        terrain: TraversabilityParams | None = None,
        params: PlannerParams | None = None,
    ) -> Planner:
        """A planner over a dense map.

        Raises
        ------
        InputError
            If the robot's radius is more than 100 cells.
        """
        terrain, params = terrain or TraversabilityParams(), params or PlannerParams()
        return cls(KeptGraph(terrain, params).of(height_map), terrain, params)

    def with_params(self, params: PlannerParams) -> Planner:
        """The same planner with another goal tolerance or timeout."""
        return Planner(self.graph, self._terrain, params)

    def plan(
        self,
        start: Pose2D | Sequence[float],
        goal: Pose2D | Sequence[float],
        *,
        is_robot_there: bool = False,
        is_field_wanted: bool = False,
    ) -> Plan:
        """A path from a start to a goal, or the reason why there is none.

        Parameters
        ----------
        start, goal : Pose2D
            (x, y) [m] or (x, y, yaw) [rad] are taken as well.
        is_robot_there : bool, optional
            Whether the robot is at the start: then obstacles of the map under its rectangle are
            noise. Unknown cells there are ground in any case.
        is_field_wanted : bool, optional
            Whether the plan contains the whole cost-to-go field; otherwise the search is A*.

        Raises
        ------
        ValueError
            If a pose is not one.
        """
        start, goal = as_pose("start", start), as_pose("goal", goal)
        return within_time(
            partial(self._plan, start, goal, is_robot_there, is_field_wanted), self._params.timeout
        )

    def cost_along(self, poses: NDArray[np.float64], robot: Pose2D) -> float | None:
        """The cost of driving along a path, for a robot at or beside its beginning.

        Parameters
        ----------
        poses : (N, 4, 4) float64 [m], map
        robot : Pose2D

        Returns
        -------
        float [m] or None
            In metres of flat open ground; None if the path is blocked, or the rectangle does not
            fit along it.
        """
        geometry = self.graph.geometry
        robot_cell = to_cell(geometry.cell_at((robot.x, robot.y)))
        points = (poses[:, 1::-1, 3] - geometry.origin[::-1]) / geometry.resolution
        if not geometry.contains(np.floor([*points, robot_cell])).all():
            return None
        cleared = self._cleared(robot, is_robot_there=True)
        costs = [cleared.leaving.line_cost(p, q) for p, q in pairwise(points)]
        heading = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
        if min(costs, default=0.0) < 0.0:
            return None
        if first_blocked(cleared.graph.occupied, points, heading, self._size) >= 0:
            return None
        return sum(costs) * geometry.resolution

    def _plan(
        self,
        start: Pose2D,
        goal: Pose2D,
        is_robot_there: bool,
        is_field_wanted: bool,
        deadline: float,
    ) -> Plan:
        geometry = self.graph.geometry
        start_cell, goal_cell = (to_cell(geometry.cell_at((p.x, p.y))) for p in (start, goal))
        for cell, name in ((start_cell, "start"), (goal_cell, "goal")):
            if not geometry.contains(cell):
                status = Status[f"{name.upper()}_OUTSIDE_MAP"]
                return Plan(status=status, reason=f"the {name} is outside of the map")
        cleared = self._cleared(start, is_robot_there)
        if not (cleared.graph.enterable[start_cell] or len(cleared.exits)):
            return no_way_out(cleared.graph, start_cell, self._terrain.robot_radius)
        asked = _Search(start, goal, start_cell, goal_cell, deadline, is_field_wanted)
        # A robot that needs not turn into obstacles to leave is not told to.
        is_turn_checked = start.yaw is not None and not len(cleared.exits)
        is_turn_checked = is_turn_checked and fits_at(cleared.graph, start, self._size)
        plan, is_final = self._tried(asked, cleared, is_turn_checked=is_turn_checked)
        if plan.found or is_final or not is_turn_checked:
            return plan
        plan, _ = self._tried(asked, cleared, is_turn_checked=False)
        if not plan.found and is_robot_there:
            straight = leaving_straight(cleared, start, self._terrain, self._params)
            straight_on, _ = self._tried(asked, straight, is_turn_checked=False)
            return straight_on if straight_on.found else plan
        return plan

    def _tried(
        self, asked: _Search, cleared: ClearedStart, *, is_turn_checked: bool
    ) -> tuple[Plan, bool]:
        """A plan along one of the cheapest paths, and whether it was the first one."""
        start, goal, goal_cell = asked.start, asked.goal, asked.goal_cell
        original = cleared.graph
        for _ in range(_ATTEMPTS):
            route = cheapest_route(
                cleared, asked.start_cell, goal_cell, asked.deadline, asked.is_field_wanted
            )
            if route is None:
                nearest = nearest_reachable(
                    cleared, asked.start_cell, goal, self._params.goal_tolerance, asked.deadline
                )
                if nearest is None or nearest == goal_cell:
                    radius = self._terrain.robot_radius
                    refusal = no_path(self.graph, cleared.graph, asked.goal_cell, radius)
                    return refusal, cleared.graph is original
                goal_cell = nearest
                continue
            end = goal if goal_cell == asked.goal_cell else self._center(goal_cell, goal.yaw)
            for is_careful in (False, True):
                points = self._points(cleared.graph, route, start, end, is_careful=is_careful)
                heading = headings(points, start.yaw, end.yaw)
                overlap = cell_to_close(
                    cleared.graph, points, heading, self._size, end, is_turn_checked=is_turn_checked
                )
                if overlap is None:
                    break
            if overlap is None:
                return self._result(cleared.leaving, route, points, heading, goal, end), True
            if overlap == asked.start_cell != goal_cell:
                radius = self._terrain.robot_radius
                return no_way_out(cleared.graph, asked.start_cell, radius), False
            cleared = replace(cleared, graph=_without(cleared.graph, overlap))
        reason = f"the robot's rectangle fits along none of {_ATTEMPTS} paths"
        return Plan(status=Status.NO_VALID_PATH, reason=reason), False

    def _cleared(self, start: Pose2D, is_robot_there: bool) -> ClearedStart:
        return clear_start(
            self.graph, start, self._terrain, self._params, is_robot_there=is_robot_there
        )

    def _center(self, cell: Cell, yaw: float | None) -> Pose2D:
        x, y = self.graph.geometry.cell_center(cell)
        return Pose2D(x=float(x), y=float(y), yaw=yaw)

    def _points(
        self, graph: TransitionGraph, route: Route, start: Pose2D, end: Pose2D, *, is_careful: bool
    ) -> Array:
        """The path [cells] from the start pose to the end pose.

        A careful one keeps to the cells where the rectangle does not fit along a straight line,
        and turns on the spot.
        """
        first, last = (np.array(in_cells(pose, graph.geometry)[:2]) for pose in (start, end))
        ends = route.cells[0] + 0.5 if route.is_exit else first, last
        if is_careful:
            fits = partial(line_fits, graph, self._size)
            points = path_points(graph, route.cost_to_go, route.cells, ends, fits)
        else:
            points = path_points(graph, route.cost_to_go, route.cells, ends)
            points = round_corners(graph, points)
        if route.is_exit:
            points = np.vstack([first, points])
        return sampled(points, SPACING / self._resolution)

    def _result(
        self,
        graph: TransitionGraph,
        route: Route,
        points: Array,
        heading: Array,
        goal: Pose2D,
        end: Pose2D,
    ) -> Plan:
        half_length = round(self._params.robot_length / (2 * SPACING))
        poses = on_surface(graph, points, heading, half_length)
        steps = np.diff(poses[:, :3, 3], axis=0)
        gradient = interpolated(graph.gradient, points)
        reach = collision.FARTHEST / self._resolution
        clearance = collision.least_clearance(graph.occupied, points, reach)
        reason = ""
        if end is not goal:
            away = math.hypot(end.x - goal.x, end.y - goal.y)
            reason = f"ends {away:.2f} m from the goal, which cannot be reached"
        return Plan(
            status=Status.NONE,
            reason=reason,
            poses=poses,
            length=float(np.linalg.norm(steps, axis=1).sum()),
            climb=float(np.maximum(steps[:, 2], 0.0).sum()),
            steepest_slope=float(np.arctan(np.hypot(*gradient).max())),
            least_clearance=clearance * self._resolution if clearance < reach else math.inf,
            cost=route.cost * self._resolution,
            graph=graph,
            cost_to_go=route.cost_to_go,
        )


def _without(graph: TransitionGraph, cell: Cell) -> TransitionGraph:
    """The graph with one cell closed."""
    return graph.with_part(Area(*cell, 1, 1), enterable=np.zeros((1, 1), np.bool_))


def within_time(search: Callable[[float], Plan], timeout: float) -> Plan:
    """The plan of a search that is told its deadline (`time.monotonic`), with the time it took.

    Where it takes longer than a timeout [s], a refusal.
    """
    compile_kernels()  # not in the time of the plan
    began = time.monotonic()
    try:
        plan = search(began + timeout)
    except SearchTimeoutError:
        reason = f"no path was found within {timeout:g} s"
        plan = Plan(status=Status.TIMEOUT, reason=reason)
    return replace(plan, seconds=time.monotonic() - began)


@cache
def compile_kernels() -> None:
    """Compile, or load from numba's cache, all that a plan needs."""
    slices.compile_kernels()
    heights = np.zeros((32, 32))
    heights[10, :16] = 1.0  # a wall, with its near side under the robot at the second start
    planner = Planner.from_height_map(HeightMap.from_metres(heights))
    goal = Pose2D(3.0, 3.0, yaw=0.0)
    for start in (Pose2D(3.0, 1.0, yaw=0.0), Pose2D(1.0, 1.0, yaw=0.0)):
        for is_field_wanted in (False, True):
            planner._plan(start, goal, True, is_field_wanted, math.inf)
