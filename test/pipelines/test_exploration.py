# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, goals out: a robot that obeys at once, in worlds of a few arrays."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from bag_writer import header, odometry, rosbags_type
from explored_worlds import CELL, START_RADIUS, at, seen

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.exploration import Exploration
from heightmap25d_ros.pipelines.exploration_task import End, State, Task, requested

SECOND = 10**9
BEGIN = 10**12
WALL = 1.5
TRACKING, DEGRADED, LOST = 0, 1, 2


def room(width, depth):
    height = np.zeros((round(depth / CELL), round(width / CELL)))
    height[[0, -1]] = height[:, [0, -1]] = WALL
    return height


class Robot:
    """Goes to each goal in a second, sees what a full turn shows, and sends two maps a second."""

    def __init__(self, height, start=(2.0, 2.0), **values):
        values = {"exploration." + name: value for name, value in values.items()}
        self.exploration = Exploration(with_values(Params(), values))
        self.height = height
        self.pose = (*start, 0.0)
        self.seconds = 0
        self.goals = []
        self.can_move = self.is_mapped = True
        self.map = self.looked_from = None
        iy, ix = np.indices(height.shape)
        away = np.hypot((ix + 0.5) * CELL - start[0], (iy + 0.5) * CELL - start[1])
        self.known = (away < START_RADIUS) & (height == 0.0)

    def hear(self):
        x, y, yaw = self.pose
        pose = odometry(BEGIN + self.seconds * SECOND, (x, y, 0.0), type_of=rosbags_type)
        pose.pose.pose.orientation.z = math.sin(yaw / 2)
        pose.pose.pose.orientation.w = math.cos(yaw / 2)
        self.exploration.take_odometry(pose)

    def show(self):
        cell = int(self.pose[1] / CELL), int(self.pose[0] / CELL)
        if cell != self.looked_from:
            self.looked_from = cell
            self.known |= seen(self.height, cell)
            shown = np.where(self.known, self.height, np.nan)
            self.map = HeightMap.from_metres(shown, resolution=CELL)
        self.exploration.set_map(self.map)

    def step(self):
        """A second."""
        self.seconds += 1
        self.hear()
        if self.is_mapped:
            self.show()
            self.show()
        goal = self.exploration.advance(BEGIN + self.seconds * SECOND)
        if goal is not None:
            self.goals.append(goal)
            if self.can_move:
                self.pose = goal.x, goal.y, goal.yaw
        return goal

    def run(self, seconds=300):
        """Step until the end."""
        for _ in range(seconds):
            self.step()
            if self.exploration.state is State.ENDED:
                return self.exploration.end
        return self.exploration.end

    def until(self, state, seconds=60):
        for _ in range(seconds):
            self.step()
            if self.exploration.state is state:
                return
        raise AssertionError(self.exploration.reason)

    def localize(self, state, deviation=0.05):
        self.exploration.take_localization_status(
            SimpleNamespace(state=state, LOST=LOST, position_deviation=deviation)
        )

    def refuse(self, reason, code=208):
        stamp = BEGIN + self.seconds * SECOND
        message = SimpleNamespace(header=header(stamp, "map"), code=code, reason=reason,
                                  NONE=0, TF_ERROR=202)  # fmt: skip
        self.exploration.take_plan_status(message)


def test_a_room_is_explored_to_its_end():
    robot = Robot(room(16.0, 6.0))
    assert robot.exploration.advance(BEGIN) is None  # nobody has started it
    robot.exploration.start()
    assert robot.run() is End.DONE
    assert robot.known[at(robot.known, (1, 15), (1, 5))].all()
    first = robot.goals[0]
    assert (first.x, first.y) == (2.0, 2.0)  # it begins with a turn
    yaws = [goal.yaw for goal in robot.goals[:4]]
    assert [math.cos(yaw) for yaw in yaws] == pytest.approx([0, -1, 0, 1], abs=1e-6)
    assert robot.exploration.distance > 5.0
    assert robot.exploration.survey.covered_area > 40.0
    assert robot.exploration.goal is None
    assert robot.step() is None


def test_it_waits_for_map_and_pose_and_says_so():
    exploration = Exploration(Params())
    exploration.start()
    assert exploration.advance(BEGIN) is None
    assert exploration.reason == "no map has come yet"
    exploration.set_map(HeightMap.from_metres(room(5.0, 5.0), resolution=CELL))
    assert exploration.advance(BEGIN) is None
    assert exploration.reason == "no pose of the robot has come yet"
    assert exploration.state is State.PAUSED


def test_the_robot_returns_home():
    robot = Robot(room(20.0, 6.0), return_home=True)
    robot.exploration.start()
    robot.until(State.RETURNING, 200)
    assert robot.run() is End.DONE
    assert robot.exploration.has_returned
    assert robot.pose[:2] == pytest.approx((2.0, 2.0), abs=0.5)


def test_a_robot_that_cannot_return_is_told():
    robot = Robot(room(20.0, 6.0), return_home=True)
    robot.exploration.start()
    robot.until(State.DRIVING, 20)
    while robot.exploration.state is not State.RETURNING:
        robot.can_move = robot.exploration.state is not State.RETURNING
        before = robot.pose
        robot.step()
    robot.pose = before
    robot.can_move = False
    robot.refuse("a door was shut")
    assert robot.run() is End.DONE
    assert not robot.exploration.has_returned
    assert "it did not return home: planning refuses it: a door was shut" in (
        robot.exploration.reason
    )


@pytest.mark.parametrize(
    ("limits", "told"),
    [({"time_limit": 20.0}, "20 s"), ({"distance_limit": 4.0}, "4 m")],
)
def test_limits(limits, told):
    robot = Robot(room(30.0, 6.0), **limits)
    robot.exploration.start()
    assert robot.run() is End.LIMIT
    assert told in robot.exploration.reason
    assert not robot.known.all()


def test_a_robot_that_does_not_move_is_stuck():
    robot = Robot(room(16.0, 6.0))
    robot.exploration.start()
    robot.can_move = False
    assert robot.run(400) is End.STUCK
    assert "has not moved" in robot.exploration.reason


def test_a_map_that_falls_silent_is_named():
    robot = Robot(room(16.0, 6.0))
    robot.exploration.start()
    robot.until(State.LOOKING)
    robot.is_mapped = False
    assert robot.run(400) is End.STUCK
    assert "no map" in robot.exploration.reason


def test_a_start_without_any_way_out_is_stuck():
    height = room(6.0, 6.0)
    height[at(height, (1.2, 1.4), (1.2, 2.8))] = WALL
    height[at(height, (2.6, 2.8), (1.2, 2.8))] = WALL
    height[at(height, (1.2, 2.8), (1.2, 1.4))] = WALL
    height[at(height, (1.2, 2.8), (2.6, 2.8))] = WALL
    robot = Robot(height)
    robot.exploration.start()
    assert robot.run() in (End.STUCK, End.DONE)
    assert robot.exploration.distance < 1.0


def refused_until(robot, is_over, seconds=400):
    """Step, while planning refuses every goal of a drive, until something holds; the refused."""
    refused = []
    for _ in range(seconds):
        before = robot.pose
        robot.step()
        if is_over() or robot.exploration.state is State.ENDED:
            return refused
        if robot.exploration.state is State.DRIVING:
            robot.pose = before
            refused.append(robot.exploration.goal)
            robot.refuse("no way")
    raise AssertionError(robot.exploration.reason)


def test_a_goal_that_planning_refuses_is_given_up_and_tried_once_more():
    robot = Robot(room(16.0, 6.0))
    robot.exploration.start()
    robot.until(State.DRIVING)
    refused = robot.exploration.goal
    robot.pose = (2.0, 2.0, 0.0)
    robot.refuse("no way")
    robot.step()
    assert robot.exploration.given_up == [refused]
    robot.refuse("stale", code=202)  # of the odometry: no reason to give up the next one
    assert robot.run() is End.DONE
    assert not robot.exploration.given_up  # from elsewhere there may be a way
    assert "could not be reached" not in robot.exploration.reason


def test_goals_that_are_refused_twice_are_told_at_the_end():
    height = room(16.0, 6.0)
    height[at(height, (9.0, 9.2), (0.0, 6.0))] = WALL
    height[at(height, (9.0, 9.2), (2.2, 3.8))] = 0.0
    robot = Robot(height)
    robot.exploration.start()
    asked = []
    for _ in range(400):
        before = robot.pose
        goal = robot.step()
        if robot.exploration.state is State.ENDED:
            break
        if goal is not None and goal.x > 8.0 and robot.exploration.state is State.DRIVING:
            robot.pose = before
            asked.append((goal.x, goal.y))
            robot.refuse("the door is shut")
    assert robot.exploration.end is End.DONE
    assert len(asked) > len(set(asked)) > 0
    assert "could not be reached" in robot.exploration.reason


def test_goals_that_are_refused_in_a_row_do_not_end_it_while_there_are_others():
    robot = Robot(room(30.0, 12.0))
    robot.exploration.start()
    refused = refused_until(robot, lambda: len(robot.exploration.given_up) >= 6)
    assert len(refused) >= 6
    assert robot.run() is End.DONE
    assert robot.known[at(robot.known, (1, 29), (1, 11))].mean() > 0.99


def test_a_robot_to_which_every_goal_is_refused_is_stuck():
    robot = Robot(room(30.0, 12.0))
    robot.exploration.start()
    assert len(refused_until(robot, lambda: False)) >= 5
    assert robot.exploration.end is End.STUCK
    assert robot.exploration.reason.endswith("goals: planning refuses it: no way")


def test_it_pauses_and_goes_on():
    robot = Robot(room(16.0, 6.0))
    robot.exploration.start()
    robot.until(State.DRIVING)
    robot.exploration.pause(True)
    halt = robot.step()
    assert (halt.x, halt.y) == robot.pose[:2]
    elapsed = robot.exploration.elapsed
    assert [robot.step() for _ in range(50)] == [None] * 50
    assert robot.exploration.elapsed == elapsed
    assert robot.exploration.reason == "it was asked to pause"
    robot.exploration.pause(False)
    assert robot.run() is End.DONE


def test_it_pauses_while_lost_and_ends_after_a_while():
    robot = Robot(room(16.0, 6.0), lost_timeout=30.0)
    robot.exploration.start()
    robot.until(State.DRIVING)
    robot.localize(LOST)
    assert robot.step() is not None  # where it is: it halts
    assert robot.exploration.reason == "localization is LOST"
    for _ in range(20):
        assert robot.step() is None
    robot.localize(TRACKING)
    robot.until(State.DRIVING)
    robot.localize(LOST)
    assert robot.run(60) is End.LOST
    assert "LOST for 31 s" in robot.exploration.reason


def test_an_uncertain_robot_goes_back_to_where_its_pose_was_known():
    robot = Robot(room(24.0, 6.0), max_deviation=0.5)
    robot.exploration.start()
    robot.until(State.DRIVING)
    robot.can_move = False
    robot.localize(DEGRADED, 0.8)
    goals = [robot.step() for _ in range(4)]
    back = next(goal for goal in goals if goal is not None)
    assert (back.x, back.y) == pytest.approx(robot.pose[:2], abs=2.1)
    assert "errs by 0.80 m" in robot.exploration.reason
    robot.can_move = True
    robot.localize(TRACKING, 0.1)
    assert robot.run() is End.DONE


def test_a_map_that_was_cleared_begins_anew():
    robot = Robot(room(16.0, 6.0))
    robot.exploration.start()
    robot.until(State.DRIVING)
    robot.step()
    robot.known[:] = False
    robot.looked_from = None
    empty = HeightMap.from_metres(np.full(robot.height.shape, np.nan), resolution=CELL)
    robot.exploration.set_map(empty)
    goal = robot.step()
    assert robot.exploration.state is State.LOOKING
    assert (goal.x, goal.y) == robot.pose[:2]
    assert robot.run() is End.DONE


def test_it_stops_when_asked_to():
    robot = Robot(room(16.0, 6.0))
    assert robot.exploration.stop() is None
    robot.exploration.start()
    robot.until(State.DRIVING)
    halt = robot.exploration.stop("enough")
    assert (halt.x, halt.y) == pytest.approx(robot.pose[:2], abs=30.0)
    assert (robot.exploration.end, robot.exploration.reason) == (End.STOPPED, "enough")
    assert robot.step() is None
    robot.exploration.start()
    assert robot.run() is End.DONE


def test_frontiers_without_goals():
    robot = Robot(room(16.0, 6.0))
    robot.hear()
    robot.show()
    robot.exploration.look_over()
    assert robot.exploration.choice.gains.max() > 2.0
    assert robot.step() is None


def test_broken_messages_change_nothing():
    robot = Robot(room(8.0, 6.0))
    robot.exploration.start()
    robot.step()
    broken = odometry(BEGIN, (math.nan, 0.0, 0.0), type_of=rosbags_type)
    robot.exploration.take_odometry(broken)
    robot.exploration.take_map(SimpleNamespace(header=header(BEGIN, "odom")))
    robot.localize(TRACKING, math.nan)
    assert sum(robot.exploration.dropped.values()) == 2
    assert robot.run() is End.DONE
    assert math.isfinite(robot.exploration.distance)


def goal(**fields):
    polygon = [SimpleNamespace(x=x, y=y) for x, y in fields.pop("corners", [])]
    boundary = SimpleNamespace(
        header=header(0, fields.pop("frame", "map")), polygon=SimpleNamespace(points=polygon)
    )
    values = {"min_gain": 0.0, "time_limit": 0.0, "distance_limit": 0.0, "return_home": False}
    return SimpleNamespace(boundary=boundary, **{**values, **fields})


def test_what_an_action_leaves_open_is_as_the_parameters_say():
    params = with_values(Params(), {"exploration.time_limit": 60.0})
    task = requested(goal(min_gain=3.0), params)
    assert (task.min_gain, task.time_limit, task.distance_limit) == (3.0, 60.0, 0.0)
    assert not task.return_home
    assert not len(task.boundary.corners)
    square = [(0, 0), (1, 0), (1, 1)]
    assert requested(goal(corners=square), params).boundary.corners.tolist() == square[:0] + [
        [0, 0], [1, 0], [1, 1]
    ]  # fmt: skip


@pytest.mark.parametrize(
    "fields",
    [
        {"min_gain": -1.0}, {"time_limit": math.nan}, {"distance_limit": math.inf},
        {"corners": [(0, 0), (1, 1)]}, {"corners": [(0, 0), (1, 0), (1, math.nan)]},
        {"corners": [(0, 0), (1, 0), (1, 1)], "frame": "odom"},
    ],
)  # fmt: skip
def test_what_an_action_cannot_ask_for(fields):
    with pytest.raises(InputError):
        requested(goal(**fields), Params())


def test_the_task_of_parameters_with_a_wrong_boundary_is_refused():
    with pytest.raises(InputError, match="boundary: 2 corners"):
        Task.of(with_values(Params(), {"exploration.boundary": [0.0, 0.0, 1.0, 1.0]}))
