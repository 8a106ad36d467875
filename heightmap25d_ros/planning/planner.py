# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a start to a goal: a path that the robot can drive, or the reason why there is none.

`Planner` combines the other modules of this room: it clears the start, searches, smooths the
cells into a path, checks the rectangle along it, and puts it on the surface.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import Area, Cell
from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.planning import collision, search
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.plan import Plan, Pose2D, Status, in_cells
from heightmap25d_ros.planning.search import STRAIGHT, CostToGo, SearchTimeoutError
from heightmap25d_ros.planning.smoothing import (
    SPACING,
    headings,
    round_corners,
    sampled,
    string_pull,
    swept,
)
from heightmap25d_ros.planning.start_clearing import clear_start, offsets
from heightmap25d_ros.planning.surface_poses import interpolated, on_surface

_ATTEMPTS = 40
"""Number of paths that are tried until the rectangle fits along one."""


class Planner:
    """Plans over the terrain of one map.

    Parameters
    ----------
    graph : TransitionGraph
    terrain : TraversabilityParams
    params : PlannerParams

    Examples
    --------
    Across level ground of 6 m by 6 m:

    >>> from heightmap25d_ros.grid.height_map import Geometry, HeightMap
    >>> from heightmap25d_ros.planning.graph import transition_graph
    >>> plain = HeightMap(
    ...     geometry=Geometry(resolution=0.125, origin=(0.0, 0.0), shape=(48, 48)),
    ...     height=np.zeros((48, 48), np.int16),
    ...     probability=np.full((48, 48), 65535, np.uint16),
    ...     probability_threshold=0.5,
    ... )
    >>> terrain, params = TraversabilityParams(), PlannerParams(timeout=60.0)
    >>> planner = Planner(transition_graph(plain, terrain, params), terrain, params)
    >>> plan = planner.plan(Pose2D(1.0, 1.0), Pose2D(5.0, 4.0), is_robot_there=False)
    >>> plan.found, round(plan.length, 2)
    (True, 5.0)
    >>> planner.plan(Pose2D(1.0, 1.0), Pose2D(9.0, 4.0), is_robot_there=False).reason
    'the goal is outside of the map'
    """

    def __init__(
        self, graph: TransitionGraph, terrain: TraversabilityParams, params: PlannerParams
    ) -> None:
        self.graph = graph
        self._terrain = terrain
        self._params = params
        self._resolution = graph.geometry.resolution

    def plan(
        self, start: Pose2D, goal: Pose2D, *, is_robot_there: bool, is_field_wanted: bool = False
    ) -> Plan:
        """A path from a start to a goal, or the reason why there is none.

        Parameters
        ----------
        start, goal : Pose2D
        is_robot_there : bool
            Whether the robot is at the start: then obstacles of the map under its rectangle are
            noise. Unknown cells there are ground in any case.
        is_field_wanted : bool
            Whether the plan contains the whole cost-to-go field; otherwise the search is A*.
        """
        began = time.monotonic()
        try:
            plan = self._plan(start, goal, is_robot_there, is_field_wanted, began)
        except SearchTimeoutError:
            seconds = f"{self._params.timeout:g} s"
            plan = Plan(status=Status.TIMEOUT, reason=f"no path was found within {seconds}")
        return replace(plan, seconds=time.monotonic() - began)

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
        robot_cell = _cell(geometry.cell_at((robot.x, robot.y)))
        points = (poses[:, 1::-1, 3] - geometry.origin[::-1]) / geometry.resolution
        if not geometry.contains(np.floor([*points, robot_cell])).all():
            return None
        graph = self._cleared(robot, is_robot_there=True)
        costs = [graph.line_cost(p, q) for p, q in pairwise(points)]
        heading = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
        first = _cell(np.floor(points[0]))
        if min(costs, default=0.0) < 0.0 or self._overlap(graph, points, heading, first):
            return None
        return sum(costs) * geometry.resolution

    def _plan(
        self, start: Pose2D, goal: Pose2D, is_robot_there: bool, is_field_wanted: bool, began: float
    ) -> Plan:
        geometry = self.graph.geometry
        start_cell, goal_cell = (_cell(geometry.cell_at((p.x, p.y))) for p in (start, goal))
        for cell, name in ((start_cell, "start"), (goal_cell, "goal")):
            if not geometry.contains(cell):
                status = Status[f"{name.upper()}_OUTSIDE_MAP"]
                return Plan(status=status, reason=f"the {name} is outside of the map")
        graph = self._cleared(start, is_robot_there)
        if not graph.enterable[start_cell]:
            problem = self._problem(graph, start_cell)
            return Plan(status=Status.START_OCCUPIED, reason=f"the start {problem}")
        deadline = began + self._params.timeout
        requested_cell = goal_cell
        for _ in range(_ATTEMPTS):
            cost_to_go, cells = self._searched(
                graph, start_cell, goal_cell, deadline, is_field_wanted
            )
            if not len(cells):
                nearest = self._nearest(graph, start_cell, goal, deadline)
                if nearest is None or nearest == goal_cell:
                    return self._refused(self.graph, graph, requested_cell)
                goal_cell = nearest
                continue
            end = goal if goal_cell == requested_cell else self._center(goal_cell, goal.yaw)
            points = self._points(graph, cost_to_go, cells, start, end)
            heading = headings(points, start.yaw, end.yaw)
            overlap = self._overlap(graph, points, heading, start_cell)
            if overlap is None:
                return self._result(graph, cost_to_go, points, heading, start_cell, goal, end)
            graph = _without(graph, overlap)
        return Plan(
            status=Status.NO_VALID_PATH,
            reason=f"the robot's rectangle fits along none of {_ATTEMPTS} paths",
        )

    def _searched(
        self, graph: TransitionGraph, start: Cell, goal: Cell, deadline: float, is_whole: bool
    ) -> tuple[CostToGo, NDArray[np.int64]]:
        cost_to_go = search.cost_to_go(
            graph.incoming, goal, start=None if is_whole else start, deadline=deadline
        )
        if time.monotonic() > deadline:  # a small map is searched within one slice
            raise SearchTimeoutError
        return cost_to_go, cost_to_go.cheapest_path(start)

    def _cleared(self, start: Pose2D, is_robot_there: bool) -> TransitionGraph:
        return clear_start(
            self.graph, start, self._terrain, self._params, is_robot_there=is_robot_there
        )

    def _center(self, cell: Cell, yaw: float | None) -> Pose2D:
        x, y = self.graph.geometry.cell_center(cell)
        return Pose2D(x=float(x), y=float(y), yaw=yaw)

    def _nearest(
        self, graph: TransitionGraph, start: Cell, goal: Pose2D, deadline: float
    ) -> Cell | None:
        """The cell nearest to a goal, within the tolerance, that is connected with the start."""
        if not self._params.goal_tolerance:
            return None
        # Every transition can be driven in both directions, at different costs.
        connected = search.cost_to_go(graph.incoming, start, deadline=deadline)
        reach = math.ceil(self._params.goal_tolerance / self._resolution) + 1
        cell = _cell(graph.geometry.cell_at((goal.x, goal.y)))
        area = Area(cell[0], cell[1], 1, 1).grown(reach).within(graph.area)
        *_, distance = offsets(area, *in_cells(goal, graph.geometry))
        is_candidate = connected.remaining[1:-1, 1:-1][area.slices(graph.area)] != 0
        is_candidate &= distance * self._resolution <= self._params.goal_tolerance
        if not is_candidate.any():
            return None
        iy, ix = np.unravel_index(np.where(is_candidate, distance, np.inf).argmin(), area.shape)
        return int(iy) + area.iy, int(ix) + area.ix

    def _refused(self, original: TransitionGraph, graph: TransitionGraph, goal: Cell) -> Plan:
        if not original.enterable[goal]:
            problem = self._problem(original, goal)
            return Plan(status=Status.GOAL_OCCUPIED, reason=f"the goal {problem}")
        if not graph.enterable[goal]:
            reason = "the robot's rectangle does not fit at the goal"
            return Plan(status=Status.GOAL_OCCUPIED, reason=reason)
        reason = "no drivable path connects start and goal"
        return Plan(status=Status.NO_VALID_PATH, reason=reason)

    def _problem(self, graph: TransitionGraph, cell: Cell) -> str:
        """Why a cell cannot contain the robot's centre."""
        if graph.forbidden[cell]:
            return "is on unknown ground"
        if graph.occupied[cell]:
            return "is on an obstacle: a step or a slope that is too high"
        reach = math.ceil(self._terrain.robot_radius / self._resolution) + 1
        area = Area(cell[0], cell[1], 1, 1).grown(reach).within(graph.area)
        near = graph.occupied[area.slices(graph.area)]
        iy, ix = np.nonzero(near)
        distance = np.hypot(iy + area.iy - cell[0], ix + area.ix - cell[1]) * self._resolution
        if len(distance) and distance.min() <= self._terrain.robot_radius + 1e-6:
            return f"is {distance.min():.2f} m from an obstacle: the robot does not fit there"
        return "is too near to unknown ground"

    def _points(
        self,
        graph: TransitionGraph,
        cost_to_go: CostToGo,
        cells: NDArray[np.int64],
        start: Pose2D,
        end: Pose2D,
    ) -> Array:
        """The path [cells] from the start pose to the end pose."""
        first, last = (np.array(in_cells(pose, graph.geometry)[:2]) for pose in (start, end))
        inner = list(string_pull(graph, cost_to_go, cells))
        # The ends lie beside the centres of their cells. Where a line from there is blocked, the
        # path leads over the centre.
        if len(cells) == 1:
            vertices = [first, last]
        else:
            head = [] if graph.line_cost(first, inner[1]) >= 0.0 else [inner[0]]
            tail = [] if graph.line_cost(inner[-2], last) >= 0.0 else [inner[-1]]
            vertices = [first, *head, *inner[1:-1], *tail, last]
            if len(vertices) == 2 and graph.line_cost(first, last) < 0.0:
                vertices = [first, inner[0], inner[-1], last]
        return sampled(round_corners(graph, np.array(vertices)), SPACING / self._resolution)

    def _overlap(
        self, graph: TransitionGraph, points: Array, heading: Array, start: Cell
    ) -> Cell | None:
        """The cell of the first pose at which the rectangle does not fit.

        Poses in the start's cell are not checked.
        """
        poses = swept(points, heading)
        poses = poses[(np.floor(poses[:, :2]) != start).any(axis=1)]
        index = collision.first_overlap(
            graph.occupied,
            poses,
            self._params.robot_length / self._resolution,
            self._params.robot_width / self._resolution,
        )
        return None if index < 0 else _cell(np.floor(poses[index, :2]))

    def _result(
        self,
        graph: TransitionGraph,
        cost_to_go: CostToGo,
        points: Array,
        heading: Array,
        start_cell: Cell,
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
            cost=cost_to_go[start_cell] / STRAIGHT * self._resolution,
            graph=graph,
            cost_to_go=cost_to_go,
        )


def _cell(index: NDArray[np.float64] | NDArray[np.int64]) -> Cell:
    return int(index[0]), int(index[1])


def _without(graph: TransitionGraph, cell: Cell) -> TransitionGraph:
    """The graph with one cell closed."""
    return graph.with_part(Area(*cell, 1, 1), enterable=np.zeros((1, 1), np.bool_))
