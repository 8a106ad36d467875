# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulator node: cmd_vel in; scans, odometry, transforms, truth and /clock out."""

from __future__ import annotations

import sys
import time

from geometry_msgs.msg import Twist
from rclpy.clock import Clock as RclpyClock
from rclpy.clock import ClockType
from rosgraph_msgs.msg import Clock

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import decode
from heightmap25d_ros.nodes import parameters, runtime
from heightmap25d_ros.nodes.lifecycle import REPORT_PERIOD
from heightmap25d_ros.nodes.plain import PlainNode
from heightmap25d_ros.nodes.replay import message_class, profile_of
from heightmap25d_ros.simulation import messages, recording
from heightmap25d_ros.simulation.simulation import Simulation, TimedMessage

_PERIOD = 0.01  # [s] between two turns of the node
_LONGEST_TURN = 0.05  # [s] that it computes before it listens again
_COMMAND_HOLDS = 0.5  # [s], simulated: without a new command the robot stops then


class SimulatorNode(PlainNode):
    """Thin: steps a `Simulation` as time passes and publishes what it says, byte for byte."""

    NAME = "simulator"
    PARAMETERS: tuple[str, ...] = ("simulator",)

    def __init__(self) -> None:
        super().__init__()
        params = parameters.declare_params(self, self.PARAMETERS).simulator
        self._rate = params.rate
        mounted = recording.mounted_sensors(
            params.scan_rate,
            has_nodding=params.nodding,
            lidar_rings=params.lidar_rings,
            has_depth_camera=params.depth_camera,
        )
        self._simulation = Simulation(
            recording.world_of(params.world, params.seed),
            params.seed,
            recording.noise_of(noise_free=False, true_odometry=params.true_odometry),
            mounted,
        )
        self._types = {topic: kind for topic, (kind, _) in messages.topics(mounted).items()}
        # Relative, but for those that ROS has one of.
        self._outlets = {
            topic: self.create_publisher(
                message_class(kind),
                topic if topic.startswith("/tf") else topic.removeprefix("/"),
                profile_of(topic, [qos]),
            )
            for topic, (kind, qos) in messages.topics(mounted).items()
        }
        self._clock_outlet = self.create_publisher(Clock, "/clock", 10)
        self._command, self._commanded_at = (0.0, 0.0), 0.0
        self._was_blocked = False
        self.create_subscription(Twist, "cmd_vel", self._on_command, 10)
        self._publish(self._simulation.begin())
        self._turned_at = time.monotonic()
        self._owed = 0.0
        wall_clock = RclpyClock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_PERIOD, self._turn, clock=wall_clock)

    def _on_command(self, message: Twist) -> None:
        try:
            self._command = decode.twist(message)
        except InputError as error:
            self.get_logger().warning(f"dropped: {error}", throttle_duration_sec=REPORT_PERIOD)
            return
        self._commanded_at = self._simulation.seconds

    def _turn(self) -> None:
        """Simulate the time that has passed; what the machine cannot keep up with is let go."""
        now = time.monotonic()
        self._owed = self._simulation.seconds + min(
            self._owed - self._simulation.seconds + self._rate * (now - self._turned_at),
            self._rate * _LONGEST_TURN,
        )
        self._turned_at = now
        while self._simulation.seconds < self._owed and time.monotonic() < now + _LONGEST_TURN:
            self._step()

    def _step(self) -> None:
        age = self._simulation.seconds - self._commanded_at
        command = self._command if age < _COMMAND_HOLDS else (0.0, 0.0)
        events = self._simulation.step(*command)
        if self._simulation.is_at_pose:
            clock = Clock()
            stamp = messages.stamp_ns(self._simulation.seconds)
            clock.clock.sec, clock.clock.nanosec = divmod(stamp, 10**9)
            self._clock_outlet.publish(clock)
        self._publish(events)
        is_blocked = self._simulation.robot.is_blocked
        if is_blocked and not self._was_blocked:
            self.get_logger().warning("blocked: something is higher than the robot climbs")
        self._was_blocked = is_blocked

    def _publish(self, events: list[TimedMessage]) -> None:
        for _, topic, message in events:
            data = bytes(messages.STORE.serialize_cdr(message, self._types[topic]))
            self._outlets[topic].publish(data)


def main() -> int:
    """Run the node."""
    return runtime.run(SimulatorNode)


if __name__ == "__main__":
    sys.exit(main())
