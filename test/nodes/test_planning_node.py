# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The planning node in its own process, over DDS: behind `mapping` on a bag, and on maps alone."""

import array
import math
import subprocess

import numpy as np
import pytest
from bag_writer import odometry, rclpy_type
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from grid_messages import CELL, grid
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan
from node_client import LATCHED, PATIENCE, Client, mapping_node, node_process, replay, start
from rclpy.qos import DurabilityPolicy, qos_profile_sensor_data
from repository import BAGS
from rosgraph_msgs.msg import Clock

from heightmap25d_msgs.msg import PlanStatus
from heightmap25d_ros.evaluation.path_drivability import evaluate_path
from heightmap25d_ros.evaluation.truth import read_ground

RAMP = BAGS / "ramp"
LASERS = ("-p", "intake.scan_topics:=[scan, scan_down]")
MS = 10**6
STANDING = ("-p", "intake.timeout:=600.0")  # its odometry is published once


def pose_stamped(x, y, yaw=0.0, frame="map"):
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y = float(x), float(y)
    message.pose.orientation.z, message.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return message


def places(path):
    """x, y, z of a Path's poses."""
    return np.array(
        [(p.pose.position.x, p.pose.position.y, p.pose.position.z) for p in path.poses]
    ).reshape(-1, 3)


def headings(path):
    return [2 * math.atan2(p.pose.orientation.z, p.pose.orientation.w) for p in path.poses]


class Planner(Client):
    """A client that knows the newest plan and status, and how many there were."""

    def __init__(self, namespace):
        super().__init__(namespace)
        self.plans, self.statuses = [], []
        for topic, kind, kept in (
            ("plan", Path, self.plans), ("planning/status", PlanStatus, self.statuses),
        ):  # fmt: skip
            self.node.create_subscription(kind, topic, kept.append, 100)

    def goal(self, message):
        """Plan and status that follow upon a goal."""
        count = len(self.statuses)
        self.publish("goal_pose", message)
        self.wait_for_plans(count + 1)
        return self.plans[-1], self.statuses[-1]

    def wait_for_plans(self, count):
        self.wait(lambda: min(len(self.plans), len(self.statuses)) >= count)

    def show(self, height_grid):
        self.publish("height_grid", height_grid, LATCHED)

    def stand(self, x, y, stamp_ms):
        self.publish("odom", odometry(stamp_ms * MS, (x, y, 0.0), type_of=rclpy_type))


@pytest.fixture(scope="module")
def after_the_ramp(tmp_path_factory):
    """`planning` behind `mapping`, when bags/ramp has been replayed into both."""
    client = Planner("")
    directory = tmp_path_factory.mktemp("maps")
    with node_process("planning", *STANDING), mapping_node(directory, *LASERS):
        for topic, count in (("odom", 2), ("height_grid", 1), ("scan", 1), ("scan_down", 1)):
            client.wait(lambda t=topic, n=count: client.node.count_subscribers(t) == n)
        played = replay(RAMP, "--rate", "2")  # what is lost at a stall, the map lacks
        client.wait(lambda: played.poll() is not None, 2 * PATIENCE)
        assert played.returncode == 0
        client.spin(2.0)  # the last map
        yield client
    client.close()


def test_a_goal_across_the_ramp_gets_a_path_that_climbs_it(after_the_ramp):
    path, status = after_the_ramp.goal(pose_stamped(3.0, 0.0, math.pi))
    assert (status.code, status.reason) == (PlanStatus.NONE, "")
    assert path.header.frame_id == "map"
    xyz = places(path)
    np.testing.assert_allclose(xyz[0, :2], (26.0, -0.26), atol=0.15)  # where the drive ends
    np.testing.assert_allclose(xyz[-1, :2], (3.0, 0.0), atol=1e-6)
    assert abs(math.remainder(headings(path)[-1] - math.pi, 2 * math.pi)) < 1e-3
    # From the yard at -1.5 m up to the landing.
    assert xyz[0, 2] == pytest.approx(-1.5, abs=0.03)
    assert xyz[-1, 2] == pytest.approx(0.0, abs=0.03)
    assert status.climb == pytest.approx(1.5, abs=0.1)
    assert math.degrees(status.steepest_slope) == pytest.approx(7.1, abs=1.5)
    ground = read_ground(RAMP / "truth" / "surface.npz")
    driven = evaluate_path(ground, np.column_stack([xyz[:, :2], headings(path)]), 0.78, 0.64)
    assert driven.largest_step_m < 0.1  # never over the edge of the ramp, nor against a wall
    assert math.degrees(driven.steepest_slope_rad) < 9.0


def test_the_poses_lie_on_the_ramp(after_the_ramp):
    path, _ = after_the_ramp.goal(pose_stamped(3.0, 0.0, math.pi))
    on_ramp = [p.pose for p in path.poses if 6.5 < p.pose.position.x < 14.5]
    assert len(on_ramp) > 50
    for pose in on_ramp:
        assert pose.position.z == pytest.approx(-(pose.position.x - 4.0) / 8.0, abs=0.05)
        q = pose.orientation
        # Uphill the nose points up: a negative pitch, of 1 : 8.
        pitch = math.asin(2 * (q.w * q.y - q.z * q.x))
        assert math.degrees(pitch) == pytest.approx(-7.1, abs=2.0)


def test_a_goal_on_a_box_is_refused_and_the_path_is_empty(after_the_ramp):
    path, status = after_the_ramp.goal(pose_stamped(21.7, -1.8))
    assert status.code == PlanStatus.GOAL_OCCUPIED
    assert "the goal is" in status.reason
    assert path.poses == []
    assert path.header.frame_id == "map"


@pytest.mark.parametrize(
    ("message", "code", "reason"),
    [
        (pose_stamped(3.0, 0.0, frame="moon"), PlanStatus.TF_ERROR, "from 'moon' to 'map'"),
        (pose_stamped(math.nan, 0.0), PlanStatus.UNKNOWN, "not a place"),
        (PoseStamped(header=pose_stamped(0, 0).header), PlanStatus.NONE, ""),
        (pose_stamped(500.0, 0.0), PlanStatus.GOAL_OUTSIDE_MAP, "outside of the map"),
    ],
)
def test_goals_that_cannot_be_used_are_refused_with_a_reason(after_the_ramp, message, code, reason):
    if not reason:  # rclpy's default orientation is the identity; a zero one is no rotation
        message.pose.orientation.w = 0.0
        code, reason = PlanStatus.UNKNOWN, "not a unit quaternion"
    path, status = after_the_ramp.goal(message)
    assert status.code == code
    assert reason in status.reason
    assert path.poses == []


def test_get_plan_works_from_anywhere_to_anywhere(after_the_ramp):
    def ask(start, goal, tolerance=0.0):
        return after_the_ramp.call(
            "planning/get_plan", GetPlan, start=start, goal=goal, tolerance=tolerance
        ).plan

    downhill = ask(pose_stamped(4.0, 0.0), pose_stamped(24.0, 0.0, 1.0))
    xyz = places(downhill)
    np.testing.assert_allclose(xyz[[0, -1], :2], [(4.0, 0.0), (24.0, 0.0)], atol=1e-6)
    assert xyz[-1, 2] - xyz[0, 2] == pytest.approx(-1.5, abs=0.05)
    box = pose_stamped(21.7, -1.8)
    assert ask(pose_stamped(4.0, 0.0), box).poses == []
    near = places(ask(pose_stamped(4.0, 0.0), box, tolerance=2.0))
    assert 0.1 < math.hypot(near[-1, 0] - 21.7, near[-1, 1] + 1.8) <= 2.0


def test_an_obstacle_that_appears_on_the_path_leads_to_a_new_one():
    flat = np.zeros((80, 160))
    client = Planner("/blocked")
    with node_process("planning", *STANDING, namespace="/blocked") as process:
        client.show(grid(flat))
        client.stand(2.0, 5.0, 1000)
        path, status = client.goal(pose_stamped(18.0, 5.0))
        assert status.code == PlanStatus.NONE
        assert np.ptp(places(path)[:, 1]) < 0.1  # straight on
        away = flat.copy()
        away[70:, 100:110] = 50.0  # a box that is not on the way
        client.show(grid(away))
        client.spin(1.5)
        assert len(client.plans) == 1
        boxed = away.copy()
        boxed[30:50, 80:84] = 50.0
        client.show(grid(boxed))
        client.wait_for_plans(2)
        around = places(client.plans[-1])
        in_box = (abs(around[:, 0] - 82 * CELL) < 0.7) & (abs(around[:, 1] - 40 * CELL) < 1.6)
        assert not in_box.any()
        np.testing.assert_allclose(around[-1, :2], (18.0, 5.0), atol=1e-6)
        closed = boxed.copy()
        closed[:, 80:84] = 50.0
        client.show(grid(closed))
        client.wait_for_plans(3)
        assert client.plans[-1].poses == []
        assert client.statuses[-1].code == PlanStatus.NO_VALID_PATH
        client.show(grid(boxed))  # the goal has not been forgotten
        client.wait_for_plans(4)
        assert len(client.plans[-1].poses) > 100
        assert process.poll() is None
    client.close()


def test_a_robot_that_leaves_the_path_gets_a_new_one():
    client = Planner("/strayed")
    with node_process("planning", *STANDING, namespace="/strayed"):
        client.show(grid(np.zeros((80, 160))))
        client.stand(2.0, 5.0, 1000)
        client.goal(pose_stamped(18.0, 5.0))
        for step in range(1, 40):  # along the path
            client.stand(2.0 + 0.1 * step, 5.0, 1000 + 20 * step)
        client.spin(0.5)
        assert len(client.plans) == 1
        for step in range(1, 10):  # across it
            client.stand(5.9, 5.0 + 0.1 * step, 2000 + 20 * step)
        client.wait_for_plans(2)
        x, y, _ = places(client.plans[-1])[0]
        assert x == pytest.approx(5.9)
        assert 5.2 < y <= 5.9
    client.close()


def test_no_message_ends_the_node_and_good_ones_still_count():
    client = Planner("/abused")
    short = grid(np.zeros((80, 160)))
    short.height = array.array("h", [0, 0])
    turned = grid(np.zeros((80, 160)))
    turned.info.origin.orientation.z = turned.info.origin.orientation.w = math.sqrt(0.5)
    lost = odometry(900 * MS, (math.nan, 0.0, 0.0), type_of=rclpy_type)
    with node_process("planning", *STANDING, namespace="/abused") as process:
        _, status = client.goal(pose_stamped(18.0, 5.0))
        assert status.code == PlanStatus.UNKNOWN
        assert status.reason == "no map has come yet; the goal is kept"
        for message in (short, turned):
            client.show(message)
            client.spin(0.3)  # before the next one takes its place
        client.publish("odom", lost)
        client.show(grid(np.zeros((80, 160))))
        client.spin(0.5)
        _, status = client.goal(pose_stamped(18.0, 5.0))
        assert status.code == PlanStatus.TF_ERROR
        assert status.reason == "no odometry has come yet; the goal is kept"
        client.stand(2.0, 5.0, 1000)
        _, status = client.goal(pose_stamped(18.0, 5.0))
        assert status.code == PlanStatus.NONE
        client.spin(5.5)  # until the node has told what it dropped
        assert process.poll() is None
    client.close()
    for reason in ("map: bad height", "map: bad info.origin", "odometry: bad pose.pose"):
        assert reason in process.log


def test_who_subscribes_late_gets_the_plan(after_the_ramp):
    path, _ = after_the_ramp.goal(pose_stamped(3.0, 0.0, math.pi))
    late = Client(name="late")
    late.subscribe("plan", Path)
    late.wait(lambda: "plan" in late.newest, 10.0)
    np.testing.assert_array_equal(places(late.newest["plan"]), places(path))
    late.close()


def test_a_misspelt_parameter_is_refused():
    process = start("nodes.planning", "--ros-args", "-p", "planner.climb_wait:=1.0", stderr=subprocess.PIPE)  # fmt: skip  # noqa: E501
    _, log = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert "did you mean planner.climb_weight?" in log


def test_best_effort_odometry_without_a_child_frame_and_goals_in_the_robots_frame():
    overrides = ("-p", "qos_overrides./odd/plan.publisher.durability:=volatile")
    client = Planner("/odd")
    with node_process("planning", *STANDING, *overrides, namespace="/odd") as process:
        client.show(grid(np.zeros((80, 160))))
        message = odometry(MS, (2.0, 5.0, 0.0), child_frame_id="", type_of=rclpy_type)
        client.publish("odom", message, qos_profile_sensor_data)
        path, status = client.goal(pose_stamped(3.0, 1.0, frame="base_link"))
        assert (status.code, status.reason) == (PlanStatus.NONE, "")
        np.testing.assert_allclose(places(path)[[0, -1], :2], [(2.0, 5.0), (5.0, 6.0)], atol=1e-6)
        answer = client.call(
            "planning/get_plan", GetPlan, start=pose_stamped(0.0, 0.0, frame="base_link"),
            goal=pose_stamped(9.0, 5.0, frame="odom"),
        )  # fmt: skip
        np.testing.assert_allclose(places(answer.plan)[[0, -1], :2], [(2.0, 5.0), (9.0, 5.0)])
        (publisher,) = client.node.get_publishers_info_by_topic("plan")
        assert publisher.qos_profile.durability is DurabilityPolicy.VOLATILE
        client.spin(5.5)  # until it reports
    assert process.log.count("taken for 'base_link'") == 1


def test_a_plan_is_stale_while_the_odometry_is_silent_by_the_nodes_clock():
    client = Planner("/silent")
    with node_process("planning", "-p", "use_sim_time:=true", namespace="/silent"):
        client.show(grid(np.zeros((80, 160))))
        client.stand(2.0, 5.0, 1000)
        path, status = client.goal(pose_stamped(18.0, 5.0))
        assert status.code == PlanStatus.NONE
        client.spin(1.5)  # the clock stands
        assert len(client.statuses) == 1
        for tenths in range(15):
            client.publish("/clock", Clock(clock=Time(sec=100, nanosec=tenths * 100 * MS)))
            client.spin(0.05)
        client.wait(lambda: len(client.statuses) == 2)
        stale = client.statuses[-1]
        assert stale.code == PlanStatus.TF_ERROR
        assert "nothing from odometry" in stale.reason
        assert stale.length == status.length
        client.stand(2.0, 5.0, 2000)
        client.publish("/clock", Clock(clock=Time(sec=102)))
        client.wait(lambda: len(client.statuses) == 3)
        assert (client.statuses[-1].code, client.statuses[-1].reason) == (PlanStatus.NONE, "")
        assert client.plans == [path]
    client.close()
