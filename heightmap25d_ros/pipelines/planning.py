# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, plans out: a goal is planned to, and again where map or motion call for it."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.grid.map_changes import changed_blocks
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.decode import Odometry
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.level_map import LevelMap
from heightmap25d_ros.pipelines.map_frames import MapFrames
from heightmap25d_ros.pipelines.mission import Mission, best_direction
from heightmap25d_ros.pipelines.path_requests import KeptPlanner, MapPlanner, PathRequest
from heightmap25d_ros.pipelines.silence import ODOMETRY, Silence
from heightmap25d_ros.pipelines.speed_limit import ahead_of, speed_share
from heightmap25d_ros.pipelines.transform_buffer import Missing
from heightmap25d_ros.planning.boundary import Boundary
from heightmap25d_ros.planning.level_planner import LevelPlanner
from heightmap25d_ros.planning.plan import Plan, Pose2D, Status, pose_2d
from heightmap25d_ros.planning.planner import Planner
from heightmap25d_ros.terrain.slices import LevelFollower

MOTION = 0.3
"""How far the robot moves before the direction of its motion is looked at [m]."""

LEAST_GAIN = 0.5
"""What a cheaper path must save at least [m of flat ground]: costs are those of whole cells."""


class Planning:
    """A goal, the map, and where the robot is; and the path that follows.

    `take_goal` always returns a plan. The other ``take_...`` return one where the path has to be
    replaced: an empty one where there is none any more. A goal that came before the first map or
    the first odometry is kept, and planned to when these come. One whose path is closed is kept and
    planned to again when the map changes; one that cannot be used at all is not.

    Parameters
    ----------
    params : Params

    Attributes
    ----------
    dropped : Drops
    """

    def __init__(self, params: Params) -> None:
        self.dropped = Drops()
        self._params = params
        self._frames = MapFrames(params, self.dropped)
        self._silence = Silence([ODOMETRY], params.intake.timeout)
        self._map = LevelMap(params.mapping.map_frame, self.dropped)
        self._level = LevelFollower()
        self._over_map: MapPlanner | None = None
        self._waiting_goal: Odometry | None = None
        self._mission: Mission | None = None
        self._boundary = Boundary.of([])
        self._kept = KeptPlanner(params, self._boundary)

    def take_map(self, message: Any) -> Plan | None:
        """Take a heightmap25d_msgs/HeightGrid; a plan where the map asks for another one."""
        height_map = self._map.take_lowest(message)
        return None if height_map is None else self.set_map(height_map)

    def take_map_update(self, message: Any) -> Plan | None:
        """Take a heightmap25d_msgs/HeightGrid with what has changed of the map; a plan as above."""
        height_map = self._map.take_update(message)
        return None if height_map is None else self.set_map(height_map)

    def take_upper_surfaces(self, message: Any) -> Plan | None:
        """Take what is above the next map, or above the one that has come; a plan as above."""
        height_map = self._map.take_upper(message)
        return None if height_map is None else self.set_map(height_map)

    def set_map(self, height_map: HeightMap) -> Plan | None:
        """Plan over a map from now on; a plan where it asks for another one."""
        if self._over_map is not None and _is_same(self._over_map.height_map, height_map):
            return None
        self._over_map = MapPlanner(height_map, self._kept)
        return self._began() if self._waiting_goal is not None else self._checked()

    def take_odometry(self, message: Any) -> Plan | None:
        """Take a pose of the robot, see `robot_pose`; a plan where the robot has left the path."""
        if not self._frames.take_odometry(message):
            return None
        self._silence.hear(ODOMETRY)
        return self._began() if self._waiting_goal is not None else self._followed()

    def pass_time(self, now_ns: int) -> None:
        """Let the time [ns] pass in which the odometry can fall silent, see `Silence`."""
        self._silence.pass_time(now_ns)

    @property
    def staleness(self) -> str:
        """Why the path is not looked after: nobody knows where the robot is; else empty."""
        is_followed = self._mission is not None and self._mission.plan.found
        return (
            f"the plan is stale: {self._silence.told}"
            if is_followed and self._silence.silent
            else ""
        )

    @property
    def trouble(self) -> str:
        """Why nobody should follow the plan, or ask for one; else empty."""
        problem = "" if self._over_map is None else self._over_map.problem
        return self.staleness or problem

    def take_correction(self, message: Any) -> None:
        """Take a geometry_msgs/PoseWithCovarianceStamped: the pose of odom in the map."""
        self._frames.take_correction(message)

    def take_boundary(self, message: Any) -> Plan | None:
        """Take a geometry_msgs/PolygonStamped, see `set_boundary`; empty: none."""
        frame = self._params.mapping.map_frame
        boundary = self.dropped.decoded(
            "boundary", lambda m: Boundary.of(decode.polygon(m, frame)), message
        )
        return None if boundary is None else self.set_boundary(boundary)

    def take_transforms(self, message: Any, *, is_static: bool) -> Plan | None:
        """Take a tf2_msgs/TFMessage of /tf or /tf_static; a plan where a goal waited for it."""
        self._frames.take_transforms(message, is_static=is_static)
        return self._began()

    def take_goal(self, message: Any) -> Plan:
        """Take a geometry_msgs/PoseStamped, in place of the goal before; the plan to it.

        It may be in any frame that odometry and transforms connect with the map: it is transformed
        at its stamp, for which it waits where that is still to come, and by the newest transforms
        where it is 0.
        """
        self._waiting_goal = self._mission = None
        try:
            return self.set_goal(_decoded(message, "goal_pose"))
        except _RefusedError as refused:
            return refused.plan

    def set_goal(self, goal: Odometry) -> Plan:
        """As `take_goal`, with the goal as the pose of a child frame of any name."""
        self._mission, self._waiting_goal = None, goal
        return self._began() or self._lacking()

    def set_boundary(self, boundary: Boundary) -> Plan | None:
        """Keep the robot's middle within a polygon; a plan where that asks for another one."""
        self._boundary = boundary
        return self._begun_anew()

    def set_params(self, params: Params) -> Plan | None:
        """Apply new parameters; a plan where they ask for another one."""
        self._params = params
        return self._begun_anew()

    def _begun_anew(self) -> Plan | None:
        """Convert the map anew; a plan where that asks for another one."""
        self._kept = KeptPlanner(self._params, self._boundary)
        if self._over_map is not None:
            self._over_map = MapPlanner(self._over_map.height_map, self._kept)
        return self._checked()

    def plan_between(self, start: Pose2D, goal: Pose2D, tolerance: float = 0.0) -> Plan:
        """Plan from any pose to any pose, whatever goal is set.

        Parameters
        ----------
        start, goal : Pose2D
            In the map.
        tolerance : float [m]
            In place of ``planner.goal_tolerance``, where it is more than 0.
        """
        if self._over_map is None:
            return self._lacking()
        params = self._params.planner
        if math.isfinite(tolerance) and tolerance > 0.0:
            params = replace(params, goal_tolerance=min(tolerance, 10.0))
        return PathRequest(over=self._over_map, start=start, goals=(goal,), params=params).plan()

    def answer(self, start: Any, goal: Any, tolerance: float) -> Plan:
        """`plan_between` of geometry_msgs/PoseStamped, as of nav_msgs/GetPlan."""
        try:
            poses = self._in_map(start, "start"), self._in_map(goal, "goal")
        except _RefusedError as refused:
            return refused.plan
        return self.plan_between(*poses, tolerance)

    def request(self, goals: Sequence[Any], start: Any | None = None) -> PathRequest | Plan:
        """A path through goals that somebody asks for, or why it cannot be planned.

        Parameters
        ----------
        goals : sequence of geometry_msgs/PoseStamped
            At least one.
        start : geometry_msgs/PoseStamped, optional
            By default where the robot is.
        """
        if self._over_map is None:
            return self._lacking()
        names = [f"goals[{i}]" for i in range(len(goals))] if len(goals) > 1 else ["goal"]
        try:
            place = self._robot_now() if start is None else self._in_map(start, "start")
            through = tuple(map(self._in_map, goals, names))
        except _RefusedError as refused:
            return refused.plan
        return PathRequest(
            over=self._over_map, start=place, goals=through, is_robot_there=start is None
        )

    def _robot_now(self) -> Pose2D:
        """Where the robot is; `_RefusedError` where nobody knows."""
        robot = self._robot()
        if robot is None or self._silence.silent:
            told = self._silence.told or "no odometry has come yet"
            raise _RefusedError(_without_transform("start", told))
        return robot

    def first_invalid(self, path: Any) -> int | None:
        """Index of the first pose of a nav_msgs/Path that the robot cannot drive to along it.

        From the pose that is nearest to the robot on, or from the first one where nobody knows
        where the robot is. None where the path is valid; 0 where that cannot be known.
        """
        poses = self.dropped.decoded("path", self._path_in_map, path)
        if poses is None or not len(poses) or self._over_map is None:
            return 0
        robot = self._robot() or pose_2d(poses[0])
        try:
            with self._over_map.planner() as planner:
                return _first_blocked(planner, poses, robot)
        except InputError:
            return 0

    def speed_share(self, plan: Plan) -> float:
        """The share of its full speed for a robot on a path, by `speed_limit`; 1 without one."""
        robot, ahead = self._robot(), self._params.planning.speed_limit_ahead
        if not (plan.found and ahead) or robot is None or self._over_map is None:
            return 1.0
        poses = ahead_of(plan.poses, _nearest(plan.poses, robot), ahead)
        return speed_share(poses, self._over_map.height_map, self._params)

    def _path_in_map(self, path: Any) -> NDArray[np.float64]:
        """(N, 4, 4) the poses of a nav_msgs/Path in the map, by the transform at its stamp."""
        frame = decode.frame_name(path.header.frame_id, "header.frame_id")
        origin = Odometry(
            stamp_ns=decode.stamp_ns(path.header), frame_id=frame, child_frame_id=frame, T=np.eye(4)
        )
        T = self._frames.in_map(origin)
        if isinstance(T, Missing):
            raise InputError(f"header: {self._frames.unconnected(origin, T)}")
        return np.asarray(T @ decode.path_poses(path))

    def _in_map(self, message: Any, field: str) -> Pose2D:
        """A PoseStamped in the map; `_RefusedError` says why there is none."""
        pose = _decoded(message, field)
        T = self._frames.in_map(pose)
        if isinstance(T, Missing):
            raise _RefusedError(_without_transform(field, self._frames.unconnected(pose, T)))
        return _place_2d(T, pose)

    def _lacking(self) -> Plan:
        """What is waited for, as a plan without a path."""
        goal = self._waiting_goal
        kept = "; the goal is kept" if goal is not None else ""
        if self._over_map is None:
            return Plan(status=Status.UNKNOWN, reason="no map has come yet" + kept)
        if self._robot() is None or goal is None:
            return Plan(status=Status.TF_ERROR, reason="no odometry has come yet" + kept)
        lacking = self._frames.unconnected(goal, Missing.NOT_YET)
        return _without_transform("goal_pose", lacking + kept)

    def _robot(self) -> Pose2D | None:
        """Where the robot is, at the z of its level as far as that is known."""
        T = self._frames.robot()
        if T is None:
            return None
        pose = pose_2d(T)
        return replace(pose, z=T[2, 3] + self._level.offset)

    def _began(self) -> Plan | None:
        """Plan to the goal that waits, once there are a map, a pose, and the goal's transform."""
        waiting, robot = self._waiting_goal, self._robot()
        if waiting is None or robot is None or self._over_map is None:
            return None
        T = self._frames.in_map(waiting)
        if T is Missing.NOT_YET:
            return None
        self._waiting_goal = None
        if isinstance(T, Missing):
            return _without_transform("goal_pose", self._frames.unconnected(waiting, T))
        goal = _place_2d(T, waiting)
        return self._replaced(goal, robot, self._planned(goal, robot, self._over_map))

    def _planned(self, goal: Pose2D, robot: Pose2D, over_map: MapPlanner) -> Plan:
        try:
            with over_map.planner() as planner:
                if isinstance(planner, LevelPlanner) and robot.z is not None:
                    z = robot.z - self._level.offset
                    self._level.surface(planner.levels.stack, robot.x, robot.y, z)
                    robot = replace(robot, z=z + self._level.offset)
                return planner.plan(robot, goal, is_robot_there=True, is_field_wanted=True)
        except InputError as error:
            return Plan(status=Status.UNKNOWN, reason=str(error))

    def _replaced(self, goal: Pose2D, robot: Pose2D, plan: Plan) -> Plan:
        """Follow another plan from where the robot is."""
        self._mission = Mission(goal=goal, plan=plan, moved_from=np.array([robot.x, robot.y]))
        return plan

    def _checked(self) -> Plan | None:
        """After a change of the map: another plan where the path is closed or much too long."""
        mission, robot, over_map = self._mission, self._robot(), self._over_map
        if mission is None or robot is None or over_map is None:
            return None
        plan = self._planned(mission.goal, robot, over_map)
        if self._is_better(plan, mission.plan, robot, over_map):
            return self._replaced(mission.goal, robot, plan)
        if plan.cost_to_go is not None:  # the path stays; the best direction is that of this map
            kept = replace(mission.plan, graph=plan.graph, cost_to_go=plan.cost_to_go)
            self._mission = replace(mission, plan=kept)
        return None

    def _is_better(self, plan: Plan, followed: Plan, robot: Pose2D, over_map: MapPlanner) -> bool:
        """Whether a plan over the newest map takes the place of the one that is followed."""
        if not followed.found:
            return plan.status is not followed.status
        ahead = followed.poses[_nearest(followed.poses, robot) :]
        try:
            with over_map.planner() as planner:
                cost = planner.cost_along(ahead, robot)
        except InputError:  # the map cannot be planned over any more
            return True
        if cost is None:
            return True
        share = 1.0 - self._params.planning.replan_gain
        return plan.found and plan.cost < share * cost - LEAST_GAIN

    def _followed(self) -> Plan | None:
        """After a motion: another plan where it leads off the best direction (TRULLA's test).

        Where there was no path, the robot may have come to where there is one.
        """
        mission, robot, over_map = self._mission, self._robot(), self._over_map
        if mission is None or robot is None or over_map is None:
            return None
        away = math.hypot(robot.x - mission.goal.x, robot.y - mission.goal.y)
        if mission.plan.found and away <= self._params.planning.goal_reached:
            self._mission = None
            return None
        moved = np.array([robot.x, robot.y]) - mission.moved_from
        if math.hypot(*moved) < MOTION:
            return None
        if mission.plan.found and self._is_on_course(mission, moved):
            self._mission = replace(mission, moved_from=mission.moved_from + moved)
            return None
        plan = self._replaced(mission.goal, robot, self._planned(mission.goal, robot, over_map))
        is_news = mission.plan.found or plan.status is not mission.plan.status
        return plan if is_news else None

    def _is_on_course(self, mission: Mission, moved: Array) -> bool:
        """Whether a motion (2,) [m] led about where the cheapest path leads."""
        best = best_direction(mission.plan, mission.moved_from)
        if best is None:
            return False
        off = math.remainder(math.atan2(*moved[::-1]) - best, 2.0 * math.pi)
        return abs(off) <= self._params.planning.replan_angle


def _nearest(poses: NDArray[np.float64], robot: Pose2D) -> int:
    """Index of the pose (N, 4, 4) of a path that is nearest to the robot."""
    return int(np.hypot(poses[:, 0, 3] - robot.x, poses[:, 1, 3] - robot.y).argmin())


def _first_blocked(
    planner: Planner | LevelPlanner, poses: NDArray[np.float64], robot: Pose2D
) -> int | None:
    """Index of the first pose (N, 4, 4) that a robot beside a path cannot drive to along it."""
    nearest = _nearest(poses, robot)

    def is_blocked(count: int) -> bool:
        return planner.cost_along(poses[nearest : nearest + count], robot) is None

    ahead = len(poses) - nearest
    if not is_blocked(ahead):
        return None
    return nearest + bisect_left(range(1, ahead), True, key=is_blocked)


def _without_transform(field: str, reason: str) -> Plan:
    return Plan(status=Status.TF_ERROR, reason=f"{field}: {reason}")


def _decoded(message: Any, field: str) -> Odometry:
    """A PoseStamped; `_RefusedError` says what is wrong with it."""
    try:
        return decode.odometry(message, field)
    except InputError as error:
        status = Status.TF_ERROR if "frame_id" in str(error) else Status.UNKNOWN
        raise _RefusedError(Plan(status=status, reason=f"{field}.{error}")) from None


class _RefusedError(Exception):
    """A pose cannot be used; ``plan`` says why."""

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan.reason)
        self.plan = plan


def _place_2d(T: se3.Matrix, given: Odometry) -> Pose2D:
    """A given pose in the map; its z counts unless it is 0, as it is where it was set in 2-D."""
    place = pose_2d(T)
    return replace(place, z=None) if given.T[2, 3] == 0.0 else place


def _is_same(before: HeightMap, after: HeightMap) -> bool:
    """Whether two maps say the same of all cells."""
    return (
        before.geometry == after.geometry
        and before.is_level == after.is_level
        and all(
            np.array_equal(getattr(before.upper, name), getattr(after.upper, name))
            for name in ("cell", "top", "bottom")
        )
        and not changed_blocks(before, after).any()
    )
