# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Continuous localization: short-term maps are registered against the long-term map while driving.

`Tracker` combines the other modules of this room: it predicts with the odometry, registers when a
short-term map is due, and searches the whole map when the robot is lost or a search is requested.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.global_search import relocalize
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.paper_registration import register_by_paper
from heightmap25d_ros.localization.pose_filter import PoseFilter, correction_about
from heightmap25d_ros.localization.registration import (
    Reason,
    Registration,
    register,
    to_registration_points,
)
from heightmap25d_ros.localization.short_term import ShortTermMap, ShortTermMaps, distance_travelled
from heightmap25d_ros.localization.surface import Surface
from heightmap25d_ros.localization.tracking_state import Health, State
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import Params

_CANDIDATE_COVARIANCE = np.diag([0.15**2, 0.15**2, 0.03**2])  # of a pose found in the whole map
_SEARCH_INTERVAL = 1.0  # [m] travelled between two searches of the whole map


class Kind(Enum):
    """The purpose of a registration."""

    TRACKING = "tracking"
    SEARCH = "search"
    CONFIRMATION = "confirmation"


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """One attempt to register, and its outcome.

    Attributes
    ----------
    stamp_ns : int [ns]
    kind : Kind
    registration : Registration
        Of a search: relative to the pose before.
    state : State
        After it.
    T_map_base : (4, 4) float64
        Estimate after it.
    deviation : (2,) float [m], [rad]
        Standard deviations of position and yaw after it.
    points : RegistrationPoints
        The registered points at the prior pose.
    pivot : (2,) float [m], map
        Position of the robot at the prior pose.
    """

    stamp_ns: int
    kind: Kind
    registration: Registration
    state: State
    T_map_base: se3.Matrix
    deviation: tuple[float, float]
    points: RegistrationPoints
    pivot: tuple[float, float]


class _View(NamedTuple):
    """The input of a registration."""

    surface: Surface
    points: RegistrationPoints
    pivot: tuple[float, float]
    T_odom_base: se3.Matrix


class Tracker:
    """Estimates the pose of the robot on the long-term map.

    Parameters
    ----------
    params : Params
    T_map_odom : (4, 4) float64
    covariance : (3, 3) float64
        Of x, y [m], yaw [rad] of the robot.

    Attributes
    ----------
    surface : Surface or None
        The long-term map.
    estimate : PoseFilter
    health : Health
    jumps : int
        Number of times that the estimate was replaced, not corrected.

    Examples
    --------
    Without a long-term map the estimate follows the odometry, and its uncertainty grows:

    >>> tracker = Tracker(Params(), np.eye(4), np.diag([0.01, 0.01, 0.001]))
    >>> tracker.move(np.eye(4))
    >>> tracker.move(se3.from_xyz_rpy([2.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    >>> position, yaw = tracker.estimate.deviation
    >>> round(position, 3), round(yaw, 3)
    (0.164, 0.035)
    >>> tracker.health.state.name
    'DEGRADED'
    """

    def __init__(self, params: Params, T_map_odom: se3.Matrix, covariance: Array) -> None:
        self.surface: Surface | None = None
        self.health = Health(params.localization)
        self.jumps = 0
        self._params = params
        self._short_term = ShortTermMaps(params)
        self._T_odom_base: se3.Matrix | None = None
        self._is_search_wanted = False
        self.set_pose(T_map_odom, covariance)

    def set_params(self, params: Params) -> None:
        """Apply new parameters; short-term maps that have been started keep theirs."""
        self._params = params
        self._short_term.params = params

    def set_pose(self, T_map_odom: se3.Matrix, covariance: Array) -> None:
        """Replace the estimate by another pose."""
        self.estimate = PoseFilter(self._params.localization, T_map_odom, covariance)
        self.health.begin()
        self.jumps += 1
        self._candidate: PoseFilter | None = None
        self._confirmed = 0
        self._attempt_distance = self._search_distance = -np.inf

    def forget(self) -> None:
        """Drop the short-term maps: odometry has jumped, and they are not consistent any more."""
        self._short_term.clear()
        self._T_odom_base = None
        self._candidate = None

    def request_search(self) -> None:
        """Search the whole map as soon as a short-term map is mature."""
        self._is_search_wanted = True
        self._search_distance = -np.inf

    def short_term_map(self) -> ShortTermMap | None:
        """The short-term map that is registered next, if it is mature."""
        return self._short_term.mature()

    def move(self, T_odom_base: se3.Matrix) -> None:
        """Predict with the newest pose (4, 4) of the odometry."""
        if self._T_odom_base is not None:
            distance = distance_travelled(self._T_odom_base, T_odom_base)
            for estimate in filter(None, (self.estimate, self._candidate)):
                estimate.predict(self._T_odom_base, T_odom_base, distance)
        self._T_odom_base = T_odom_base

    def integrate(self, beams: Beams, T_odom_base: se3.Matrix, stamp_ns: int) -> Attempt | None:
        """Integrate the beams of a scan, in odom, with the pose (4, 4) of the robot.

        Returns
        -------
        Attempt or None
            None if no registration was due.
        """
        self._short_term.integrate(beams, T_odom_base, stamp_ns)
        distance = self._short_term.distance
        if self.surface is None or not (self._is_registration_due() or self._is_search_due()):
            return None
        short_term_map = self._short_term.mature()
        if short_term_map is None:
            return None
        prior = self._candidate or self.estimate
        cells = short_term_map.local_cells(distance)
        points, pivot = to_registration_points(cells, prior.T_map_odom, T_odom_base)
        view = _View(self.surface, points, pivot, T_odom_base)
        if self._candidate is not None:
            kind, found = Kind.CONFIRMATION, self._confirm(self._candidate, view)
        elif self._is_search_due():
            kind, found = Kind.SEARCH, self._search(view)
        else:
            kind, found = Kind.TRACKING, self._track(view)
        self._attempt_distance = distance
        return Attempt(
            stamp_ns=stamp_ns,
            kind=kind,
            registration=found,
            state=self.health.state,
            T_map_base=self.estimate.T_map_odom @ T_odom_base,
            deviation=self.estimate.deviation,
            points=points,
            pivot=pivot,
        )

    def _is_registration_due(self) -> bool:
        """A lost robot registers only to confirm a pose found in the whole map."""
        is_lost = self.health.state is State.LOST and self._candidate is None
        travelled = self._short_term.distance - self._attempt_distance
        return not is_lost and travelled >= self._params.localization.interval

    def _is_search_due(self) -> bool:
        is_lost = self.health.state is State.LOST
        is_wanted = self._is_search_wanted or (
            is_lost and self._params.localization.relocalize_when_lost
        )
        travelled = self._short_term.distance - self._search_distance
        return is_wanted and travelled >= _SEARCH_INTERVAL

    def _register(self, estimate: PoseFilter, view: _View) -> Registration:
        params, prior = self._params.registration, estimate.covariance
        if params.method == "paper":
            found = register_by_paper(view.points, view.pivot, view.surface, prior)
        else:
            found = register(view.points, view.pivot, view.surface, prior, params)
        if found.is_accepted:
            estimate.correct(found, view.T_odom_base)
        elif found.reason is Reason.FAR_FROM_PRIOR:
            estimate.inflate()
        return found

    def _track(self, view: _View) -> Registration:
        found = self._register(self.estimate, view)
        self.health.update(found, self.estimate.deviation[0])
        return found

    def _search(self, view: _View) -> Registration:
        """Search for a candidate in the whole map; the estimate is not changed."""
        self._search_distance = self._short_term.distance
        found = relocalize(view.points, view.pivot, view.surface, self._params.registration)
        if found.is_accepted:
            T_map_odom = self.estimate.T_map_odom
            x, y, yaw = found.offset
            T_candidate = correction_about(T_map_odom @ view.T_odom_base, (x, y, found.z), yaw)
            self._candidate = PoseFilter(
                self._params.localization, T_candidate @ T_map_odom, _CANDIDATE_COVARIANCE
            )
            self._confirmed = 0
        return found

    def _confirm(self, candidate: PoseFilter, view: _View) -> Registration:
        """Register with a candidate as prior; accept it or drop it."""
        found = self._register(candidate, view)
        if not found.is_accepted:
            self._candidate = None
            return found
        self._confirmed += 1
        if self._confirmed >= self._params.localization.confirmations:
            self.set_pose(candidate.T_map_odom, candidate.covariance)
            self.health.begin(is_confirmed=True)
            self._is_search_wanted = False
        return found
