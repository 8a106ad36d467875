# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The planning node as Nav2's planner_server, with clients as bt_navigator has them."""

import math
import time

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from bag_writer import odometry, rclpy_type
from geometry_msgs.msg import PoseStamped
from grid_messages import grid
from nav_msgs.msg import Path
from node_client import LATCHED, Client, node_process
from rclpy.action import ActionClient

pytest.importorskip("nav2_msgs.action")
from nav2_msgs.action import ComputePathThroughPoses, ComputePathToPose
from nav2_msgs.msg import SpeedLimit
from nav2_msgs.srv import ClearEntireCostmap, IsPathValid

STANDING = ("-p", "intake.timeout:=600.0")  # its odometry is published once
SERVER_PATIENCE = 10.0  # [s], of a busy machine; bt_navigator's is 0.02 s
START = (2.0, 5.0)


def pose_stamped(x, y, yaw=0.0, frame="map"):
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y = float(x), float(y)
    message.pose.orientation.z, message.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return message


def places(path):
    return np.array([(p.pose.position.x, p.pose.position.y) for p in path.poses]).reshape(-1, 2)


class Navigator(Client):
    """Sends goals to the actions, and waits for what becomes of them."""

    def __init__(self, namespace):
        super().__init__(namespace)
        self.actions = {
            kind: ActionClient(self.node, kind, name)
            for kind, name in (
                (ComputePathToPose, "compute_path_to_pose"),
                (ComputePathThroughPoses, "compute_path_through_poses"),
            )
        }

    def send(self, kind, **fields):
        """The handle of a goal."""
        sent = self.actions[kind].send_goal_async(kind.Goal(**fields))
        self.wait(sent.done)
        return sent.result()

    def result(self, handle):
        """Status and result of a goal."""
        result = handle.get_result_async()
        self.wait(result.done)
        return result.result().status, result.result().result

    def ask(self, kind, **fields):
        handle = self.send(kind, **fields)
        assert handle.accepted
        return self.result(handle)

    def show(self, heights):
        self.publish("height_grid", grid(heights), LATCHED)
        self.spin(0.5)


@pytest.fixture(scope="module")
def navigator():
    client = Navigator("/nav")
    limits = "-p", "planning.speed_limit_ahead:=2.0"
    with node_process("planning", *STANDING, *limits, namespace="/nav") as process:
        for action in client.actions.values():
            client.wait(action.server_is_ready)
        client.show(np.zeros((80, 160)))
        client.publish("odom", odometry(10**9, (*START, 0.0), type_of=rclpy_type))
        client.spin(0.5)
        yield client
        assert process.poll() is None
    client.close()


def test_a_path_from_the_robot_to_a_pose(navigator):
    navigator.subscribe("plan", Path)
    status, result = navigator.ask(ComputePathToPose, goal=pose_stamped(18.0, 5.0, math.pi / 2))
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert (result.error_code, result.error_msg) == (ComputePathToPose.Result.NONE, "")
    assert result.path.header.frame_id == "map"
    np.testing.assert_allclose(places(result.path)[[0, -1]], [START, (18.0, 5.0)], atol=1e-6)
    end = result.path.poses[-1].pose.orientation
    assert 2 * math.atan2(end.z, end.w) == pytest.approx(math.pi / 2)
    assert 0 < result.planning_time.sec + result.planning_time.nanosec * 1e-9 < 60.0
    navigator.wait(lambda: "plan" in navigator.newest)
    assert navigator.newest["plan"] == result.path


def test_a_start_is_used_where_it_is_given(navigator):
    fields = {"goal": pose_stamped(18.0, 5.0), "start": pose_stamped(10.0, 8.0)}
    _, result = navigator.ask(ComputePathToPose, **fields, use_start=True, planner_id="GridBased")
    np.testing.assert_allclose(places(result.path)[0], (10.0, 8.0), atol=1e-6)
    _, result = navigator.ask(ComputePathToPose, **fields, use_start=False)
    np.testing.assert_allclose(places(result.path)[0], START, atol=1e-6)


def test_a_path_through_poses_passes_each_of_them(navigator):
    corners = [(10.0, 8.0), (15.0, 5.0), (10.0, 2.0)]
    status, result = navigator.ask(
        ComputePathThroughPoses, goals=[pose_stamped(x, y) for x, y in corners]
    )
    assert status == GoalStatus.STATUS_SUCCEEDED
    path = places(result.path)
    assert all(np.sum(np.hypot(*(path - corner).T) < 1e-6) == 1 for corner in corners)
    np.testing.assert_allclose(path[[0, -1]], [START, corners[-1]], atol=1e-6)


@pytest.mark.parametrize(
    ("fields", "code", "message"),
    [
        ({"goal": pose_stamped(500.0, 5.0)}, "GOAL_OUTSIDE_MAP", "the goal is outside of the map"),
        (
            {"goal": pose_stamped(18.0, 5.0), "start": pose_stamped(-9.0, 5.0), "use_start": True},
            "START_OUTSIDE_MAP",
            "the start is outside of the map",
        ),
        ({"goal": pose_stamped(18.0, 5.0, frame="moon")}, "TF_ERROR", "from 'moon' to 'map'"),
        ({"goal": pose_stamped(math.nan, 5.0)}, "UNKNOWN", "not a place"),
        (
            {"goal": pose_stamped(18.0, 5.0), "planner_id": "Smac"},
            "INVALID_PLANNER",
            "there is no planner 'Smac', but GridBased",
        ),
    ],
)
@pytest.mark.parametrize("kind", [ComputePathToPose, ComputePathThroughPoses])
def test_without_a_path_code_and_message_say_why(navigator, kind, fields, code, message):
    if kind is ComputePathThroughPoses:
        fields = fields | {"goals": [fields["goal"]]}
        del fields["goal"]
    status, result = navigator.ask(kind, **fields)
    assert status == GoalStatus.STATUS_ABORTED
    assert result.error_code == getattr(kind.Result, code)
    assert message in result.error_msg
    assert result.path.poses == []


def test_no_goals_are_a_reason_as_well(navigator):
    status, result = navigator.ask(ComputePathThroughPoses, goals=[])
    assert status == GoalStatus.STATUS_ABORTED
    assert result.error_code == ComputePathThroughPoses.Result.NO_VIAPOINTS_GIVEN


def test_a_path_is_valid_until_something_stands_in_it(navigator):
    _, result = navigator.ask(ComputePathToPose, goal=pose_stamped(18.0, 5.0))

    def check(path):
        answer = navigator.call("is_path_valid", IsPathValid, path=path)
        return answer.is_valid, list(answer.invalid_pose_indices)

    assert check(result.path) == (True, [])
    assert check(Path()) == (False, [0])
    boxed = np.zeros((80, 160))
    boxed[30:50, 80:84] = 50.0
    navigator.show(boxed)
    is_valid, (first,) = check(result.path)
    assert not is_valid
    assert 8.8 < places(result.path)[first, 0] < 10.5
    _, result = navigator.ask(ComputePathToPose, goal=pose_stamped(18.0, 5.0))
    assert check(result.path) == (True, [])
    navigator.show(np.zeros((80, 160)))


def test_the_speed_limit_follows_the_ground_ahead(navigator):
    messages = []
    navigator.node.create_subscription(SpeedLimit, "speed_limit", messages.append, 10)
    ramp = 100.0 * np.maximum((np.arange(160) + 0.5) * 0.125 - 10.0, 0.0) * math.tan(0.27)
    navigator.show(np.broadcast_to(ramp, (80, 160)))
    _, result = navigator.ask(ComputePathToPose, goal=pose_stamped(18.0, 5.0))
    assert len(result.path.poses) > 100

    def drive_to(x):
        navigator.publish("odom", odometry(10**9, (x, 5.0, 0.0), type_of=rclpy_type))

    navigator.spin(1.0)
    assert messages == []  # on level ground there has been no limit, and there is none
    drive_to(13.0)
    navigator.wait(lambda: messages)
    assert messages[-1].percentage
    assert messages[-1].speed_limit == pytest.approx(65.0, abs=5.0)
    drive_to(START[0])
    navigator.wait(lambda: messages[-1].speed_limit == 0.0)  # as Nav2 says "no limit"
    navigator.show(np.zeros((80, 160)))


def test_what_is_cancelled_or_preempted_has_its_result_at_once(navigator):
    navigator.show(np.zeros((1600, 1600)))  # takes a second or more to be converted
    goal = pose_stamped(18.0, 5.0)
    first = navigator.send(ComputePathToPose, goal=goal)
    second = navigator.send(ComputePathToPose, goal=goal)
    status, result = navigator.result(first)
    assert (status, result.error_msg) == (
        GoalStatus.STATUS_ABORTED,
        "preempted by a newer goal",
    )
    cancelled = second.cancel_goal_async()
    navigator.wait(cancelled.done)
    assert len(cancelled.result().goals_canceling) == 1
    status, result = navigator.result(second)
    assert status == GoalStatus.STATUS_CANCELED
    assert result.path.poses == []
    status, result = navigator.ask(ComputePathToPose, goal=goal)  # the next one is planned to
    assert status == GoalStatus.STATUS_SUCCEEDED
    navigator.show(np.zeros((80, 160)))


def test_goals_are_answered_while_a_map_is_converted(navigator):
    navigator.show(np.ones((1600, 1600)))
    began = time.monotonic()
    handle = navigator.send(ComputePathToPose, goal=pose_stamped(18.0, 5.0))
    accepted = time.monotonic() - began
    assert navigator.result(handle)[0] == GoalStatus.STATUS_SUCCEEDED
    assert accepted < 0.5 * (time.monotonic() - began)
    navigator.show(np.zeros((80, 160)))


def test_the_costmap_that_is_not_there_is_cleared(navigator):
    service = "global_costmap/clear_entirely_global_costmap"
    assert navigator.call(service, ClearEntireCostmap) is not None
