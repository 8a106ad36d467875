# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Localization on the map made so far, while it is driven: what a `Tracker` does on a given map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.hypotheses import Estimate
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.tracker import Attempt, Kind, Tracker
from heightmap25d_ros.localization.tracking_state import Health, State
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.own_map_tracker import OwnMapTracker
from heightmap25d_ros.slam.saved_map import SavedMap

_NO_POINTS = RegistrationPoints(np.zeros((0, 3)), np.zeros(0, bool), np.zeros(0))


class OwnEstimate:
    """The pose of odom in the robot's own map; what of it is not asked for is not computed.

    Parameters
    ----------
    own : OwnMapTracker
    """

    def __init__(self, own: OwnMapTracker) -> None:
        self._own = own

    @property
    def T_map_odom(self) -> se3.Matrix:
        """(4, 4) float64."""
        return self._own.T_map_wheels

    @property
    def covariance(self) -> Array:
        """(3, 3) float64: of x, y [m] and yaw [rad] of the robot, seen from where it began."""
        return self._own.covariance()

    @property
    def z_variance(self) -> float:
        """Of the robot [m^2], seen from where it began."""
        return self._own.z_variance

    @property
    def deviation(self) -> tuple[float, float]:
        """Standard deviations of position [m] and yaw [rad] in what was mapped around it."""
        return self._own.estimate.deviation


class OwnMapLocalization:
    """Localizes a robot on the map that it makes, by itself or going on from a saved one.

    On a saved map it is LOST until a `Tracker` has found it there, so that nothing is mapped in the
    wrong place; then the frame stays, and scans are held against what was and what is.

    Parameters
    ----------
    params : Params
    T_map_odom : (4, 4) float64
    covariance : (3, 3) float64
        Of x, y [m], yaw [rad] of the robot, on a saved map.
    search_slice : float, optional [s]
        Time of a search between two scans; all at once by default.

    Attributes
    ----------
    jumps : int
        Number of times that the estimate was replaced: at the start, when it was found on a saved
        map, and when submaps were moved.
    """

    def __init__(
        self,
        params: Params,
        T_map_odom: se3.Matrix,
        covariance: Array,
        search_slice: float = np.inf,
    ) -> None:
        self._params, self._search_slice = params, search_slice
        self._saved: SavedMap | None = None
        self._finder: Tracker | None = None
        self.jumps = 0
        self.set_pose(T_map_odom, covariance)

    @property
    def state(self) -> State:
        """TRACKING or DEGRADED; LOST until the robot is found on a saved map."""
        return self._health.state if self._finder is None else State.LOST

    @property
    def map_version(self) -> tuple[int, int, int]:
        """Which map it is [ns], the number of its submaps, and how often they were moved."""
        own = self._own
        return own.begun_ns, len(own.submaps), own.loops_closed + own.refined

    @property
    def tilt(self) -> Array:
        """(2,) [rad]: to be added to roll and pitch of the odometry, see `ScanFilter`."""
        return self._own.estimate.tilt if self._finder is None else np.zeros(2)

    def submap_poses(self) -> Array:
        """(K, 4, 4): the robot in the map at the beginning of each submap."""
        return np.array([s.T_map_submap @ s.start for s in self._own.submaps]).reshape(-1, 4, 4)

    @property
    def estimate(self) -> OwnEstimate | Estimate:
        """Where the robot is."""
        return OwnEstimate(self._own) if self._finder is None else self._finder.estimate

    def set_params(self, params: Params) -> None:
        """Apply new parameters, to maps that are begun from now on."""
        self._params = params
        if self._finder is not None:
            self._finder.set_params(params)

    def set_saved_map(self, saved: SavedMap) -> None:
        """Go on from a saved map, wherever in it the robot is near the pose that it has."""
        self._saved = saved
        self._begin(self.estimate.T_map_odom, self.estimate.covariance)

    def set_pose(self, T_map_odom: se3.Matrix, covariance: Array) -> None:
        """Begin a new map, with the odometry's frame at a pose (4, 4) in it, which is exact.

        On a saved map it is as uncertain as its covariance (3, 3), and is held against the map.
        """
        self._begin(T_map_odom, covariance)
        self.jumps += 1

    def request_search(self) -> bool:
        """Find the robot in all of the saved map, and go on from there; whether there is one."""
        if self._saved is None:
            return False
        if self._finder is None:
            self._begin(self.estimate.T_map_odom, self.estimate.covariance)
        assert self._finder is not None
        self._finder.request_search()
        return True

    def _begin(self, T_map_odom: se3.Matrix, covariance: Array) -> None:
        if self._saved is not None:
            self._finder = Tracker(self._params, T_map_odom, covariance, self._search_slice)
            self._finder.set_long_term(self._saved.long_term)
        self._use_map(OwnMapTracker(
            self._params, T_map_odom, search_slice=self._search_slice, is_recording=False
        ))  # fmt: skip

    def _use_map(self, own: OwnMapTracker) -> None:
        self._own = own
        self._health = Health(self._params.localization)
        self._attempt_distance = 0.0
        self._moves_seen = 0

    def mend(self, T_map_odom: se3.Matrix, covariance: Array) -> None:
        """Odometry has jumped, the robot has not: its frame is at another pose from now on."""
        if self._finder is not None:
            self._finder.mend(T_map_odom, covariance)
        self._own.mend(T_map_odom)
        self.jumps += 1

    def forget(self) -> None:
        """The clock has jumped: scans of before do not go with those of now; the map stays."""
        if self._finder is not None:
            self._finder.forget()
        self._own.mend(self._own.T_map_wheels)

    def move(self, T_odom_base: se3.Matrix) -> None:
        """Predict with the newest pose (4, 4) of the odometry, until the robot is found.

        On its own map the estimate is predicted with the scans, and there is time for loops.
        """
        if self._finder is not None:
            self._finder.move(T_odom_base)
        self._own.go_on_searching()
        self._count_moves()

    def _count_moves(self) -> None:
        """Submaps that move take the robot with them."""
        moves = self._own.loops_closed + self._own.refined
        self.jumps += moves - self._moves_seen
        self._moves_seen = moves

    def integrate(self, beams: Beams, T_odom_base: se3.Matrix, stamp_ns: int) -> Attempt | None:
        """Integrate the beams of a scan, in odom, with the pose (4, 4) of the robot.

        Returns
        -------
        Attempt or None
            None if the robot has not moved on by ``localization.interval``.
        """
        if self._finder is not None:
            return self._find(self._finder, beams, T_odom_base, stamp_ns)
        own = self._own
        own.integrate(beams, T_odom_base, stamp_ns)
        self._count_moves()
        travelled = own.distance - self._attempt_distance
        if own.last is None or travelled < self._params.localization.interval:
            return None
        self._attempt_distance = own.distance
        deviation = own.estimate.deviation
        self._health.update(own.last, deviation[0])
        if self._health.state is State.LOST:
            self._health.begin()  # what contradicts is learned, and held against from then on
        return Attempt(
            stamp_ns=stamp_ns, kind=Kind.TRACKING, registration=own.last, state=self.state,
            T_map_base=own.T_map_base, deviation=deviation, points=_NO_POINTS,
        )  # fmt: skip

    def _find(
        self, finder: Tracker, beams: Beams, T_odom_base: se3.Matrix, stamp_ns: int
    ) -> Attempt | None:
        """Find the robot on the saved map, and go on from there."""
        attempt = finder.integrate(beams, T_odom_base, stamp_ns)
        if finder.health.state is State.TRACKING:
            found = finder.estimate
            self._finder = None
            self.jumps += 1
            self._use_map(OwnMapTracker(
                self._params, found.T_map_odom, found.covariance, saved=self._saved,
                search_slice=self._search_slice, is_recording=False,
            ))  # fmt: skip
            self._health.begin(is_confirmed=True)
        return None if attempt is None else replace(attempt, state=self.state)
