# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How far a drive may be off, since it began and since a submap did."""

from __future__ import annotations

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.registration import Reason, Registration
from heightmap25d_ros.localization.scan_filter import ScanFilter
from heightmap25d_ros.params.sections import Params


class Drift:
    """How far the drive may be off since the beginning of a submap.

    What a step of the odometry adds counts as far as the scans of the same step do not observe it;
    scans that agree with what was mapped *after* it do not take it back, as they would in the
    filter.
    """

    def __init__(self, params: Params, estimate: ScanFilter) -> None:
        self._params, self._estimate = params.scan_filter, estimate
        self._total = np.zeros((4, 4))
        self._noise = np.zeros((4, 4))
        self._information = np.zeros((4, 4))
        self._travelled = 0.0

    @property
    def covariance(self) -> Array:
        """(4, 4) of x, y, yaw, z of the robot, along the axes of the map."""
        return self._total + self._step()

    @property
    def deviation(self) -> tuple[float, float]:
        """Standard deviations: of the position along its less certain direction [m], yaw [rad]."""
        covariance = self.covariance
        position = np.linalg.eigvalsh(covariance[:2, :2])[-1]
        return float(np.sqrt(position)), float(np.sqrt(covariance[2, 2]))

    def move(self, before: se3.Matrix, after: se3.Matrix) -> None:
        """The robot moved by odometry."""
        params, errors = self._params, self._estimate.errors
        dx, dy = (self._estimate.T_map_odom @ (after - before))[:2, 3]
        turn = abs(se3.yaw(se3.inverse(before) @ after))
        distance = float(np.hypot(dx, dy))
        if self._travelled + distance > params.interval * 5:
            self._total = self._total + self._step()
            self._noise, self._information = np.zeros((4, 4)), np.zeros((4, 4))
            self._travelled = 0.0
        self._travelled += distance
        change = np.eye(4)
        change[0, 2], change[1, 2] = -dy, dx
        self._total = change @ self._total @ change.T
        self._noise = change @ self._noise @ change.T
        slip = errors.slip_variance * 2.0 * params.slip_length + params.position_drift**2
        position = slip * distance + params.position_drift**2 * turn
        yaw = errors.turn_variance * turn + params.yaw_drift**2 * distance
        self._noise[np.diag_indices(4)] += position, position, yaw, params.z_drift**2 * distance

    def see(self, found: Registration) -> None:
        """What an update has observed."""
        if found.reason in (Reason.ACCEPTED, Reason.UNOBSERVED):
            self._information[:3, :3] += found.information

    def _step(self) -> Array:
        """The noise of this step, as far as it was not observed."""
        share = np.linalg.inv(np.eye(4) + self._noise @ self._information)
        return np.asarray(share @ self._noise)


def carried(covariance: Array, away: Array) -> Array:
    """A covariance (3, 3) of x, y, yaw at one place, at another (2,) [m] away from it."""
    lever = np.eye(3)
    lever[0, 2], lever[1, 2] = -away[1], away[0]
    return np.asarray(lever @ covariance @ lever.T)


def turned(covariance: Array, yaw: float) -> Array:
    """A covariance (4, 4) of x, y, yaw, z along axes that are turned by a yaw [rad]."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.eye(4)
    turn[:2, :2] = [[cos, -sin], [sin, cos]]
    return np.asarray(turn @ covariance @ turn.T)
