# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, goals out: the robot is sent from place to place until the map is complete."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.exploration.explorer import Choice, Explorer
from heightmap25d_ros.exploration.looking import full_turn, headings_to_see
from heightmap25d_ros.exploration.survey import Survey
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import decode
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.exploration_run import Run
from heightmap25d_ros.pipelines.exploration_task import End, State, Task
from heightmap25d_ros.pipelines.level_map import LevelMap
from heightmap25d_ros.pipelines.map_frames import MapFrames
from heightmap25d_ros.planning.plan import Pose2D, pose_2d

REACHED = 0.4
"""A place to look from is reached within this distance [m]."""

_FACED = 0.3  # [rad] a heading is reached within it
_PERIOD = 2.0  # [s] between two checks whether the goal is still worth its way
_LEAST_LOOK = 0.1  # of min_gain: for less the robot does not turn
_GIVEN_UP_IN_A_ROW = 5  # goals, without a motion between them, and no other: the robot is stuck
_RESET = 0.5  # share of known cells that a map must keep, to be the same map


class Exploration:
    """An exploration by goals, for a planner and a controller that follow these.

    ``take_...`` take messages in, by duck type. `advance` says what to do next.

    Parameters
    ----------
    params : Params

    Attributes
    ----------
    dropped : Drops
    state : State
    end : End
    reason : str
        One sentence on both.
    has_returned : bool
        Whether the robot is back at home.
    survey : Survey or None
        Of the newest map that was looked over.
    choice : Choice or None
        The places that were compared last.
    """

    def __init__(self, params: Params) -> None:
        self.dropped = Drops()
        self.state, self.end = State.IDLE, End.NONE
        self.reason = "no exploration has been started"
        self.has_returned = False
        self.survey: Survey | None = None
        self.choice: Choice | None = None
        self._params = params
        self._frames = MapFrames(params, self.dropped)
        self._levels = LevelMap(params.mapping.map_frame, self.dropped)
        self._map: HeightMap | None = None
        self._maps = 0  # so many have come
        self._known_cells = 0
        self._run: Run | None = None
        self._onlooker: Explorer | None = None  # who looks over maps while nothing is explored
        self._is_paused = self._is_lost = False
        self._deviation = 0.0
        self._refusal = ""
        self._now_ns: int | None = None

    @property
    def is_running(self) -> bool:
        """Whether it has been started and has not ended."""
        return self.state not in (State.IDLE, State.ENDED)

    @property
    def _sure(self) -> float:
        """Standard deviation [m] of a pose that is well known."""
        return self._params.exploration.max_deviation / 2.0

    @property
    def goal(self) -> Pose2D | None:
        """The place to look from, or home."""
        return self._run.goal if self._run is not None and self.is_running else None

    @property
    def gain(self) -> float:
        """Area that the goal is expected to show [m^2]."""
        return self._run.gain if self.goal is not None and self._run is not None else 0.0

    @property
    def distance(self) -> float:
        """Way of the robot since the start [m]."""
        return self._run.distance if self._run is not None else 0.0

    @property
    def elapsed(self) -> float:
        """Time since the start, without pauses [s]."""
        return self._run.elapsed if self._run is not None else 0.0

    @property
    def min_gain(self) -> float:
        """Area that a place must be expected to show [m^2]."""
        run = self._run
        return self._params.exploration.min_gain if run is None else run.task.min_gain

    @property
    def corners(self) -> Array:
        """(N, 2) [m], map: of the boundary; empty: none."""
        return self._run.task.boundary.corners if self._run is not None else np.empty((0, 2))

    @property
    def given_up(self) -> list[Pose2D]:
        """Places that were given up."""
        return self._run.explorer.given_up if self._run is not None else []

    def set_params(self, params: Params) -> None:
        """Apply new parameters, from the next start on."""
        self._params, self._onlooker = params, None

    def start(self, task: Task | None = None) -> None:
        """Begin anew, whatever ran before.

        Parameters
        ----------
        task : Task, optional
            That of the parameters by default.

        Raises
        ------
        InputError
            If the boundary of the parameters is no polygon.
        """
        task = task or Task.of(self._params)
        own = replace(self._params.exploration, min_gain=task.min_gain)
        params = replace(self._params, exploration=own)
        self._run = Run(task=task, explorer=Explorer(params, task.boundary))
        self._is_paused, self._refusal = False, ""
        self.end, self.has_returned = End.NONE, False
        self._tell(State.PAUSED, "waits for a map and the robot's pose")

    def stop(self, reason: str = "it was asked to stop") -> Pose2D | None:
        """End now; returns where the robot shall stay."""
        return self._finish(End.STOPPED, reason) if self.is_running else None

    def pause(self, is_paused: bool) -> None:
        """Halt the robot, or go on."""
        self._is_paused = is_paused

    def take_map(self, message: Any) -> None:
        """Take a heightmap25d_msgs/HeightGrid."""
        height_map = self._levels.take_lowest(message)
        if height_map is not None:
            self.set_map(height_map)

    def take_map_update(self, message: Any) -> None:
        """Take a heightmap25d_msgs/HeightGrid with what has changed of the map."""
        height_map = self._levels.take_update(message)
        if height_map is not None:
            self.set_map(height_map)

    def take_upper_surfaces(self, message: Any) -> None:
        """Take a heightmap25d_msgs/UpperSurfaces: what is above the surfaces of the map."""
        height_map = self._levels.take_upper(message)
        if height_map is not None:
            self.set_map(height_map)

    def set_map(self, height_map: HeightMap) -> None:
        """Explore on a map from now on; one that knows much less than the one before is new."""
        known = int(height_map.known.sum())
        if known < _RESET * self._known_cells and self._run is not None:
            self._drop_goal(self._run)
            self._run.forget()
        self._map, self._known_cells = height_map, known
        self._maps += 1

    def take_odometry(self, message: Any) -> None:
        """Take a pose of the robot, see `robot_pose`."""
        before = self._frames.robot()
        if not self._frames.take_odometry(message) or self._run is None or before is None:
            return
        after = self._frames.robot()
        if after is not None and self.is_running:
            self._run.distance += float(np.linalg.norm(after[:3, 3] - before[:3, 3]))

    def take_correction(self, message: Any) -> None:
        """Take a geometry_msgs/PoseWithCovarianceStamped: the pose of odom in the map."""
        self._frames.take_correction(message)

    def take_transforms(self, message: Any, *, is_static: bool) -> None:
        """Take a tf2_msgs/TFMessage of /tf or /tf_static."""
        self._frames.take_transforms(message, is_static=is_static)

    def take_localization_status(self, message: Any) -> None:
        """Take a heightmap25d_msgs/LocalizationStatus: a lost robot is not sent anywhere."""
        self._is_lost = message.state == message.LOST
        deviation = float(message.position_deviation)
        self._deviation = deviation if math.isfinite(deviation) else 0.0

    def take_plan_status(self, message: Any) -> None:
        """Take a heightmap25d_msgs/PlanStatus: a goal without a path is given up."""
        stamp = self.dropped.decoded("plan status", lambda m: decode.stamp_ns(m.header), message)
        if stamp is None or self._run is None or stamp < self._run.sent_ns:
            return
        is_refused = message.code not in (message.NONE, message.TF_ERROR)
        self.set_plan_refusal(message.reason if is_refused else "")

    def set_plan_refusal(self, reason: str) -> None:
        """Planning has no path to the goal, for a reason; empty: it has one."""
        self._refusal = f"planning refuses it: {reason}" if reason else ""

    def look_over(self) -> None:
        """Compare places without driving to any: for those who have a planner of their own.

        Raises
        ------
        InputError
            If the map cannot be planned over.
        """
        robot = self._robot()
        if self._map is not None and robot is not None:
            self._onlooker = self._onlooker or Explorer(self._params)
            explorer = self._run.explorer if self._run else self._onlooker
            self.survey = explorer.survey(self._map, robot)
            self.choice = explorer.choose(self.survey)

    def advance(self, now_ns: int) -> Pose2D | None:
        """What to do at a time [ns]: the pose that the robot is sent to, where that changes.

        A goal without yaw is a place to look from. One at the robot itself turns or stops it.
        """
        passed = 0.0 if self._now_ns is None else max(0.0, (now_ns - self._now_ns) * 1e-9)
        self._now_ns = now_ns
        run = self._run
        if run is None or not self.is_running:
            return None
        robot = self._robot()
        if robot is None or self._map is None:
            what = "map" if self._map is None else "pose of the robot"
            self._tell(State.PAUSED, f"no {what} has come yet")
            return None
        if self._is_paused or self._is_lost:
            return self._rest(run, robot, passed)
        run.lost_s = 0.0
        run.elapsed += passed
        run.note_motion(robot, is_sure=self._deviation <= self._sure)
        try:
            return self._next(run, robot)
        except InputError as error:
            return self._finish(End.STUCK, f"the map cannot be planned over: {error}")

    def _rest(self, run: Run, robot: Pose2D, passed: float) -> Pose2D | None:
        """Wait where the robot is."""
        run.moved_s = run.elapsed
        if self._is_lost:
            run.lost_s += passed
            if run.lost_s > self._params.exploration.lost_timeout:
                return self._finish(End.LOST, f"localization has been LOST for {run.lost_s:.0f} s")
        reason = "localization is LOST" if self._is_lost else "it was asked to pause"
        is_news = self.state is not State.PAUSED
        self._tell(State.PAUSED, reason)
        if not is_news:
            return None
        self._drop_goal(run)
        return robot

    def _next(self, run: Run, robot: Pose2D) -> Pose2D | None:
        if run.home is None:
            run.home = robot
            return self._look(run, robot, full_turn(robot.yaw or 0.0))
        reached = run.limit
        if reached and run.ending is None:
            return self._wind_up(run, robot, End.LIMIT, reached)
        if run.headings or run.maps_at_last_heading is not None:
            return self._turned(run, robot)
        if run.ending is not None:
            return self._returned(run, robot, run.ending)
        if run.goal is None:
            return self._choose(run, robot)
        return self._driven(run, robot, run.goal)

    def _choose(self, run: Run, robot: Pose2D) -> Pose2D | None:
        """The next place to look from; or the end."""
        self._drop_goal(run)
        survey = self._surveyed(run, robot)
        self.choice = choice = run.explorer.choose(survey, run.distance)
        if not np.isfinite(survey.costs).any():
            return self._finish(End.STUCK, "no path leads away from where the robot stands")
        if choice.goal is None:
            return self._without_goals(run, robot)
        if math.hypot(choice.goal.x - robot.x, choice.goal.y - robot.y) <= REACHED:
            return self._look_around(run, survey, robot)
        yaw = math.atan2(choice.goal.y - robot.y, choice.goal.x - robot.x)
        goal = replace(choice.goal, yaw=yaw)
        return self._send(run, goal, choice.gain, State.DRIVING, "drives to a frontier")

    def _without_goals(self, run: Run, robot: Pose2D) -> Pose2D | None:
        """No place is worth the way: look closer, try what was refused once more, or end."""
        if run.explorer.doubt_obstacles():
            return self._choose(run, robot)
        if run.given_up >= _GIVEN_UP_IN_A_ROW:
            return self._finish(End.STUCK, run.told_stuck)
        if run.tries_again():
            return self._choose(run, robot)
        return self._wind_up(run, robot, End.DONE, run.told_done)

    def _surveyed(self, run: Run, robot: Pose2D) -> Survey:
        assert self._map is not None
        self.survey = run.explorer.survey(self._map, robot)
        return self.survey

    def _driven(self, run: Run, robot: Pose2D, goal: Pose2D) -> Pose2D | None:
        """On the way to a goal."""
        fault = self._refusal or run.standstill(self._params.exploration.stuck_timeout)
        if fault:
            return self._give_up(run, goal, fault)
        is_there = math.hypot(goal.x - robot.x, goal.y - robot.y) <= REACHED
        if run.is_relocating:
            is_back = is_there or self._deviation <= self._sure
            return self._choose(run, robot) if is_back else None
        if not is_there and run.elapsed < run.checked_s + _PERIOD:
            return None
        run.checked_s = run.elapsed
        survey = self._surveyed(run, robot)
        if self._deviation > self._params.exploration.max_deviation and run.trail:
            return self._relocate(run, survey)
        if is_there:
            return self._look_around(run, survey, robot)
        is_worth = run.is_worth(survey, goal, self._params.exploration.keep_gain)
        return None if is_worth else self._choose(run, robot)

    def _look_around(self, run: Run, survey: Survey, robot: Pose2D) -> Pose2D | None:
        """Turn to where something is still to be seen; or be done with this place."""
        self._drop_goal(run)
        missing = survey.unseen_around(robot)
        area = len(missing) * survey.cell_area
        if area < _LEAST_LOOK * run.task.min_gain:
            run.explorer.note_look(survey, run.distance)
            return None
        headings = headings_to_see(missing, robot, self._params.exploration.blind_radius)
        return self._look(run, robot, headings)

    def _look(self, run: Run, robot: Pose2D, headings: list[float]) -> Pose2D | None:
        run.headings = headings
        return self._send(run, replace(robot, yaw=headings[0]), 0.0, State.LOOKING, "looks around")

    def _turned(self, run: Run, robot: Pose2D) -> Pose2D | None:
        """While it looks around."""
        if run.maps_at_last_heading is not None:
            if self._maps <= run.maps_at_last_heading + 1:  # one may have been on its way
                return self._missed_map(run)
            run.maps_at_last_heading = None
            run.explorer.note_look(self._surveyed(run, robot), run.distance)
            self._drop_goal(run)
            return None
        fault = self._refusal or run.standstill(self._params.exploration.stuck_timeout)
        if fault:
            return self._give_up(run, robot, fault)
        if abs(math.remainder((robot.yaw or 0.0) - run.headings[0], 2.0 * math.pi)) > _FACED:
            return None
        run.headings = run.headings[1:]
        if not run.headings:
            run.maps_at_last_heading = self._maps
            return None
        return self._look(run, robot, run.headings)

    def _missed_map(self, run: Run) -> Pose2D | None:
        """While the map of what the robot has looked at is to come; the end if it never does."""
        waited = run.elapsed - run.moved_s
        if waited <= self._params.exploration.stuck_timeout:
            return None
        told = f"no map of what the robot has looked at has come for {waited:.0f} s"
        return self._finish(End.STUCK, told)

    def _relocate(self, run: Run, survey: Survey) -> Pose2D | None:
        """Go back to the nearest place at which the pose was well known."""
        place = min(run.trail, key=survey.cost_of)
        if not math.isfinite(survey.cost_of(place)):
            return None
        run.is_relocating = True
        reason = f"returns to where its pose was known: it errs by {self._deviation:.2f} m or so"
        return self._send(run, place, 0.0, State.DRIVING, reason)

    def _wind_up(self, run: Run, robot: Pose2D, end: End, reason: str) -> Pose2D | None:
        """End, or first return home."""
        home = run.home
        if not run.task.return_home or home is None:
            return self._finish(end, reason)
        self._drop_goal(run)
        run.ending = end, reason
        return self._send(run, home, 0.0, State.RETURNING, f"returns home: {reason}")

    def _returned(self, run: Run, robot: Pose2D, ending: tuple[End, str]) -> Pose2D | None:
        home = run.goal or robot
        self.has_returned = math.hypot(home.x - robot.x, home.y - robot.y) <= REACHED
        end, reason = ending
        if self.has_returned:
            return self._finish(end, f"{reason}; the robot is back home")
        fault = self._refusal or run.standstill(self._params.exploration.stuck_timeout)
        return self._finish(end, f"{reason}; it did not return home: {fault}") if fault else None

    def _give_up(self, run: Run, goal: Pose2D, fault: str) -> Pose2D | None:
        is_refused = bool(self._refusal)
        run.give_up(goal, fault, is_refused=is_refused)
        self._drop_goal(run)
        if run.given_up >= _GIVEN_UP_IN_A_ROW and not is_refused:
            return self._finish(End.STUCK, run.told_stuck)
        return None

    def _send(
        self, run: Run, goal: Pose2D, gain: float, state: State, reason: str
    ) -> Pose2D | None:
        run.goal, run.gain, run.sent_ns = goal, gain, self._now_ns or 0
        run.checked_s = run.moved_s = run.elapsed
        self._refusal = ""
        self._tell(state, reason)
        return goal

    def _drop_goal(self, run: Run) -> None:
        run.drop_goal()
        self._refusal = ""

    def _finish(self, end: End, reason: str) -> Pose2D | None:
        """End; the robot stays where it is."""
        self.end = end
        self._tell(State.ENDED, reason)
        return self._robot()

    def _tell(self, state: State, reason: str) -> None:
        self.state, self.reason = state, reason

    def _robot(self) -> Pose2D | None:
        T = self._frames.robot()
        return None if T is None else pose_2d(T)
