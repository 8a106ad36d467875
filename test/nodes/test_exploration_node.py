# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The exploration node over DDS: by action and services, and with a simulated robot."""

import math
from contextlib import ExitStack

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from bag_writer import odometry, rclpy_type
from geometry_msgs.msg import Point32, PolygonStamped, PoseStamped
from grid_messages import grid
from node_client import LATCHED, PATIENCE, Client, node_process
from rclpy.action import ActionClient
from repository import ROOT
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import MarkerArray

from heightmap25d_msgs.action import Explore
from heightmap25d_msgs.msg import ExplorationStatus, LocalizationStatus, PlanStatus
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.exploration import Exploration

MS = 10**6
CORNERS = [(0.0, 0.0), (12.0, 0.0), (12.0, 4.5), (0.0, 4.5)]


class Place:
    """A client in place of robot, mapping and planning: half of a hall is known."""

    def __init__(self, namespace):
        self.client = Client(namespace)
        self.goals, self.statuses, self.feedback = [], [], []
        node = self.client.node
        node.create_subscription(PoseStamped, "goal_pose", self.goals.append, 10)
        node.create_subscription(
            ExplorationStatus, "exploration/status", self.statuses.append, LATCHED
        )
        self.client.subscribe("boundary", PolygonStamped)
        self.client.subscribe("exploration/markers", MarkerArray)
        self.action = ActionClient(node, Explore, "explore")
        self._ms = 0
        self.obeys = True
        self.hall = np.zeros((40, 128))
        self.hall[[0, -1]] = 150.0
        self.hall[:, 56:] = np.nan  # too far to be looked for from the start

    @property
    def state(self):
        return self.statuses[-1].state if self.statuses else None

    @property
    def shown(self):
        """Names of the markers that have points."""
        newest = self.client.newest.get("exploration/markers", MarkerArray())
        return {marker.ns for marker in newest.markers if marker.points}

    def show(self):
        self.client.publish("height_grid", grid(self.hall), LATCHED)

    def until(self, is_so):
        """Obey each goal at once, or stand at the start, until something is so."""

        def is_done():
            self._ms += 20
            x, y, yaw = 2.0, 2.5, 0.0
            if self.goals and self.obeys:
                pose = self.goals[-1].pose
                x, y = pose.position.x, pose.position.y
                yaw = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
            message = odometry(self._ms * MS, (x, y, 0.0), type_of=rclpy_type)
            message.pose.pose.orientation.z = math.sin(yaw / 2)
            message.pose.pose.orientation.w = math.cos(yaw / 2)
            self.client.publish("odom", message)
            self.show()
            return is_so()

        self.client.wait(is_done, 3 * PATIENCE)

    def send(self, **fields):
        """Send a goal of the action; its handle."""
        assert self.action.wait_for_server(timeout_sec=PATIENCE)
        future = self.action.send_goal_async(
            Explore.Goal(**fields), feedback_callback=self.feedback.append
        )
        self.client.wait(future.done)
        return future.result()

    def result(self, handle):
        future = handle.get_result_async()
        self.until(future.done)
        return future.result()


@pytest.fixture(scope="module")
def place():
    place = Place("/hall")
    quick = "-p", "exploration.stuck_timeout:=1.0", "-p", "exploration.lost_timeout:=1.0"
    with node_process("exploration", *quick, namespace="/hall"):
        yield place
    place.client.close()


def test_an_action_that_is_cancelled(place):
    boundary = PolygonStamped()
    boundary.header.frame_id = "map"
    boundary.polygon.points = [Point32(x=x, y=y) for x, y in CORNERS]
    handle = place.send(boundary=boundary, min_gain=1.0)
    assert handle.accepted
    place.until(lambda: place.state == ExplorationStatus.DRIVING)
    corners = place.client.newest["boundary"].polygon.points
    assert [(corner.x, corner.y) for corner in corners] == CORNERS
    goal = place.goals[-1].pose.position
    assert 2.5 < goal.x < 7.0
    assert 0.0 < goal.y < 4.5
    place.until(lambda: {"places", "boundary", "goal"} <= place.shown)
    assert place.feedback[-1].feedback.status.elapsed > 0.0
    cancelled = handle.cancel_goal_async()
    place.until(cancelled.done)
    outcome = place.result(handle)
    assert outcome.status == GoalStatus.STATUS_CANCELED
    assert outcome.result.status.end == ExplorationStatus.STOPPED
    place.until(lambda: place.state == ExplorationStatus.ENDED)


def test_an_action_that_ends_and_one_that_is_refused(place):
    # What is beyond the hall's known half never shows: looked for in vain, or given up.
    outcome = place.result(place.send(distance_limit=3.0))
    ends = ExplorationStatus.DONE, ExplorationStatus.LIMIT
    assert outcome.status == GoalStatus.STATUS_SUCCEEDED
    assert outcome.result.status.end in ends
    assert outcome.result.status.covered_area > 5.0
    refused = place.result(place.send(min_gain=-1.0))
    assert refused.status == GoalStatus.STATUS_ABORTED
    assert refused.result.status.reason == "refused: min_gain: -1 is not a number from 0 on"


def test_services_start_pause_and_stop(place):
    call = place.client.call
    assert not call("exploration/stop", Trigger).success
    assert not call("exploration/pause", SetBool, data=True).success
    place.goals.clear()
    assert call("exploration/start", Trigger).success
    place.until(lambda: place.state == ExplorationStatus.DRIVING)
    assert call("exploration/pause", SetBool, data=True).success
    place.until(lambda: place.state == ExplorationStatus.PAUSED)
    assert place.statuses[-1].reason == "it was asked to pause"
    assert call("exploration/pause", SetBool, data=False).success
    place.until(lambda: place.state != ExplorationStatus.PAUSED)
    assert call("exploration/start", Trigger).success  # anew
    assert call("exploration/stop", Trigger).success
    place.until(lambda: place.state == ExplorationStatus.ENDED)
    assert place.statuses[-1].end == ExplorationStatus.STOPPED


def test_a_robot_that_stays_lost(place):
    place.goals.clear()
    assert place.client.call("exploration/start", Trigger).success
    place.until(lambda: place.state == ExplorationStatus.DRIVING)
    lost, found = LocalizationStatus.LOST, LocalizationStatus.TRACKING
    place.client.publish("localization/status", LocalizationStatus(state=lost), LATCHED)
    place.until(lambda: place.state == ExplorationStatus.ENDED)
    assert place.statuses[-1].end == ExplorationStatus.LOST
    assert place.statuses[-1].reason.startswith("localization has been LOST for")
    waited = [s for s in place.statuses if s.state == ExplorationStatus.PAUSED]
    assert waited[-1].reason == "localization is LOST"
    place.client.publish("localization/status", LocalizationStatus(state=found), LATCHED)


def test_a_robot_that_does_not_move(place):
    place.obeys = False
    place.until(lambda: place.state == ExplorationStatus.ENDED)
    place.goals.clear()
    outcome = place.result(place.send())
    assert outcome.status == GoalStatus.STATUS_ABORTED
    assert outcome.result.status.end == ExplorationStatus.STUCK
    told = "the robot has not moved for 5 goals: the robot has not moved for "
    assert outcome.result.status.reason.startswith(told)
    sent = {(goal.pose.position.x, goal.pose.position.y) for goal in place.goals}
    assert len(sent) == 5


def test_codes_are_those_of_the_message():
    exploration = Exploration(with_values(Params(), {}))
    for code in (*type(exploration.state), *type(exploration.end)):
        assert getattr(ExplorationStatus, code.name) == code


def test_a_simulated_robot_explores_by_the_nodes():
    """Up to a limit, and back home: mapping, planning and path_follower do what they are told."""
    client = Client("/robot")
    statuses, plans = [], []
    client.node.create_subscription(
        ExplorationStatus, "exploration/status", statuses.append, LATCHED
    )
    client.node.create_subscription(PlanStatus, "planning/status", plans.append, LATCHED)
    arguments = {
        "simulator": ["simulator.true_odometry:=true", "simulator.scan_rate:=12.5"],
        "exploration": [
            "exploration.start_at_once:=true", "exploration.return_home:=true",
            "exploration.distance_limit:=1.0",
        ],
    }  # fmt: skip
    params = "--params-file", str(ROOT / "config" / "atrvjr.yaml")
    with ExitStack() as stack:
        for name in ("mapping", "planning", "path_follower", "exploration", "simulator"):
            given = [word for value in arguments.get(name, []) for word in ("-p", value)]
            stack.enter_context(node_process(name, *params, *given, namespace="/robot"))
        client.wait(lambda: statuses and statuses[-1].end, 6 * PATIENCE)
    client.close()
    assert statuses[-1].end == ExplorationStatus.LIMIT
    assert "the robot is back home" in statuses[-1].reason
    assert statuses[-1].distance < 4.0
    assert {status.state for status in statuses} >= {
        ExplorationStatus.LOOKING, ExplorationStatus.DRIVING, ExplorationStatus.RETURNING
    }  # fmt: skip
    assert any(plan.code == PlanStatus.NONE and plan.length > 0.5 for plan in plans)
