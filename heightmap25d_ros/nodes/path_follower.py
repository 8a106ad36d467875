# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The path follower: a plan in, cmd_vel out, for robots without a controller of their own."""

from __future__ import annotations

import sys
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped, Twist, TwistStamped
from nav_msgs.msg import Path
from tf2_msgs.msg import TFMessage

from heightmap25d_msgs.msg import LocalizationStatus, PlanStatus
from heightmap25d_ros.control.pure_pursuit import Velocity
from heightmap25d_ros.io import encode
from heightmap25d_ros.nodes import qos, runtime
from heightmap25d_ros.nodes.interface import Input, Output
from heightmap25d_ros.nodes.lifecycle import ManagedNode
from heightmap25d_ros.nodes.map_source import map_inputs
from heightmap25d_ros.nodes.pose_source import pose_inputs
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.path_following import PathFollowing
from heightmap25d_ros.pipelines.silence import CHECKS
from heightmap25d_ros.planning.planner import compile_kernels

_LAST_STOPS = 25
"""Commands to stand that follow a drive; then others may command the robot."""


class PathFollowerNode(ManagedNode):
    """Hands messages to `PathFollowing`, and publishes its velocities as odometry comes.

    Where the odometry does not come any more, a timer of the node's clock stops the robot.
    """

    NAME = "path_follower"
    PARAMETERS = (
        "path_follower", "traversability", "levels", "planner", "mapping.map_frame",
        "intake.base_frame", "intake.pose_source", "intake.odom_frame", "intake.odom_gap",
    )  # fmt: skip

    def inputs(self) -> list[Input]:
        """The plan, the robot, and whatever says that the robot must not drive."""
        following = self._following
        return [
            Input(Path, "plan", following.take_plan, qos.LATCHED),
            *pose_inputs(
                self.params.intake, self._on_odometry, self._on_transforms, self.flatness
            ),
            Input(
                PoseWithCovarianceStamped, "pose_correction", following.take_correction, qos.QUEUE
            ),
            *map_inputs(
                self, following.take_map, following.take_map_update, following.take_upper_surfaces,
                is_needed=False,
            ),
            Input(
                LocalizationStatus, "localization/status", following.take_localization_status,
                qos.LATCHED,
            ),
            Input(PlanStatus, "planning/status", following.take_plan_status, qos.LATCHED),
        ]  # fmt: skip

    def outputs(self) -> list[Output]:
        """The command."""
        kind = TwistStamped if self.params.path_follower.stamped else Twist
        return [Output(kind, "cmd_vel", qos.QUEUE)]

    def set_up(self) -> None:
        """Make the controller; nothing is commanded before there is a plan."""
        self._following = PathFollowing(self.params)
        self._velocity = Velocity(0.0, 0.0)
        self._stops = 0
        self._told = ""
        compile_kernels()

    def start(self) -> None:
        """Look for silence by the node's clock."""
        self.create_timer(self.params.path_follower.timeout / CHECKS, self._pass_time)

    def take_params(self) -> None:
        """Apply new parameters, from the next path on."""
        self._following.set_params(self.params)

    def finish(self) -> bool:
        """The robot stands when the node ends."""
        if self.is_active and self._stops:
            self._publish(Velocity(0.0, 0.0))
        return True

    @property
    def dropped(self) -> Drops:
        """How many messages were not used, by reason."""
        return self._following.dropped

    def trouble(self) -> str:
        """Why the robot is halted."""
        return f"halted: {self._following.fault}" if self._following.fault else ""

    def figures(self) -> dict[str, Any]:
        """What /diagnostics reports of the drive."""
        return {
            "follows a path": self._following.has_path,
            "path: remaining [m]": round(self._following.remaining, 2),
            "speed [m/s]": round(self._velocity.speed, 3),
            "turn rate [rad/s]": round(self._velocity.turn_rate, 3),
        }

    def _on_odometry(self, message: Any) -> None:
        self._command(self._following.take_odometry(message))

    def _on_transforms(self, message: TFMessage, is_static: bool) -> None:
        self._following.take_transforms(message, is_static=is_static)

    def _pass_time(self) -> None:
        velocity = self._following.pass_time(self.get_clock().now().nanoseconds)
        if velocity is not None:
            self._command(velocity)

    def _command(self, velocity: Velocity) -> None:
        """Publish a velocity while there is a path, and a while longer to stop."""
        self._tell()
        self._velocity = velocity
        self._stops = _LAST_STOPS if self._following.has_path else max(self._stops - 1, 0)
        if self._stops:
            self._publish(velocity)

    def _publish(self, velocity: Velocity) -> None:
        if not self.params.path_follower.stamped:
            twist = Twist()
            encode.fill_twist(twist, velocity.speed, velocity.turn_rate)
            self.publish("cmd_vel", twist)
            return
        stamped = TwistStamped()
        encode.fill_twist(stamped.twist, velocity.speed, velocity.turn_rate)
        stamp = self.get_clock().now().nanoseconds
        encode.fill_header(stamped.header, stamp, self.params.intake.base_frame)
        self.publish("cmd_vel", stamped)

    def _tell(self) -> None:
        """Say why the robot is halted, and when it goes on."""
        before, self._told = self._told, self._following.fault
        if self._told:
            if not before:
                self.get_logger().warning(f"halted: {self._told}")
        elif before and self._following.has_path:
            self.get_logger().info("drives on")


def main() -> int:
    """Run the node."""
    return runtime.run(PathFollowerNode)


if __name__ == "__main__":
    sys.exit(main())
