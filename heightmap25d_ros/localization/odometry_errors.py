# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a robot's odometry errs, and what that makes of a motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.params.sections import Params

TILT_LENGTH = 0.3
"""Way [m] over which errors of roll and pitch persist."""


@dataclass(eq=False, slots=True, kw_only=True)
class OdometryErrors:
    """How a robot's odometry errs, as learned so far.

    Attributes
    ----------
    mean : (4,) float64
        Slip, scale of distances, scale of turns, turn of the heading per distance [rad/m]: all to
        be added to what odometry tells.
    covariance : (4, 4) float64
    slip_variance : float
        About which the slip comes and goes.
    turn_variance : float [rad]
        That turning by a radian adds to the yaw [rad^2], besides these.
    """

    mean: Array
    covariance: Array
    slip_variance: float
    turn_variance: float


def unknown_errors(params: Params) -> OdometryErrors:
    """Nothing has been learned yet."""
    prior = params.scan_filter
    spread = (prior.slip, prior.distance_scale, prior.turn_scale, prior.heading_bias)
    return OdometryErrors(
        mean=np.zeros(4),
        covariance=np.diag(np.square(spread)),
        slip_variance=prior.slip**2,
        turn_variance=prior.turn_noise**2,
    )


class Motion(NamedTuple):
    """A motion as odometry tells it, in the frame that the pose is estimated in.

    Attributes
    ----------
    step : (3,) float64 [m]
        Change of the position.
    turn : float [rad]
    forward : float [m]
        Of the step, along the heading before.
    """

    step: Array
    turn: float
    forward: float

    @classmethod
    def between(
        cls, T_map_odom: se3.Matrix, T_odom_before: se3.Matrix, T_odom_base: se3.Matrix
    ) -> Motion:
        """From one pose (4, 4) of the odometry to the next."""
        step = (T_map_odom @ (T_odom_base - T_odom_before))[:3, 3]
        heading = se3.yaw(T_map_odom @ T_odom_before)
        forward = float(step[0] * np.cos(heading) + step[1] * np.sin(heading))
        return cls(step, se3.yaw(T_odom_base @ se3.inverse(T_odom_before)), forward)

    def error(self, mean: Array) -> tuple[tuple[float, float, float], float]:
        """What errors (4,), as of `OdometryErrors`, add to it: a shift [m] and a yaw [rad]."""
        slip, scale, turn_scale, bias = mean
        x, y, z = (slip + scale) * self.step
        return (x, y, z), float(turn_scale * self.turn + bias * self.forward)


def corrected(
    T_map_odom: se3.Matrix, T_odom_before: se3.Matrix, T_odom_base: se3.Matrix, mean: Array
) -> se3.Matrix:
    """The transform (4, 4) after a motion whose errors (4,) are taken out."""
    shift, yaw = Motion.between(T_map_odom, T_odom_before, T_odom_base).error(mean)
    return se3.correction_about(T_map_odom @ T_odom_base, shift, yaw) @ T_map_odom
