# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Continuous localization: short-term maps are registered as the robot drives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.global_search import relocalize
from heightmap25d_ros.localization.landmarks import Landmarks
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.paper_registration import register_by_paper
from heightmap25d_ros.localization.pose_filter import PoseFilter, correction_about
from heightmap25d_ros.localization.registration import (
    Reason,
    Registration,
    register,
    to_registration_points,
)
from heightmap25d_ros.localization.scan_filter import ScanFilter, unknown_errors
from heightmap25d_ros.localization.scan_proposal import COARSE, Proposal, Proven, returns_to_points
from heightmap25d_ros.localization.scan_window import ScanWindow
from heightmap25d_ros.localization.short_term import ShortTermMap, ShortTermMaps, way_between
from heightmap25d_ros.localization.surface import Surface
from heightmap25d_ros.localization.tracking_state import CONTRADICTIONS, Health, State
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import Params

_PLACE_COVARIANCE = np.diag([0.15**2, 0.15**2, 0.03**2])  # of what is found in the whole map
_SEARCH_WAY = 1.0  # [m] from one search of the whole map to the next
_REPEATED = 0.1  # [m] between what two short-term maps propose one after the other


class Kind(Enum):
    """What was tried with a short-term map."""

    TRACKING = "tracking"
    SEARCH = "search"
    CONFIRMATION = "confirmation"


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """One try to register, and what came of it.

    Attributes
    ----------
    stamp_ns : int [ns]
    kind : Kind
    registration : Registration
        Of a search: as seen from the pose before.
    state : State
        After it.
    T_map_base : (4, 4) float64
        Estimate after it.
    deviation : (2,) float [m], [rad]
        Standard deviations of position and yaw after it.
    points : RegistrationPoints
    pivot : (2,) float [m], map
        What was registered, as seen from the prior.
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
    """What is registered, and against what."""

    surface: Surface
    points: RegistrationPoints
    pivot: tuple[float, float]
    T_odom_base: se3.Matrix


class Tracker:
    """The estimate of the pose over the long-term map.

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
    landmarks : Landmarks or None
        Of the same map; with them scans are tracked.
    estimate : PoseFilter or ScanFilter
    health : Health
    jumps : int
        How often the estimate was replaced, not corrected.
    """

    def __init__(self, params: Params, T_map_odom: se3.Matrix, covariance: Array) -> None:
        self.surface: Surface | None = None
        self.health = Health(params.localization)
        self.jumps = 0
        self.estimate: PoseFilter | ScanFilter
        self._params = params
        self._short_term = ShortTermMaps(params)
        self._T_odom_base: se3.Matrix | None = None
        self._is_search_wanted = False
        self.landmarks: Landmarks | None = None
        self._window = ScanWindow(params.scan_filter)
        self._odometry_errors = unknown_errors(params)
        self.set_pose(T_map_odom, covariance)

    def set_params(self, params: Params) -> None:
        """Go on with other parameters; short-term maps take them when they begin."""
        self._params = params
        self._short_term.params = params
        self._window.params = params.scan_filter

    def set_long_term(self, surface: Surface | None, landmarks: Landmarks | None) -> None:
        """Another long-term map; the pose stays."""
        uses_scans = (
            self._params.scan_filter.enabled and self._params.registration.method != "paper"
        )
        self.surface, self.landmarks = surface, landmarks if uses_scans else None
        self.estimate = self._estimate_at(self.estimate.T_map_odom, self.estimate.covariance)

    def _estimate_at(self, T_map_odom: se3.Matrix, covariance: Array) -> PoseFilter | ScanFilter:
        if self.landmarks is None:
            return PoseFilter(self._params.localization, T_map_odom, covariance)
        return ScanFilter(self._params, T_map_odom, covariance, self._odometry_errors)

    def set_pose(self, T_map_odom: se3.Matrix, covariance: Array) -> None:
        """The robot is somewhere else than was thought."""
        self.estimate = self._estimate_at(T_map_odom, covariance)
        self._is_settled = False
        self.health.begin()
        self.jumps += 1
        self._candidate: PoseFilter | None = None
        self._confirmed = 0
        self._proposed: se3.Matrix | None = None
        self._tried_way = self._searched_way = -np.inf

    def forget(self) -> None:
        """What was seen so far does not go with what will be seen: odometry has jumped."""
        self._short_term.clear()
        self._window.clear()
        self._T_odom_base = None
        self._candidate = None

    def request_search(self) -> None:
        """Search the whole map as soon as there is something to search with."""
        self._is_search_wanted = True
        self._searched_way = -np.inf

    def short_term_map(self) -> ShortTermMap | None:
        """The one that is registered next, if it is mature."""
        return self._short_term.mature()

    def move(self, T_odom_base: se3.Matrix) -> None:
        """The robot is at a pose (4, 4) by odometry now."""
        if self._T_odom_base is not None:
            way = way_between(self._T_odom_base, T_odom_base)
            self.estimate.predict(self._T_odom_base, T_odom_base, way)
            if self._candidate is not None:
                self._candidate.predict(self._T_odom_base, T_odom_base, way)
        self._T_odom_base = T_odom_base

    def take(self, beams: Beams, T_odom_base: se3.Matrix, stamp_ns: int) -> Attempt | None:
        """Take the beams of a scan in, in odom, with the pose (4, 4) of the robot."""
        self._short_term.integrate(beams, T_odom_base, stamp_ns)
        way = self._short_term.way
        self._window.add(beams, stamp_ns)
        if self._is_tracking_scans():
            attempt = self._track_scans(stamp_ns)
            if self._is_settled:
                return attempt
        if self.surface is None or not (self._is_registration_due() or self._is_search_due()):
            return None
        short_term_map = self._short_term.mature()
        if short_term_map is None:
            return None
        prior = self._candidate or self.estimate
        seen = short_term_map.local_cells(way)
        points, pivot = to_registration_points(seen, prior.T_map_odom, T_odom_base)
        view = _View(self.surface, points, pivot, T_odom_base)
        if self._candidate is not None:
            kind, found = Kind.CONFIRMATION, self._confirm(self._candidate, view)
        elif self._is_search_due():
            kind, found = Kind.SEARCH, self._search(view)
        else:
            kind, found = Kind.TRACKING, self._track(view)
        self._tried_way = way
        return self._attempt(kind, found, view, stamp_ns)

    def _attempt(self, kind: Kind, found: Registration, view: _View, stamp_ns: int) -> Attempt:
        return Attempt(
            stamp_ns=stamp_ns,
            kind=kind,
            registration=found,
            state=self.health.state,
            T_map_base=self.estimate.T_map_odom @ view.T_odom_base,
            deviation=self.estimate.deviation,
            points=view.points,
            pivot=view.pivot,
        )

    def _is_tracking_scans(self) -> bool:
        """Whether scans are held to the map."""
        return (
            self.landmarks is not None
            and self.health.state is not State.LOST
            and self._candidate is None
            and not self._is_search_due()
        )

    def _track_scans(self, stamp_ns: int) -> Attempt | None:
        """Update by scans; an attempt once in an interval."""
        way, T_odom_base = self._short_term.way, self._T_odom_base
        estimate, surface = self.estimate, self.surface
        if T_odom_base is None or not self._window.is_due(way, stamp_ns):
            return None
        assert isinstance(estimate, ScanFilter)
        assert self.landmarks is not None
        assert surface is not None
        prior = estimate.T_map_odom
        returns = self._window.take(way, stamp_ns)
        if not self._is_settled:
            estimate.settle(returns, T_odom_base, self.landmarks)
            return None
        found = estimate.update(returns, T_odom_base, self.landmarks)
        if way - self._tried_way < self._params.localization.interval:
            return None
        self._tried_way = way
        points, pivot = returns_to_points(returns, prior, T_odom_base, self.landmarks)
        view = _View(surface, points, pivot, T_odom_base)
        if found.reason in CONTRADICTIONS or estimate.deviation[0] > COARSE:
            short_term_map = self._short_term.mature()
            if short_term_map is not None:
                seen = short_term_map.local_cells(way)
                proposed = Proposal(estimate, found, T_odom_base, seen).proven(
                    returns, surface, self.landmarks, self._params
                )
                if self._is_repeated(proposed, T_odom_base) and proposed is not None:
                    self.estimate, found, points, pivot = proposed
                    view = _View(surface, points, pivot, T_odom_base)
        self.health.update(found, self.estimate.deviation[0])
        return self._attempt(Kind.TRACKING, found, view, stamp_ns)

    def _is_repeated(self, proposed: Proven | None, T_odom_base: se3.Matrix) -> bool:
        """Whether the proposal before led to the same place: what noise proposes wanders."""
        before, self._proposed = self._proposed, None
        if proposed is None:
            return False
        self._proposed = proposed[0].T_map_odom
        if before is None:
            return False
        apart = (before - self._proposed) @ T_odom_base
        return bool(np.hypot(apart[0, 3], apart[1, 3]) < _REPEATED)

    def _is_registration_due(self) -> bool:
        """Where the robot is lost, only what was found in the whole map is worth registering."""
        is_lost = self.health.state is State.LOST and self._candidate is None
        passed = self._short_term.way - self._tried_way
        return not is_lost and passed >= self._params.localization.interval

    def _is_search_due(self) -> bool:
        is_lost = self.health.state is State.LOST
        is_wanted = self._is_search_wanted or (
            is_lost and self._params.localization.relocalize_when_lost
        )
        return is_wanted and self._short_term.way - self._searched_way >= _SEARCH_WAY

    def _register(self, estimate: PoseFilter | ScanFilter, view: _View) -> Registration:
        params, prior = self._params.registration, estimate.covariance
        if params.method == "paper":
            found = register_by_paper(view.points, view.pivot, view.surface, prior)
        else:
            found = register(view.points, view.pivot, view.surface, prior, params)
        if found.is_accepted:
            if isinstance(estimate, ScanFilter) and estimate.has_settled_near(found):
                # Scans have found the place already, and better.
                found = replace(found, offset=np.zeros(3), z=0.0)
            estimate.correct(found, view.T_odom_base)
        elif found.reason is Reason.FAR_FROM_PRIOR:
            estimate.doubt()
        return found

    def _track(self, view: _View) -> Registration:
        found = self._register(self.estimate, view)
        self._is_settled |= found.is_accepted
        self.health.update(found, self.estimate.deviation[0])
        return found

    def _search(self, view: _View) -> Registration:
        """Look for a candidate in the whole map; the estimate stays."""
        self._searched_way = self._short_term.way
        found = relocalize(view.points, view.pivot, view.surface, self._params.registration)
        if found.is_accepted:
            T_map_odom = self.estimate.T_map_odom
            x, y, yaw = found.offset
            to_place = correction_about(T_map_odom @ view.T_odom_base, (x, y, found.z), yaw)
            self._candidate = PoseFilter(
                self._params.localization, to_place @ T_map_odom, _PLACE_COVARIANCE
            )
            self._confirmed = 0
        return found

    def _confirm(self, candidate: PoseFilter, view: _View) -> Registration:
        """Hold a candidate against what was seen since; take it or drop it."""
        found = self._register(candidate, view)
        if not found.is_accepted:
            self._candidate = None
            return found
        self._confirmed += 1
        if self._confirmed >= self._params.localization.confirmations:
            self.set_pose(candidate.T_map_odom, candidate.covariance)
            self._is_settled = True
            self.health.begin(is_confirmed=True)
            self._is_search_wanted = False
        return found
