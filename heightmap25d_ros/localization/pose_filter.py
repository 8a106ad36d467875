# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose of odom in the map: a filter of registrations and odometry drift.

x, y and yaw of the robot are filtered (Kalman's filter in its information form, so that a
direction that was not observed is not corrected); z is taken as registered; roll and pitch are
the odometry's. `SmoothCorrection` limits the rate at which the published transform follows.
"""

from __future__ import annotations

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.registration import Registration
from heightmap25d_ros.params.sections import LocalizationParams

Z_VARIANCE = 0.05**2
"""[m^2] of a pose that a registration, or something else than scan after scan, has told."""

_INFLATION = 2.0  # of the covariance after a contradiction


class PoseFilter:
    """The filtered estimate of the transform from odom to map.

    Parameters
    ----------
    params : LocalizationParams
    T_map_odom : (4, 4) float64
    covariance : (3, 3) float64
        Of x, y [m] and yaw [rad] of the robot in the map.

    Attributes
    ----------
    T_map_odom, covariance
    """

    def __init__(
        self, params: LocalizationParams, T_map_odom: se3.Matrix, covariance: Array
    ) -> None:
        self._params = params
        self.T_map_odom, self.covariance = T_map_odom, covariance

    @property
    def z_variance(self) -> float:
        """Of the robot in the map [m^2]: as that of a pose which was registered."""
        return Z_VARIANCE

    @property
    def deviation(self) -> tuple[float, float]:
        """Standard deviations of position [m], along its less certain direction, and yaw [rad]."""
        position = np.linalg.eigvalsh(self.covariance[:2, :2])[-1]
        return float(np.sqrt(position)), float(np.sqrt(self.covariance[2, 2]))

    def predict(self, T_odom_before: se3.Matrix, T_odom_base: se3.Matrix, distance: float) -> None:
        """Add the drift of a motion by odometry, given by two poses (4, 4) and a distance [m]."""
        dx, dy = (self.T_map_odom @ (T_odom_base - T_odom_before))[:2, 3]
        lever = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        drift = self._params.position_drift, self._params.position_drift, self._params.yaw_drift
        self.covariance = lever @ self.covariance @ lever.T + distance * np.diag(np.square(drift))

    def correct(self, registration: Registration, T_odom_base: se3.Matrix) -> None:
        """Apply a registration that was made with this estimate as prior."""
        information = registration.information
        self.covariance = np.asarray(np.linalg.inv(np.linalg.inv(self.covariance) + information))
        x, y, yaw = self.covariance @ information @ registration.offset
        self.T_map_odom = (
            se3.correction_about(self.T_map_odom @ T_odom_base, (x, y, registration.z), yaw)
            @ self.T_map_odom
        )

    def inflate(self) -> None:
        """Inflate the covariance: a registration contradicts it, so drift was underestimated."""
        if self.deviation[0] < self._params.degraded_deviation:
            self.covariance = _INFLATION * self.covariance


class SmoothCorrection:
    """The published map -> odom transform, rate-limited.

    Parameters
    ----------
    params : LocalizationParams
    T_map_odom : (4, 4) float64

    Attributes
    ----------
    T_map_odom
    """

    def __init__(self, params: LocalizationParams, T_map_odom: se3.Matrix) -> None:
        self._params = params
        self.T_map_odom = T_map_odom

    def follow(self, target: se3.Matrix, T_odom_base: se3.Matrix, seconds: float) -> None:
        """Approach the estimate (4, 4) for a duration [s]; rates are limited at the robot."""
        current, wanted = self.T_map_odom @ T_odom_base, target @ T_odom_base
        shift = wanted[:3, 3] - current[:3, 3]
        between = target @ se3.inverse(self.T_map_odom)
        yaw = se3.yaw(between)
        distance = float(np.linalg.norm(shift))
        part = min(1.0, self._params.correction_speed * seconds / max(distance, 1e-12))
        turn = min(1.0, self._params.correction_turn * seconds / max(abs(yaw), 1e-12))
        x, y, z = part * shift
        self.T_map_odom = se3.correction_about(current, (x, y, z), turn * yaw) @ self.T_map_odom
