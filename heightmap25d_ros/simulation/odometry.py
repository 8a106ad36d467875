# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated odometry: dead reckoning by wheels and an inclinometer."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryNoise:
    """Errors of wheels and inclinometer; all zero: exact.

    The biases are drawn once per drive: 0.7 to 1.3 times these, with either sign, the same for the
    two of the heading. With the defaults one lap in the world ``room`` ends with an error of about
    0.7 m and 6 degrees, as in the paper.

    Attributes
    ----------
    translation_bias : float
        Error of the distance per distance.
    rotation_bias : float
        Error of the turn per turn: the track width of a skid-steered robot is uncertain.
    heading_bias : float [rad/m]
        Unequal wheels.
    slip, slip_length : float, float [m]
        Slip of the wheels: error of the distance per distance along the surface, that comes and
        goes (Gauss-Markov, mean zero). Its standard deviation, and over how much distance it
        lasts. Where it is positive the wheels turn more than the robot moves, and the odometry
        reports too much distance, on a slope too much climb with it. Over a distance d, longer
        than it lasts, the error has a standard deviation of ``slip * sqrt(2 d slip_length)``.
    heading_walk : float [rad/sqrt(m)]
        Random walk with the distance travelled.
    tilt_sigma, tilt_time : float [rad], [s]
        Error of roll and pitch of the inclinometer: spread, and correlation time.
    """

    translation_bias: float = 0.012
    rotation_bias: float = 0.0095
    heading_bias: float = radians(0.10)
    slip: float = 0.055
    slip_length: float = 3.0
    heading_walk: float = radians(0.25)
    tilt_sigma: float = radians(0.3)
    tilt_time: float = 0.5


EXACT_ODOMETRY = OdometryNoise(
    translation_bias=0.0, rotation_bias=0.0, heading_bias=0.0, slip=0.0, heading_walk=0.0,
    tilt_sigma=0.0,
)  # fmt: skip


class Odometer:
    """Dead reckoning: distance and turn from the wheels, roll and pitch from the inclinometer.

    Parameters
    ----------
    noise : OdometryNoise
    rng : numpy.random.Generator

    Attributes
    ----------
    T : (4, 4) float64 [m], odom
        The estimated pose of base_link.
    """

    def __init__(self, noise: OdometryNoise, rng: np.random.Generator) -> None:
        self._noise, self._rng = noise, rng
        way_sign, side = rng.choice([-1.0, 1.0], 2)
        spreads = rng.uniform(0.7, 1.3, 3)
        self._translation_scale = 1.0 + way_sign * spreads[0] * noise.translation_bias
        self._rotation_scale = 1.0 + side * spreads[1] * noise.rotation_bias
        self._heading_bias = side * spreads[2] * noise.heading_bias
        self._slip = rng.normal(0.0, 1.0, 1) * noise.slip
        self._tilt_error = rng.normal(0.0, 1.0, 2) * noise.tilt_sigma
        self._position, self._yaw = np.zeros(3), 0.0
        self.T = np.eye(4)

    def advance(self, T_before: se3.Matrix, T_after: se3.Matrix, seconds: float) -> se3.Matrix:
        """Integrate a true motion over a time step; returns the estimated pose after it."""
        noise = self._noise
        way = float(T_before[:3, 0] @ (T_after - T_before)[:3, 3])
        before, after = se3.to_xyz_rpy(np.stack([T_before, T_after]))
        turn = float(np.angle(np.exp(1j * (after[5] - before[5]))))
        self._slip = self._wander(self._slip, noise.slip, abs(way) / noise.slip_length)
        self._tilt_error = self._wander(
            self._tilt_error, noise.tilt_sigma, seconds / noise.tilt_time
        )
        known_way = (self._translation_scale + float(self._slip[0])) * way
        known_turn = (
            self._rotation_scale * turn
            + self._heading_bias * way
            + noise.heading_walk * np.sqrt(abs(way)) * float(self._rng.normal())
        )
        tilt = after[3:5] + self._tilt_error
        middle = self._yaw + 0.5 * known_turn
        level = known_way * np.cos(tilt[1])
        climb = -known_way * np.sin(tilt[1])
        self._position += (level * np.cos(middle), level * np.sin(middle), climb)
        self._yaw += known_turn
        self.T = se3.from_xyz_rpy([*self._position, *tilt, self._yaw])
        return self.T

    def _wander(self, error: Array, sigma: float, passed: float) -> Array:
        """A correlated error (Gauss-Markov) after a part of its correlation time or length."""
        kept = np.exp(-passed)
        fresh = self._rng.normal(0.0, 1.0, len(error)) * sigma
        return np.asarray(kept * error + np.sqrt(1.0 - kept**2) * fresh)
