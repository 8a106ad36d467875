# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulator node over DDS: commands in, and everything that a robot says out."""

from __future__ import annotations

import subprocess
from collections import Counter
from collections.abc import Iterator

import pytest
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from node_client import LATCHED, PATIENCE, Client, node_process, start
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

from heightmap25d_ros.params.sections import SimulatorParams
from heightmap25d_ros.params.spec import specs
from heightmap25d_ros.simulation.recording import BUILDERS

KINDS = {
    "scan": (LaserScan, qos_profile_sensor_data),
    "scan_down": (LaserScan, qos_profile_sensor_data),
    "odom": (Odometry, 10),
    "ground_truth": (Odometry, 10),
    "/tf": (TFMessage, 10),
    "/tf_static": (TFMessage, LATCHED),
    "/clock": (Clock, 10),
}


@pytest.fixture
def client() -> Iterator[Client]:
    made = Client()
    yield made
    made.close()


def seconds(stamp) -> float:
    return stamp.sec - 10**9 + stamp.nanosec * 1e-9


def test_worlds_are_those_of_the_parameter() -> None:
    choices = {name: spec.choices for name, spec, _ in specs(SimulatorParams())}["world"]
    assert set(choices) == set(BUILDERS)


def test_robot_drives_on_command_and_stops_without(client: Client) -> None:
    newest, counts = {}, Counter()

    def keep(topic):
        def take(message) -> None:
            newest[topic] = message
            counts[topic] += 1

        return take

    for topic, (kind, quality) in KINDS.items():
        client.node.create_subscription(kind, topic, keep(topic), quality)
    with node_process("simulator", "-p", "simulator.world:=moving", "-p", "simulator.rate:=3.0"):
        client.wait(lambda: len(newest) == len(KINDS))
        command = Twist()
        command.linear.x = 0.8

        def x() -> float:
            return newest["ground_truth"].pose.pose.position.x

        def drive_on() -> bool:
            client.publish("cmd_vel", command)
            return x() > 1.0

        client.wait(drive_on)
        before = seconds(newest["/clock"].clock)
        client.wait(lambda: seconds(newest["/clock"].clock) > before + 3.0)
        assert newest["ground_truth"].twist.twist.linear.x == 0.0
        stopped = x()
        client.wait(lambda: seconds(newest["/clock"].clock) > before + 4.0)
        assert x() == stopped
        assert stopped < 3.0
    assert newest["scan"].header.frame_id == "laser"
    assert len(newest["scan_down"].ranges) == 361
    assert abs(newest["odom"].pose.pose.position.x - stopped) < 0.3
    assert {t.child_frame_id for t in newest["/tf_static"].transforms} == {"laser", "laser_down"}
    assert newest["/tf"].transforms[0].header.frame_id == "odom"
    assert counts["scan"] > 0.5 * 37.5 * 4.0


@pytest.mark.parametrize("wrong", ["simulator.world:=moon", "simulator.wrold:=room"])
def test_wrong_parameters_are_refused(wrong: str) -> None:
    process = start("nodes.simulator", "--ros-args", "-p", wrong, stderr=subprocess.PIPE)
    _, log = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert "simulator.world" in log
