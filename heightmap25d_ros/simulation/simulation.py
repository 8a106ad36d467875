# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""World, robot and sensors in time steps; the sensors' output as ROS messages.

The map frame is the start pose of the robot: ground zero is its altitude there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.pose_interpolation import interpolate
from heightmap25d_ros.simulation import lasers, messages
from heightmap25d_ros.simulation.cloud_sensors import DepthCamera, Lidar
from heightmap25d_ros.simulation.lasers import (
    EXACT_RANGES,
    SCAN_DURATION,
    Laser,
    RangeNoise,
    TakenScan,
    take_scan,
)
from heightmap25d_ros.simulation.messages import Message
from heightmap25d_ros.simulation.odometry import EXACT_ODOMETRY, Odometer, OdometryNoise
from heightmap25d_ros.simulation.robot import Robot
from heightmap25d_ros.simulation.worlds import World

STEP = 0.005
"""Of time [s]."""

_ODOMETRY_PERIOD = 0.02
_WAIT = 2 * SCAN_DURATION  # [s] after the end of a scan until it is taken, at most

Sensor = Laser | Lidar | DepthCamera


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Noise of all sensors."""

    ranges: RangeNoise = field(default_factory=RangeNoise)
    odometry: OdometryNoise = field(default_factory=OdometryNoise)


NOISE_FREE = Noise(ranges=EXACT_RANGES, odometry=EXACT_ODOMETRY)


class TimedMessage(NamedTuple):
    """A message and the time [s] at which it is available."""

    seconds: float
    topic: str
    message: Message


class Simulation:
    """The state of the simulation, advanced by `step`.

    Parameters
    ----------
    world : World
    seed : int or sequence of int
        Of the noise.
    noise : Noise
    mounted : sequence of Laser, Lidar and DepthCamera
    step : float [s]
        Of time, a whole part of 0.02 s.

    Attributes
    ----------
    robot : Robot
    seconds : float
        Since the start.
    scans : list of (sensor, TakenScan)
        The scans that ended in the last step, with their ground truth.
    """

    def __init__(
        self,
        world: World,
        seed: int | Sequence[int],
        noise: Noise | None = None,
        mounted: Sequence[Sensor] = (lasers.LEVEL, lasers.DOWN),
        step: float = STEP,
    ) -> None:
        self._step = step
        self._odometry_steps = round(_ODOMETRY_PERIOD / step)
        self._noise = noise or Noise()
        self._scene = world.scene()
        self._lasers = tuple(mounted)
        streams = np.random.SeedSequence(seed).spawn(1 + len(self._lasers))
        self._rngs = [np.random.default_rng(stream) for stream in streams]
        self._odometer = Odometer(self._noise.odometry, self._rngs[0])
        self._taken = [0] * len(self._lasers)
        self._count = 0
        self.robot = Robot(self._scene)
        self.scans: list[tuple[Sensor, TakenScan]] = []
        longest = max((sensor.duration for sensor in mounted), default=0.0)
        history = 1 + round((longest + _WAIT) / step)
        self._poses = deque([self.robot.T], maxlen=history)
        self._T_at_odometry = self.robot.T

    @property
    def seconds(self) -> float:
        """Time since the start."""
        return self._count * self._step

    @property
    def is_at_pose(self) -> bool:
        """Whether the last step produced odometry."""
        return self._count % self._odometry_steps == 0

    def begin(self) -> list[TimedMessage]:
        """The messages before the first step: mounts and first pose."""
        fixed = [
            (laser.frame_id, laser.T_base_sensor(np.zeros(1))[0])
            for laser in self._lasers
            if not laser.nod
        ]
        mounts = messages.transforms(0.0, "base_link", fixed)
        return [TimedMessage(0.0, "/tf_static", mounts), *self._pose_events()]

    def step(self, speed: float, turn_rate: float) -> list[TimedMessage]:
        """Advance by a step under a command [m/s], [rad/s]; returns its messages in order."""
        self._scene.set_time(self.seconds)
        self.robot.move(speed, turn_rate, self._step)
        self._count += 1
        self._poses.append(self.robot.T)
        events = self._take_scans()
        if self.is_at_pose:
            elapsed = self._step * self._odometry_steps
            self._odometer.advance(self._T_at_odometry, self.robot.T, elapsed)
            self._T_at_odometry = self.robot.T
            events += self._pose_events()
        return sorted(events, key=lambda event: event.seconds)

    def _pose_events(self) -> list[TimedMessage]:
        seconds, robot = self.seconds, self.robot
        twist = (robot.speed, robot.turn_rate)
        known = self._odometer.T if self._noise.odometry != EXACT_ODOMETRY else robot.T
        events = [
            TimedMessage(seconds, "/odom", messages.odometry(seconds, "odom", known, twist)),
            TimedMessage(
                seconds, "/ground_truth", messages.odometry(seconds, "map", robot.T, twist)
            ),
            TimedMessage(
                seconds, "/tf", messages.transforms(seconds, "odom", [("base_link", known)])
            ),
        ]
        nodding = [
            (laser.frame_id, laser.T_base_sensor(np.array([seconds]))[0])
            for laser in self._lasers
            if laser.nod
        ]
        if nodding:
            nods = messages.transforms(seconds, "base_link", nodding)
            events.append(TimedMessage(seconds, "/tf", nods))
        return events

    def _take_scans(self) -> list[TimedMessage]:
        """The scans that ended in the last step."""
        self.scans, events = [], []
        for index, laser in enumerate(self._lasers):
            start = laser.first_scan + self._taken[index] / laser.rate
            end = start + laser.duration
            if end > self.seconds:
                continue
            self._taken[index] += 1
            poses = self._poses_at(laser.beam_times(start))
            scan = take_scan(
                laser, self._scene, start, poses, self._noise.ranges, self._rngs[index + 1]
            )
            self.scans.append((laser, scan))
            events.append(TimedMessage(end, laser.topic, messages.scan(laser, scan)))
        return events

    def _poses_at(self, seconds: Array) -> se3.Matrix:
        """True poses (N, 4, 4) at times within the history."""
        first = self._count - len(self._poses) + 1
        stamps = np.rint((first + np.arange(len(self._poses))) * self._step * 1e9).astype(np.int64)
        query = np.rint(seconds * 1e9).astype(np.int64)
        return interpolate(stamps, np.array(self._poses), query)
