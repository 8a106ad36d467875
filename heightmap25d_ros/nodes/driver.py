# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated robot's driver: a plan in, cmd_vel out, by plain pure pursuit.

It belongs to the simulator and is no controller for a robot: it sees no obstacle by itself.
"""

from __future__ import annotations

import sys

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
from nav_msgs.msg import Odometry, Path

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import decode, encode
from heightmap25d_ros.nodes import parameters, qos, runtime
from heightmap25d_ros.nodes.lifecycle import REPORT_PERIOD
from heightmap25d_ros.nodes.plain import PlainNode
from heightmap25d_ros.simulation.pure_pursuit import Driver

_SPEED = 1.0  # [m/s]


class DriverNode(PlainNode):
    """Thin: hands poses to a `Driver` along the newest plan, and publishes its commands.

    Without a plan, and at its end, the robot stands.
    """

    NAME = "driver"
    PARAMETERS: tuple[str, ...] = ("intake.base_frame",)

    def __init__(self) -> None:
        super().__init__()
        self._base_frame = parameters.declare_params(self, self.PARAMETERS).intake.base_frame
        self._T_map_odom = np.eye(4)
        self._driver: Driver | None = None
        self._outlet = self.create_publisher(Twist, "cmd_vel", 10)
        self.create_subscription(Path, "plan", self._on_plan, qos.LATCHED)
        self.create_subscription(Odometry, "odom", self._on_odometry, 10)
        self.create_subscription(
            PoseWithCovarianceStamped, "pose_correction", self._on_correction, 10
        )

    def _on_plan(self, message: Path) -> None:
        self._driver = None
        try:
            points = decode.path(message)
        except InputError as error:
            self._complain(error)
            return
        if len(points) > 1:
            self._driver = Driver(points, _SPEED)

    def _on_correction(self, message: PoseWithCovarianceStamped) -> None:
        try:
            self._T_map_odom = decode.pose(message.pose.pose, "pose.pose")
        except InputError as error:
            self._complain(error)

    def _on_odometry(self, message: Odometry) -> None:
        try:
            odometry = decode.odometry(message, self._base_frame)
        except InputError as error:
            self._complain(error)
            return
        if odometry.child_frame_id != self._base_frame:
            return
        speed, turn_rate = 0.0, 0.0
        if self._driver is not None:
            speed, turn_rate = self._driver.command(self._T_map_odom @ odometry.T)
        command = Twist()
        encode.fill_twist(command, speed, turn_rate)
        self._outlet.publish(command)

    def _complain(self, error: InputError) -> None:
        self.get_logger().warning(f"dropped: {error}", throttle_duration_sec=REPORT_PERIOD)


def main() -> int:
    """Run the node."""
    return runtime.run(DriverNode)


if __name__ == "__main__":
    sys.exit(main())
