# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Short excursions of the odometry: poses wait for the next ones.

A glitch of the IMU, a slip of the scan matcher: for a few messages the pose is off by degrees or
decimetres, and then it is back, which no robot can do. What is read meanwhile would be written
where it is not. So a pose that leaves the motion of before by more than the usual noise waits, and
those after it do, until the motion goes on where it was left (the poses between are skipped), or
``spike_time`` has passed (then the robot has moved, and all are used).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.io.decode import Odometry
from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.params.sections import OdometryParams
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.odometry_gate import SKIPPED

_FLOOR = np.array([0.05, 0.03, 0.026, 0.035])
"""Usual deviations in the plane [m], of z [m], of the vertical axis and of the yaw [rad]."""

_ACCELERATION = np.array([10.0, 10.0, 20.0, 20.0])  # [m/s^2], [rad/s^2] that are usual
_NOISE = 8.0  # times the mean deviation that are usual as well
_NOISE_SHARE = 0.02  # of a new deviation in that mean
_VELOCITY_TIME = 0.1  # [s] over which the velocity is averaged
_IS_BACK = 0.4  # share of the first deviation within which the motion goes on
_YAW = 6  # place in the state: x, y, z, vertical axis (3), yaw


class OdometrySpikes:
    """Holds back poses that leave the motion, until it is known whether they were a spike.

    Parameters
    ----------
    params : OdometryParams
    dropped : Drops
        Where to count what is skipped.
    """

    def __init__(self, params: OdometryParams, dropped: Drops) -> None:
        self._spike_ns = round(params.spike_time * 1e9)
        self._dropped = dropped
        self._noise = np.zeros(4)
        self._learned = 0
        self.restart()

    def restart(self) -> None:
        """Time started over: nothing of before counts but the noise."""
        self._last: tuple[int, NDArray[np.float64]] | None = None
        self._velocity: NDArray[np.float64] | None = None
        self._waiting: list[tuple[Odometry, NDArray[np.float64]]] = []
        self._limit = _FLOOR

    def admit(self, odometry: Odometry) -> list[Odometry]:
        """The poses to use now, in order: this one, with those that waited, or none yet."""
        state = _state(odometry.T)
        if self._last is None or self._velocity is None or self._is_long_after(odometry):
            return [*self.finish(), *self._use(odometry, state)]
        seconds = (odometry.stamp_ns - self._last[0]) * 1e-9
        deviation = _deviation(state, self._last[1], seconds, self._velocity)
        if not self._waiting:
            usual = np.maximum(_FLOOR + _ACCELERATION * seconds**2, _NOISE * self._noise)
            self._limit = _IS_BACK * usual * (deviation / usual).max()
            self._learn(np.minimum(deviation, 2.0 * usual))
            if (deviation <= usual).all():
                return self._use(odometry, state)
        elif (deviation <= self._limit).all():
            self._dropped.record(SKIPPED, self._told(), len(self._waiting))
            self._waiting.clear()
            return self._use(odometry, state)
        self._waiting.append((odometry, state))
        has_stayed = odometry.stamp_ns - self._waiting[0][0].stamp_ns >= self._spike_ns
        return self.finish() if has_stayed else []

    def finish(self) -> list[Odometry]:
        """The poses that wait are where the robot is: it stays there, or no more will come."""
        stayed, self._waiting = self._waiting, []
        if stayed:  # a step is no velocity
            self._last = self._velocity = None
        return [used for odometry, state in stayed for used in self._use(odometry, state)]

    def _use(self, odometry: Odometry, state: NDArray[np.float64]) -> list[Odometry]:
        if self._last is not None and odometry.stamp_ns > self._last[0]:
            seconds = (odometry.stamp_ns - self._last[0]) * 1e-9
            is_first = self._velocity is None
            share = 1.0 if is_first else min(seconds / _VELOCITY_TIME, 1.0)
            before = np.zeros(len(state)) if is_first else self._velocity
            self._velocity = _averaged(before, state, self._last[1], seconds, share)
        self._last = odometry.stamp_ns, state
        return [odometry]

    def _is_long_after(self, odometry: Odometry) -> bool:
        """Whether a pose comes so late that the motion before says nothing about it."""
        assert self._last is not None
        return odometry.stamp_ns > self._last[0] + 2 * self._spike_ns

    def _learn(self, deviation: NDArray[np.float64]) -> None:
        """Take a deviation into the mean, of which the first ones are all that is known."""
        self._learned += 1
        self._noise += max(_NOISE_SHARE, 1.0 / self._learned) * (deviation - self._noise)

    def _told(self) -> str:
        first, last = self._waiting[0][0].stamp_ns, self._waiting[-1][0].stamp_ns
        return f"{len(self._waiting)} poses within {(last - first) * 1e-9:.3g} s left the motion"


def _state(T: se3.Matrix) -> NDArray[np.float64]:
    """(7,): position, vertical axis and yaw of a pose (4, 4)."""
    return np.array([*T[:3, 3], *T[:3, 2], math.atan2(T[1, 0], T[0, 0])])


@kernel
def _deviation(state: Array, last: Array, seconds: float, velocity: Array) -> Array:
    """(4,), as `_FLOOR`: how far a state is from where another one leads in so many seconds."""
    away = _difference(state, last + seconds * velocity)
    x, y, z, axis_x, axis_y, axis_z, yaw = away
    tilt = math.sqrt(axis_x * axis_x + axis_y * axis_y + axis_z * axis_z)
    return np.array([math.hypot(x, y), abs(z), tilt, abs(yaw)])


@kernel
def _averaged(velocity: Array, state: Array, last: Array, seconds: float, share: float) -> Array:
    """(7,): a mean velocity, of which that between two states becomes a share."""
    latest: Array = _difference(state, last) / seconds
    return velocity + share * (latest - velocity)


@kernel
def _difference(a: Array, b: Array) -> Array:
    """(7,): ``a - b``, the yaw within half a turn."""
    difference = a - b
    difference[_YAW] -= 2.0 * math.pi * np.rint(difference[_YAW] / (2.0 * math.pi))
    return difference
