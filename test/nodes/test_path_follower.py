# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The path follower over DDS."""

import numpy as np
from bag_writer import odometry, rclpy_type
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import Path
from node_client import LATCHED, Client, node_process

from heightmap25d_msgs.msg import LocalizationStatus

MS = 10**6


class Robot:
    """A client that stands where a test says, and hears what it is commanded."""

    def __init__(self, namespace, kind=Twist):
        self.client = Client(namespace)
        self.commands = []
        self.client.node.create_subscription(kind, "cmd_vel", self.commands.append, 10)
        self._ms = 0

    def stand(self, x, y, yaw):
        """Be at a place until a command comes."""
        self.commands.clear()
        while not self.commands:
            self._ms += 100
            pose = odometry(self._ms * MS, (x, y, 0.0), type_of=rclpy_type)
            rotation = pose.pose.pose.orientation
            rotation.z, rotation.w = np.sin(yaw / 2), np.cos(yaw / 2)
            self.client.publish("odom", pose)
            self.client.spin(0.05)
        newest = getattr(self.commands[-1], "twist", self.commands[-1])
        return newest.linear.x, newest.angular.z

    def until(self, is_so, *place):
        """Be at a place until a command is as a test wants it."""
        while not is_so(*self.stand(*place)):
            pass


def way(*points):
    message = Path()
    message.header.frame_id = "map"
    for x, y in points:
        stamped = PoseStamped()
        stamped.pose.position.x, stamped.pose.position.y = x, y
        message.poses.append(stamped)
    return message


def test_it_follows_the_plan_and_stops_when_nobody_knows_where_it_is():
    robot = Robot("/followed")
    client = robot.client
    silent = "-p", "path_follower.timeout:=1.0"
    with node_process("path_follower", *silent, namespace="/followed") as process:
        client.publish("plan", way((0.0, 0.0), (2.0, 0.0), (4.0, 0.0)), LATCHED)
        robot.until(lambda speed, turn: speed > 0.5 and turn == 0.0, 0.0, 0.0, 0.0)
        robot.until(lambda speed, turn: turn < -0.1, 1.0, 0.3, 0.0)  # left of it: to the right
        robot.until(lambda speed, turn: turn > 0.1, 1.0, -0.3, 0.0)
        robot.until(lambda speed, turn: speed == 0.0 and turn < -0.3, 1.0, 0.0, np.pi / 2)
        status = LocalizationStatus(state=LocalizationStatus.LOST)
        client.publish("localization/status", status, LATCHED)
        robot.until(lambda speed, turn: speed == turn == 0.0, 1.0, 0.0, 0.0)
        status.state = LocalizationStatus.TRACKING
        client.publish("localization/status", status, LATCHED)
        robot.until(lambda speed, turn: speed > 0.2, 1.0, 0.0, 0.0)
        robot.commands.clear()  # no odometry from now on
        client.wait(lambda: any(not c.linear.x and not c.angular.z for c in robot.commands))
        robot.until(lambda speed, turn: speed > 0.2, 1.0, 0.0, 0.0)
        client.publish("plan", Path(), LATCHED)
        robot.until(lambda speed, turn: speed == turn == 0.0, 1.0, 0.0, 0.0)
    client.close()
    assert "halted: localization is LOST" in process.log
    assert "halted: nothing from odometry for" in process.log


def test_stamped_commands():
    robot = Robot("/stamped", TwistStamped)
    stamped = "-p", "path_follower.stamped:=true"
    with node_process("path_follower", *stamped, namespace="/stamped"):
        robot.client.publish("plan", way((0.0, 0.0), (4.0, 0.0)), LATCHED)
        robot.until(lambda speed, turn: speed > 0.1, 0.0, 0.0, 0.0)
        assert robot.commands[-1].header.frame_id == "base_link"
        assert robot.commands[-1].header.stamp.sec > 0
    robot.client.close()
