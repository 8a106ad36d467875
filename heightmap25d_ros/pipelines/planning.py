# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, plans out: a goal is planned to, and planned to again where that is called for."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.io import decode
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.graph import transition_graph
from heightmap25d_ros.planning.plan import Plan, Pose2D, Status
from heightmap25d_ros.planning.planner import Planner
from heightmap25d_ros.planning.search import UNREACHABLE

MOTION = 0.3
"""How far the robot moves before the direction of its motion is looked at [m]."""

LEAST_GAIN = 0.5
"""What a cheaper path must save at least [m of flat ground]: costs are those of whole cells."""

AHEAD = 1.0
"""The best direction is that to the place so far along the best way [m]."""


def compile_kernels(params: Params) -> None:
    """Compile, or load from numba's cache, all that the first goal needs."""
    shape = (32, 32)
    flat = HeightMap(
        geometry=Geometry(resolution=params.grid.resolution, origin=(0.0, 0.0), shape=shape),
        height=np.zeros(shape, np.int16),
        probability=np.full(shape, 65535, np.uint16),
        probability_threshold=0.5,
    )
    terrain, free = params.traversability, replace(params.planner, unknown="cost", timeout=600.0)
    graph = transition_graph(flat, terrain, free)
    start, goal = (
        Pose2D(x=x, y=x, yaw=0.0) for x in np.array((5.1, 20.2)) * params.grid.resolution
    )
    for is_field_wanted in (False, True):
        Planner(graph, terrain, free).plan(
            start, goal, is_robot_there=True, is_field_wanted=is_field_wanted
        )


class Planning:
    """A goal, the map, and where the robot is; and the path that follows.

    ``take_goal`` always returns a plan. ``take_map`` and ``take_odometry`` return one where the
    path has to be replaced: an empty one where there is none any more. A goal whose way is closed
    stays, and is planned to again when the map changes; one that cannot be used at all does not.

    Parameters
    ----------
    params : Params

    Attributes
    ----------
    dropped : Counter of str
        How many messages were not used, by reason.
    """

    def __init__(self, params: Params) -> None:
        self.dropped: Counter[str] = Counter()
        self._params = params
        self._T_map_odom = np.eye(4)
        self._T_odom_base: se3.Matrix | None = None
        self._height_map: HeightMap | None = None
        self._planner: Planner | None = None
        self._goal: Pose2D | None = None
        self._plan: Plan | None = None
        self._moved_from = np.zeros(2)

    def take_map(self, message: Any) -> Plan | None:
        """Take a heightmap25d_msgs/HeightGrid in; a plan where the map asks for another one."""
        try:
            decode.require_frame(message.header, self._params.mapping.map_frame)
            height_map = decode.height_map(message)
        except InputError as error:
            self._drop("map", error)
            return None
        if self._height_map is not None and _is_same(self._height_map, height_map):
            return None
        self._height_map, self._planner = height_map, None
        return self._checked() if self._goal is not None and self._plan is not None else None

    def take_odometry(self, message: Any) -> Plan | None:
        """Take a nav_msgs/Odometry in; a plan where the robot has left the path."""
        try:
            odometry = decode.odometry(message)
        except InputError as error:
            self._drop("odometry", error)
            return None
        if odometry.child_frame_id != self._params.intake.base_frame:
            self.dropped[f"odometry: of {odometry.child_frame_id!r}"] += 1
            return None
        self._T_odom_base = odometry.T
        return self._followed() if self._goal is not None and self._plan is not None else None

    def take_correction(self, message: Any) -> None:
        """Take a geometry_msgs/PoseWithCovarianceStamped in: the pose of odom in the map."""
        try:
            decode.require_frame(message.header, self._params.mapping.map_frame)
            self._T_map_odom = decode.pose(message.pose.pose, "pose.pose")
        except InputError as error:
            self._drop("correction", error)

    def take_goal(self, message: Any) -> Plan:
        """Take a geometry_msgs/PoseStamped in, in place of the goal before; the plan to it."""
        self._goal = self._plan = None
        try:
            goal = self._place(message, "goal_pose")
        except _RefusedError as refused:
            return refused.plan
        if self._robot() is None:
            return Plan(status=Status.TF_ERROR, reason="no odometry has come yet")
        self._goal = goal
        return self._planned()

    def set_params(self, params: Params) -> Plan | None:
        """Go on with other parameters; a plan where they ask for another one."""
        self._params, self._planner = params, None
        return self._checked() if self._goal is not None and self._plan is not None else None

    def plan_between(self, start: Any, goal: Any, tolerance: float) -> Plan:
        """Plan from any pose to any pose (geometry_msgs/PoseStamped), whatever goal is set.

        Parameters
        ----------
        start, goal : geometry_msgs.msg.PoseStamped
        tolerance : float [m]
            In place of ``planner.goal_tolerance``, where it is more than 0.
        """
        try:
            places = self._place(start, "start"), self._place(goal, "goal")
        except _RefusedError as refused:
            return refused.plan
        params = self._params.planner
        if math.isfinite(tolerance) and tolerance > 0.0:
            params = replace(params, goal_tolerance=min(tolerance, 10.0))
        planner = Planner(self._route_planner().graph, self._params.traversability, params)
        return planner.plan(*places, is_robot_there=False)

    def _drop(self, kind: str, error: InputError) -> None:
        self.dropped[f"{kind}: bad {str(error).partition(':')[0]}"] += 1

    def _place(self, message: Any, field: str) -> Pose2D:
        if self._height_map is None:
            raise _RefusedError(Status.UNKNOWN, "no map has come yet")
        try:
            T = decode.pose_in(message, self._params.mapping.map_frame, field)
        except InputError as error:
            is_frame = "frame_id" in str(error)
            raise _RefusedError(
                Status.TF_ERROR if is_frame else Status.UNKNOWN, str(error)
            ) from None
        return _place_of(T)

    def _route_planner(self) -> Planner:
        """The planner over the newest map, which is converted when it is first needed."""
        if self._planner is None:
            assert self._height_map is not None
            terrain, params = self._params.traversability, self._params.planner
            graph = transition_graph(self._height_map, terrain, params)
            self._planner = Planner(graph, terrain, params)
        return self._planner

    def _robot(self) -> Pose2D | None:
        if self._T_odom_base is None:
            return None
        return _place_of(self._T_map_odom @ self._T_odom_base)

    def _planned(self) -> Plan:
        """Plan from where the robot is, and keep the plan."""
        plan = self._candidate()
        self._keep(plan)
        return plan

    def _candidate(self) -> Plan:
        robot = self._robot()
        assert robot is not None
        assert self._goal is not None
        try:
            return self._route_planner().plan(
                robot, self._goal, is_robot_there=True, is_field_wanted=True
            )
        except InputError as error:
            return Plan(status=Status.UNKNOWN, reason=str(error))

    def _keep(self, plan: Plan) -> None:
        robot = self._robot()
        assert robot is not None
        self._plan, self._moved_from = plan, np.array([robot.x, robot.y])

    def _checked(self) -> Plan | None:
        """After a change of the map: another plan where the path is closed or much too long."""
        assert self._plan is not None
        plan = self._candidate()
        if self._plan.status is not Status.NONE:
            is_replaced = plan.status is not self._plan.status
        else:
            cost = self._cost_ahead()
            share = 1.0 - self._params.planning.replan_gain
            is_replaced = cost is None or (
                plan.status is Status.NONE and plan.cost < share * cost - LEAST_GAIN
            )
        if is_replaced:
            self._keep(plan)
            return plan
        if plan.cost_to_go is not None:  # the path stays; the best direction is that of this map
            self._plan = replace(self._plan, graph=plan.graph, cost_to_go=plan.cost_to_go)
        return None

    def _cost_ahead(self) -> float | None:
        """Cost [m] of what is left of the path on the newest map; None where that is closed."""
        assert self._plan is not None
        robot = self._robot()
        assert robot is not None
        poses = self._plan.poses
        away = np.hypot(poses[:, 0, 3] - robot.x, poses[:, 1, 3] - robot.y)
        return self._route_planner().cost_along(poses[int(away.argmin()) :], robot)

    def _followed(self) -> Plan | None:
        """After a motion: another plan where it leads off the best direction (TRULLA's test).

        Where there was no plan, the robot may have come to where there is one.
        """
        assert self._plan is not None
        robot, goal = self._robot(), self._goal
        assert robot is not None
        assert goal is not None
        is_there = self._plan.status is Status.NONE
        away = math.hypot(robot.x - goal.x, robot.y - goal.y)
        if is_there and away <= self._params.planning.goal_reached:
            self._goal = None
            return None
        moved = np.array([robot.x, robot.y]) - self._moved_from
        if math.hypot(*moved) < MOTION:
            return None
        if not is_there:
            status = self._plan.status
            plan = self._planned()
            return plan if plan.status is not status else None
        best = self._best_direction(self._moved_from)
        self._moved_from = self._moved_from + moved
        if best is not None:
            angle = math.atan2(*moved[::-1]) - best
            if abs(math.remainder(angle, 2.0 * math.pi)) <= self._params.planning.replan_angle:
                return None
        return self._planned()

    def _best_direction(self, place: NDArray[np.float64]) -> float | None:
        """Heading [rad] of the best way from a place; None where no way leads on."""
        assert self._plan is not None
        field, graph = self._plan.cost_to_go, self._plan.graph
        assert field is not None
        assert graph is not None
        iy, ix = graph.geometry.cell_at(place)
        if not graph.geometry.contains((iy, ix)) or field[iy, ix] == UNREACHABLE:
            return None
        way = field.cheapest_path((int(iy), int(ix)))
        ahead = way[min(len(way) - 1, round(AHEAD / graph.geometry.resolution))]
        step = ahead - (iy, ix)
        return math.atan2(*step) if step.any() else None


class _RefusedError(Exception):
    """A pose cannot be used; ``plan`` says why."""

    def __init__(self, status: Status, reason: str) -> None:
        super().__init__(reason)
        self.plan = Plan(status=status, reason=reason)


def _place_of(T: se3.Matrix) -> Pose2D:
    return Pose2D(x=float(T[0, 3]), y=float(T[1, 3]), yaw=math.atan2(T[1, 0], T[0, 0]))


def _is_same(before: HeightMap, after: HeightMap) -> bool:
    """Whether two maps say the same of all cells."""
    return (
        before.geometry == after.geometry
        and np.array_equal(before.known, after.known)
        and np.array_equal(before.height[before.known], after.height[before.known])
    )
