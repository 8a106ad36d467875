# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulator, the three nodes and driver over DDS: the robot goes where it is sent."""

import json
import subprocess
import sys

import numpy as np
from bag_writer import odometry, rclpy_type
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Path as PathMessage
from node_client import LATCHED, Client, node_process
from PIL import Image
from repository import ROOT

from heightmap25d_ros.evaluation.truth import read_ground

TRUTH = ROOT / "bags" / "ramp_1" / "truth" / "surface.npz"
MS = 10**6


def test_robot_finds_its_way_over_a_ramp_and_back_on_drifting_odometry(tmp_path):
    done = subprocess.run(
        [sys.executable, ROOT / "studies" / "closed_loop.py", "-o", tmp_path, "--json"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["arrived"] is True
    assert found["status of the last plan"] == "found"
    assert found["plans"] >= 2
    # No detour worth the name; nothing that the robot does not climb.
    straight = found["straight distances to the goals [m]"]
    assert 43.0 < straight <= found["path length [m]"] + 0.6 < 1.2 * straight
    assert found["largest true step under the robot [m]"] < 0.1
    assert found["steepest true slope under the robot [deg]"] < 10.0
    # The landing is at ground zero, the yard as deep as the world has it.
    ground = read_ground(TRUTH)
    yard = ground.height[tuple(ground.geometry.cell_at((24.5, -0.6)))]
    np.testing.assert_allclose(found["lowest and highest [m]"], (yard, 0.0), atol=0.05)
    # It stands within 0.3 m of where it takes the goal to be. On the way back it looks where the
    # long-term map was never made, so that its pose is off by decimetres there.
    _, _, end = found["error of the pose: RMSE, largest, at the end [m]"]
    assert end < 1.0
    assert found["distance to the goal at the end [m]"] < 0.3 + end + 0.05
    assert (tmp_path / "map" / "map.pgm").exists()
    with Image.open(tmp_path / "run.gif") as animation:
        assert animation.n_frames > 20
    assert (tmp_path / "run.gif").stat().st_size < 1_000_000


def test_driver_follows_the_plan_and_stands_without_one():
    client = Client("/driven")
    commands = []
    client.node.create_subscription(Twist, "cmd_vel", commands.append, 10)

    def stand(x, y, yaw, stamp_ms):
        """Be at a place until a command comes."""
        commands.clear()
        pose = odometry(stamp_ms * MS, (x, y, 0.0), type_of=rclpy_type)
        rotation = pose.pose.pose.orientation
        rotation.z, rotation.w = np.sin(yaw / 2), np.cos(yaw / 2)
        client.publish("odom", pose)
        client.wait(lambda: commands)
        return commands[-1].linear.x, commands[-1].angular.z

    way = PathMessage()
    for x in (0.0, 2.0, 4.0):
        stamped = PoseStamped()
        stamped.pose.position.x = x
        way.poses.append(stamped)
    with node_process("driver", namespace="/driven"):
        assert stand(0.0, 0.0, 0.0, 1) == (0.0, 0.0)
        client.publish("plan", way, LATCHED)
        client.spin(0.3)
        speed, turn = stand(0.0, 0.0, 0.0, 2)
        assert speed > 0.5
        assert turn == 0.0
        assert stand(1.0, 0.3, 0.0, 3)[1] < -0.1  # left of the way: to the right
        assert stand(1.0, -0.3, 0.0, 4)[1] > 0.1
        speed, turn = stand(1.0, 0.0, np.pi / 2, 5)
        assert speed == 0.0  # first turns
        assert turn < -0.5
        for x in (2.0, 3.0):
            assert stand(x, 0.0, 0.0, 6)[0] > 0.0
        assert stand(4.0, 0.0, 0.0, 7) == (0.0, 0.0)
        client.publish("plan", way, LATCHED)
        client.spin(0.3)
        assert stand(1.0, 0.0, 0.0, 8)[0] > 0.5
        client.publish("plan", PathMessage(), LATCHED)
        client.spin(0.3)
        assert stand(1.0, 0.0, 0.0, 9) == (0.0, 0.0)
    client.close()
