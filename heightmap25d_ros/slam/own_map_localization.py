# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Localization on the map made so far, while it is driven: what a `Tracker` does on a given map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.tracker import Attempt, Kind
from heightmap25d_ros.localization.tracking_state import Health, State
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.own_map_tracker import OwnMapTracker

_NO_POINTS = RegistrationPoints(np.zeros((0, 3)), np.zeros(0, bool), np.zeros(0))


class OwnEstimate(NamedTuple):
    """The pose of odom in the robot's own map.

    Attributes
    ----------
    T_map_odom : (4, 4) float64
    covariance : (3, 3) float64
        Of x, y [m] and yaw [rad] of the robot, seen from where it began.
    deviation : (2,) float [m], [rad]
        Standard deviations of position and yaw in what was mapped around it.
    """

    T_map_odom: se3.Matrix
    covariance: Array
    deviation: tuple[float, float]


class OwnMapLocalization:
    """Localizes a robot that has no map but the one that it makes.

    Parameters
    ----------
    params : Params
    T_map_odom : (4, 4) float64

    Attributes
    ----------
    health : Health
        TRACKING or DEGRADED, never LOST.
    jumps : int
        Number of times that the estimate was replaced: at the start, and when a loop was closed.
    """

    def __init__(self, params: Params, T_map_odom: se3.Matrix) -> None:
        self._params = params
        self.jumps = 0
        self.set_pose(T_map_odom, np.zeros((3, 3)))

    @property
    def estimate(self) -> OwnEstimate:
        """Where the robot is."""
        own = self._own
        return OwnEstimate(own.estimate.T_map_odom, own.covariance(), own.estimate.deviation)

    def set_params(self, params: Params) -> None:
        """Apply new parameters, to maps that are begun from now on."""
        self._params = params

    def set_pose(self, T_map_odom: se3.Matrix, _: Array) -> None:
        """Begin a new map, with the odometry's frame at a pose (4, 4) in it, which is exact."""
        self._own = OwnMapTracker(self._params, T_map_odom, is_recording=False)
        self.health = Health(self._params.localization)
        self.jumps += 1
        self._attempt_distance = 0.0

    def mend(self, T_map_odom: se3.Matrix, _: Array) -> None:
        """Odometry has jumped, the robot has not: its frame is at another pose from now on."""
        self._own.mend(T_map_odom)
        self.jumps += 1

    def forget(self) -> None:
        """The clock has jumped: scans of before do not go with those of now; the map stays."""
        self._own.mend(self._own.estimate.T_map_odom)

    def move(self, T_odom_base: se3.Matrix) -> None:
        """Odometry alone changes nothing: the estimate is predicted with the scans."""

    def integrate(self, beams: Beams, T_odom_base: se3.Matrix, stamp_ns: int) -> Attempt | None:
        """Integrate the beams of a scan, in odom, with the pose (4, 4) of the robot.

        Returns
        -------
        Attempt or None
            None if the robot has not moved on by ``localization.interval``.
        """
        own = self._own
        loops = own.loops_closed
        own.integrate(beams, T_odom_base, stamp_ns)
        self.jumps += own.loops_closed > loops
        travelled = own.distance - self._attempt_distance
        if own.last is None or travelled < self._params.localization.interval:
            return None
        self._attempt_distance = own.distance
        deviation = own.estimate.deviation
        self.health.update(own.last, deviation[0])
        if self.health.state is State.LOST:
            self.health.begin()  # there is no other map in which it could be searched
        return Attempt(
            stamp_ns=stamp_ns, kind=Kind.TRACKING, registration=own.last, state=self.health.state,
            T_map_base=own.T_map_base, deviation=deviation, points=_NO_POINTS,
        )  # fmt: skip
