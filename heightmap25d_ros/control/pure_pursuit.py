# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Regulated pure pursuit (Macenski et al., 2023): a path and a pose in, a velocity out.

The robot drives along the arc through a point of the path some way ahead. It is slower in curves,
on slopes, beside obstacles and towards the end of the path; where the path turns sharply it turns
on the spot, and so it does at the end, to the heading of the last pose.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.params.sections import PathFollowerParams

_SPACING = 0.05
"""Between two points of the path as it is followed [m]."""

_CORNER = 0.7
"""A sharper turn within `_CORNER_LENGTH` of the path is a corner, at which the robot turns on the
spot [rad]."""

_CORNER_LENGTH = 0.1
_AT_CORNER = 0.08
"""The robot is at a corner within this distance [m]."""

_FACING = 0.15
"""A turn on the spot ends when the heading is right within this angle [rad]."""

_BRAKING = 0.8
"""Share of the greatest deceleration with which the end of the path is planned for."""


@dataclass(frozen=True, slots=True)
class Velocity:
    """A command: speed along x [m/s] and turn rate about z [rad/s]."""

    speed: float
    turn_rate: float


STANDSTILL = Velocity(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What regulates the speed besides the path.

    Attributes
    ----------
    slope : float [rad]
        The steepest one of the ground ahead.
    clearance : float [m]
        From the robot's disc to the nearest obstacle; infinite without one.
    """

    slope: float = 0.0
    clearance: float = math.inf


class PathFollower:
    """Follows one path.

    Parameters
    ----------
    path : (N, 3) float64 [m, m, rad], map
        x, y and heading; at least one.
    params : PathFollowerParams
    velocity : Velocity, optional
        Of the robot at the start.

    Attributes
    ----------
    is_done : bool
        Whether the robot is at the end, with the heading of the last pose.
    velocity : Velocity
        The newest command.
    """

    def __init__(
        self,
        path: NDArray[np.float64],
        params: PathFollowerParams,
        velocity: Velocity = STANDSTILL,
    ) -> None:
        self._params = params
        self._points = _resampled(path[:, :2])
        self._end_heading = float(path[-1, 2])
        self._corners = _corners(self._points)
        self._at = 0  # index of the nearest point
        self._is_turning = False
        self._is_at_end = False
        self.is_done = False
        self.velocity = velocity

    @property
    def remaining(self) -> float:
        """Length of the path that is left [m]."""
        return _SPACING * (len(self._points) - 1 - self._at)

    def ahead(self, distance: float) -> NDArray[np.float64]:
        """(N, 2) [m], map: the next so many metres of the path."""
        count = 1 + max(1, math.ceil(distance / _SPACING))
        return self._points[self._at : self._at + count]

    def locate(self, T: se3.Matrix) -> float:
        """Go on to the part of the path that a pose (4, 4) is at; its distance from there [m].

        Not past a corner before the robot is there, and not far ahead: paths may cross themselves.
        """
        reach = round(2.0 * self._params.max_lookahead / _SPACING)
        end = min(self._at + reach, self._next_corner()) + 1
        away = np.hypot(*(self._points[self._at : end] - T[:2, 3]).T)
        self._at += int(away.argmin())
        if self._at == self._next_corner() and away.min() <= _AT_CORNER:
            self._at = min(self._at + 1, len(self._points) - 1)
        return float(away.min())

    def command(
        self, T: se3.Matrix, seconds: float, around: Surroundings | None = None
    ) -> Velocity:
        """The velocity at a pose.

        Parameters
        ----------
        T : (4, 4) float64 [m], map
        seconds : float [s]
            Since the command before, which it does not differ from by more than the accelerations
            allow.
        around : Surroundings, optional
        """
        self.locate(T)
        wanted = self._wanted(T, around or Surroundings())
        own = self._params
        self.velocity = Velocity(
            _limited(wanted.speed, self.velocity.speed, own.max_acceleration * seconds),
            _limited(
                wanted.turn_rate, self.velocity.turn_rate, own.max_turn_acceleration * seconds
            ),
        )
        return self.velocity

    def _next_corner(self) -> int:
        """Index of the next corner of the path, or of its end."""
        later = self._corners[self._corners >= self._at]
        return int(later[0]) if len(later) else len(self._points) - 1

    def _wanted(self, T: se3.Matrix, around: Surroundings) -> Velocity:
        own = self._params
        yaw = math.atan2(T[1, 0], T[0, 0])
        to_end = float(np.hypot(*(self._points[-1] - T[:2, 3])))
        # Once there it turns, and does not drive again for being turned off its place.
        self._is_at_end |= self.remaining < own.goal_tolerance and to_end <= own.goal_tolerance
        if self._is_at_end or len(self._points) == 1:
            off = math.remainder(self._end_heading - yaw, 2.0 * math.pi)
            self.is_done = abs(off) <= own.yaw_tolerance
            return STANDSTILL if self.is_done else self._turn(off)
        lookahead = own.lookahead_time * self.velocity.speed
        lookahead = min(max(lookahead, own.min_lookahead), own.max_lookahead)
        until = min(self._at + round(lookahead / _SPACING), self._next_corner())
        target = self._points[until] - T[:2, 3]
        bearing = math.remainder(math.atan2(target[1], target[0]) - yaw, 2.0 * math.pi)
        self._is_turning = abs(bearing) > (_FACING if self._is_turning else own.turn_on_spot)
        if self._is_turning:
            return self._turn(bearing)
        away = max(float(np.hypot(*target)), 1e-3)
        curvature = 2.0 * math.sin(bearing) / max(away, 0.5 * own.min_lookahead)
        rest = max(_SPACING * (self._next_corner() - self._at), away if until else 0.0)
        speed = self._regulated(curvature, rest, around)
        turn_rate = speed * curvature
        if abs(turn_rate) > own.max_turn_rate:
            speed *= own.max_turn_rate / abs(turn_rate)
            turn_rate = math.copysign(own.max_turn_rate, turn_rate)
        return Velocity(speed, turn_rate)

    def _regulated(self, curvature: float, rest: float, around: Surroundings) -> float:
        """The speed [m/s] in a curve [1/m], so far [m] from the end or the next corner."""
        own = self._params
        speed = own.max_speed
        speed *= min(1.0, 1.0 / max(abs(curvature) * own.curve_radius, 1e-9))
        speed *= min(1.0, max(0.0, 1.0 - around.slope / own.slope_stop))
        if own.slow_distance > 0.0:
            speed *= min(1.0, max(0.0, around.clearance) / own.slow_distance)
        speed = max(speed, own.min_speed)
        braking = math.sqrt(2.0 * _BRAKING * own.max_acceleration * max(rest, 0.0))
        return min(speed, max(braking, own.min_speed))

    def _turn(self, angle: float) -> Velocity:
        """Turn on the spot by an angle [rad], braking towards its end."""
        own = self._params
        if abs(self.velocity.speed) > own.min_speed:  # first it stops
            return Velocity(0.0, 0.0)
        rate = min(
            own.turn_rate_on_spot, math.sqrt(_BRAKING * own.max_turn_acceleration * abs(angle))
        )
        return Velocity(0.0, math.copysign(rate, angle))


def _limited(wanted: float, before: float, change: float) -> float:
    return before + min(max(wanted - before, -change), change)


def _resampled(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The path by points about `_SPACING` apart; without repeated ones."""
    lengths = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    if along[-1] < 1e-6:
        return points[-1:]
    count = max(1, round(along[-1] / _SPACING))
    at = np.linspace(0.0, along[-1], count + 1)
    return np.column_stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)])


def _corners(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Indices of the points at which the path turns sharply."""
    near = round(_CORNER_LENGTH / _SPACING)
    if len(points) < 2 * near + 1:
        return np.empty(0, np.int64)
    before = points[near:-near] - points[: -2 * near]
    after = points[2 * near :] - points[near:-near]
    turn = np.arctan2(after[:, 1], after[:, 0]) - np.arctan2(before[:, 1], before[:, 0])
    sharp = np.abs((turn + np.pi) % (2.0 * np.pi) - np.pi)
    # The sharpest point of each bend.
    padded = np.concatenate([[0.0], sharp, [0.0]])
    is_peak = (sharp > _CORNER) & (sharp >= padded[:-2]) & (sharp > padded[2:])
    return np.flatnonzero(is_peak) + near
