# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Continuous localization: scans and short-term maps are held against the long-term map.

`Tracker` combines the other modules of this room: it predicts with the odometry, registers when it
is due, and searches the whole map, in slices, when the robot is lost or a search is requested. What
the search finds is tracked as hypotheses until one is alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.global_search import SearchResult
from heightmap25d_ros.localization.hypotheses import Estimate, Hypotheses
from heightmap25d_ros.localization.level_search import LevelSearch
from heightmap25d_ros.localization.long_term_map import LongTermMap
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.odometry_errors import OdometryErrors, unknown_errors
from heightmap25d_ros.localization.paper_registration import register_by_paper
from heightmap25d_ros.localization.pose_filter import PoseFilter
from heightmap25d_ros.localization.registration import (
    Reason,
    Registration,
    RegistrationSearch,
    register,
    to_registration_points,
)
from heightmap25d_ros.localization.scan_filter import ScanFilter, fit_of
from heightmap25d_ros.localization.scan_proposal import (
    CLEAR_FIT,
    COARSE,
    Proposal,
    Proven,
    returns_to_points,
)
from heightmap25d_ros.localization.scan_window import ScanWindow
from heightmap25d_ros.localization.short_term import (
    LocalCells,
    ShortTermMap,
    ShortTermMaps,
    distance_travelled,
)
from heightmap25d_ros.localization.surface import Surface
from heightmap25d_ros.localization.tracking_state import CONTRADICTIONS, Health, State
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import Params

_FOUND_COVARIANCE = np.diag([0.15**2, 0.15**2, 0.03**2])  # of a pose found in the whole map
_MOST_HYPOTHESES = 16
_LEAST_KNOWN = 0.8  # share of the points over known cells, for several hypotheses
_SEARCH_INTERVAL = 1.0  # [m] travelled between two searches of the whole map
_LOOK_INTERVAL = 1.0  # [m] travelled from one look for a better place to the next
_JUMP = 0.5  # [m] of a correction from which on it replaces the pose
_REPEATED = 0.1  # [m] between what two short-term maps propose one after the other


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
    weights : tuple of float
        Of the poses that a search has found and the map has not contradicted, the largest first.
    """

    stamp_ns: int
    kind: Kind
    registration: Registration
    state: State
    T_map_base: se3.Matrix
    deviation: tuple[float, float]
    points: RegistrationPoints
    weights: tuple[float, ...] = ()


class _View(NamedTuple):
    """The input of a registration."""

    surface: Surface
    points: RegistrationPoints
    T_odom_base: se3.Matrix


class _Search(NamedTuple):
    """A search that is under way, from a view that is past, and the prior of its points."""

    search: LevelSearch
    view: _View
    T_map_odom: se3.Matrix


class _Registering(NamedTuple):
    """A registration that is under way, from a view that is past."""

    search: RegistrationSearch
    view: _View


class Tracker:
    """Estimates the pose of the robot on the long-term map.

    Parameters
    ----------
    params : Params
    T_map_odom : (4, 4) float64
    covariance : (3, 3) float64
        Of x, y [m], yaw [rad] of the robot.
    search_slice : float, optional [s]
        Time of a search, of the whole map or around the pose, between two scans; all at once by
        default.

    Attributes
    ----------
    long_term : LongTermMap or None
        With landmarks scans are tracked.
    estimate : PoseFilter or ScanFilter
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

    def __init__(
        self,
        params: Params,
        T_map_odom: se3.Matrix,
        covariance: Array,
        search_slice: float = np.inf,
    ) -> None:
        self.long_term: LongTermMap | None = None
        self.health = Health(params.localization)
        self.jumps = 0
        self.estimate: Estimate
        self._hypotheses: Hypotheses | None
        self._registering: _Registering | None
        self._params, self._search_slice = params, search_slice
        self._short_term = ShortTermMaps(params)
        self._errors = unknown_errors(params)
        self._T_odom_base: se3.Matrix | None = None
        self._is_search_wanted = False
        self._uses_scans = False
        self._window = ScanWindow(params.scan_filter)
        self.set_pose(T_map_odom, covariance)

    def set_params(self, params: Params) -> None:
        """Apply new parameters; short-term maps that have been started keep theirs."""
        self._params = params
        self._short_term.params = params
        self._window.params = params.scan_filter

    def set_long_term(self, long_term: LongTermMap | None) -> None:
        """Another long-term map; the pose stays."""
        self.long_term = long_term
        self._registering = None
        self._uses_scans = (
            long_term is not None
            and long_term.has_landmarks
            and self._params.scan_filter.enabled
            and self._params.registration.method != "paper"
        )
        if not self._uses_scans and self._hypotheses is not None and len(self._hypotheses) > 1:
            self._hypotheses = None  # nothing tells them apart any more: they are searched anew
            self._search_distance = -np.inf
        self.estimate = self._estimate_at(self.estimate.T_map_odom, self.estimate.covariance)

    def _estimate_at(self, T_map_odom: se3.Matrix, covariance: Array) -> Estimate:
        if not self._uses_scans:
            return PoseFilter(self._params.localization, T_map_odom, covariance)
        return ScanFilter(self._params, T_map_odom, covariance, self._errors)

    def set_pose(self, T_map_odom: se3.Matrix, covariance: Array) -> None:
        """Replace the estimate by another pose."""
        self.estimate = self._estimate_at(T_map_odom, covariance)
        self._is_settled = False
        self.health.begin()
        self.jumps += 1
        self._search: _Search | None = None
        self._registering = None
        self._hypotheses = None
        self._confirmed = self._refused = 0
        self._proposed: se3.Matrix | None = None
        self._attempt_distance = self._search_distance = self._looked_distance = -np.inf
        self._agreed_distance = self._short_term.distance

    def forget(self) -> None:
        """Drop the short-term maps: odometry has jumped, and they are not consistent any more."""
        self._short_term.clear()
        self._window.clear()
        self._T_odom_base = None
        self._search = self._registering = self._hypotheses = self._proposed = None

    def mend(self, T_map_odom: se3.Matrix, covariance: Array) -> None:
        """Odometry has jumped, the robot has not: its frame is at another pose from now on."""
        self.forget()
        self.set_pose(T_map_odom, covariance)

    @property
    def state(self) -> State:
        """How sure the estimate is."""
        return self.health.state

    def request_search(self) -> bool:
        """Search the whole map as soon as a short-term map is mature; whether there is a map."""
        self._is_search_wanted |= self.long_term is not None
        self._search_distance = -np.inf
        return self.long_term is not None

    def short_term_map(self) -> ShortTermMap | None:
        """The short-term map that is registered next, if it is mature."""
        return self._short_term.mature()

    def move(self, T_odom_base: se3.Matrix) -> None:
        """Predict with the newest pose (4, 4) of the odometry."""
        if self._T_odom_base is not None:
            distance = distance_travelled(self._T_odom_base, T_odom_base)
            self.estimate.predict(self._T_odom_base, T_odom_base, distance)
            self.health.predict(self.estimate.deviation[0])
            if self._hypotheses is not None:
                self._hypotheses.predict(self._T_odom_base, T_odom_base, distance)
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
        self._window.add(beams, stamp_ns)
        if self._is_tracking_scans():
            attempt = self._track_scans(stamp_ns)
            if self._is_settled:
                return attempt
        if self._search is not None:
            return self._go_on_searching(self._search, stamp_ns)
        if self._registering is not None:
            return self._go_on_registering(self._registering, stamp_ns)
        return self._use_short_term_map(distance, stamp_ns)

    def _use_short_term_map(self, distance: float, stamp_ns: int) -> Attempt | None:
        """Register, search or confirm with the oldest short-term map, if that is due."""
        if self.long_term is None or not (self._is_registration_due() or self._is_search_due()):
            return None
        short_term_map = self._short_term.mature()
        if short_term_map is None:
            return None
        self._attempt_distance = distance
        cells = short_term_map.local_cells(distance)
        if self._hypotheses is not None:
            return self._confirm(self._hypotheses, cells, stamp_ns)
        view = self._view(self.estimate, cells)
        if self._is_search_due():
            self._search_distance = distance
            assert self.long_term is not None
            surfaces = [level.surface for level in self.long_term.levels]
            search = LevelSearch(view.points, surfaces, self._params.registration)
            self._search = _Search(search, view, self.estimate.T_map_odom)
            if self.health.state is State.TRACKING:  # which somebody doubts
                self.health.begin()
            return self._go_on_searching(self._search, stamp_ns)
        params = self._params.registration
        if params.method == "paper":
            found = register_by_paper(view.points, view.surface, self.estimate.covariance)
            return self._track(found, view, stamp_ns)
        registering = RegistrationSearch(
            view.points, view.surface, self.estimate.covariance, params
        )
        return self._go_on_registering(_Registering(registering, view), stamp_ns)

    def _go_on_registering(self, under_way: _Registering, stamp_ns: int) -> Attempt | None:
        """Register for a while; scans do not move the estimate meanwhile."""
        self._registering = None  # also where it fails
        if under_way.search.step(self._search_slice):
            return self._track(under_way.search.result, under_way.view, stamp_ns)
        self._registering = under_way
        return None

    def _view(self, estimate: Estimate, cells: LocalCells) -> _View:
        """Cells of a short-term map, as they are for an estimate."""
        assert self.long_term is not None
        assert self._T_odom_base is not None
        points = to_registration_points(cells, estimate.T_map_odom, self._T_odom_base)
        surface = self.long_term.at(estimate.T_map_odom @ self._T_odom_base).surface
        return _View(surface, points, self._T_odom_base)

    def _attempt(self, kind: Kind, found: Registration, view: _View, stamp_ns: int) -> Attempt:
        return Attempt(
            stamp_ns=stamp_ns,
            kind=kind,
            registration=found,
            state=self.health.state,
            T_map_base=self.estimate.T_map_odom @ view.T_odom_base,
            deviation=self.estimate.deviation,
            points=view.points,
        )

    def _is_tracking_scans(self) -> bool:
        """Whether scans are held to the map."""
        return (
            self._uses_scans
            and self.health.state is not State.LOST
            and self._search is None
            and self._registering is None
            and self._hypotheses is None
            and not self._is_search_due()
        )

    def _track_scans(self, stamp_ns: int) -> Attempt | None:
        """Update by scans; an attempt once in an interval."""
        distance, T_odom_base = self._short_term.distance, self._T_odom_base
        estimate = self.estimate
        if T_odom_base is None or not self._window.is_due(distance, stamp_ns):
            return None
        assert isinstance(estimate, ScanFilter)
        assert self.long_term is not None
        surface, landmarks = self.long_term.at(estimate.T_map_odom @ T_odom_base)
        assert landmarks is not None
        prior = estimate.T_map_odom
        returns = self._window.take(distance, stamp_ns)
        if not self._is_settled:
            estimate.settle(returns, T_odom_base, landmarks)
            return None
        found = estimate.update(returns, T_odom_base, landmarks)
        if found.reason not in CONTRADICTIONS:
            self._window.confirm()
            self._agreed_distance = distance
        if distance - self._attempt_distance < self._params.localization.interval:
            return None
        self._attempt_distance = distance
        points = returns_to_points(returns, prior, T_odom_base, landmarks)
        view = _View(surface, points, T_odom_base)
        is_doubted = False
        is_unsure = found.reason in CONTRADICTIONS or estimate.deviation[0] > COARSE
        if is_unsure or self._is_look_due(found, distance):
            short_term_map = self._short_term.mature() if is_unsure else None
            seen = None if short_term_map is None else short_term_map.local_cells(distance)
            doubted = distance - self._agreed_distance
            proposed = Proposal(estimate, found, T_odom_base, returns, doubted).proven(
                seen, surface, landmarks, self._params
            )
            if self._is_repeated(proposed, T_odom_base) and proposed is not None:
                self.estimate, found, points, _ = proposed
                view = _View(surface, points, T_odom_base)
                self.jumps += int(np.hypot(*found.offset[:2]) > _JUMP)
            else:
                is_doubted = proposed is not None and fit_of(found) < CLEAR_FIT
        if found.reason in CONTRADICTIONS or not is_doubted:
            self.health.update(found, self.estimate.deviation[0])
        if found.is_accepted and not is_doubted and self.health.state is State.TRACKING:
            self._learn(estimate.errors)
        return self._attempt(Kind.TRACKING, found, view, stamp_ns)

    def _is_look_due(self, found: Registration, distance: float) -> bool:
        """Whether scans fit poorly, and a better place is to be looked for: now and then."""
        if fit_of(found) >= CLEAR_FIT:
            return False
        if distance - self._looked_distance >= _LOOK_INTERVAL:
            self._looked_distance = distance
            return True
        return self._proposed is not None

    def _learn(self, errors: OdometryErrors) -> None:
        """Errors of the odometry, which it keeps wherever the robot turns out to be."""
        self._errors = errors
        self._short_term.errors = errors.mean * (0.0, 1.0, 1.0, 1.0)  # slip comes and goes

    def _is_repeated(self, proposed: Proven | None, T_odom_base: se3.Matrix) -> bool:
        """Whether the proposal before led to the same place: what noise proposes wanders."""
        before, self._proposed = self._proposed, None
        if proposed is None:
            return False
        self._proposed = proposed.estimate.T_map_odom
        if before is None:
            return False
        apart = (before - self._proposed) @ T_odom_base
        return bool(np.hypot(apart[0, 3], apart[1, 3]) < _REPEATED + proposed.wrong)

    def _is_registration_due(self) -> bool:
        """A lost robot registers only to confirm a pose found in the whole map."""
        is_lost = self.health.state is State.LOST and self._hypotheses is None
        travelled = self._short_term.distance - self._attempt_distance
        return not is_lost and travelled >= self._params.localization.interval

    def _is_search_due(self) -> bool:
        if self._hypotheses is not None:
            return False
        is_lost = self.health.state is State.LOST
        is_wanted = self._is_search_wanted or (
            is_lost and self._params.localization.relocalize_when_lost
        )
        travelled = self._short_term.distance - self._search_distance
        return is_wanted and travelled >= _SEARCH_INTERVAL

    def _register(self, estimate: Estimate, view: _View) -> Registration:
        """Register at once: the prior of a pose that a search has found is narrow."""
        params, prior = self._params.registration, estimate.covariance
        if params.method == "paper":
            found = register_by_paper(view.points, view.surface, prior)
        else:
            found = register(view.points, view.surface, prior, params)
        return self._corrected(estimate, found, view)

    @staticmethod
    def _corrected(estimate: Estimate, found: Registration, view: _View) -> Registration:
        """Correct an estimate by a registration; what it was corrected by."""
        if found.is_accepted:
            if isinstance(estimate, ScanFilter) and estimate.has_settled_near(found):
                # Scans have found the place already, and better.
                found = replace(found, offset=np.zeros(3), z=0.0)
            estimate.correct(found, view.T_odom_base)
        elif found.reason is Reason.FAR_FROM_PRIOR and isinstance(estimate, PoseFilter):
            estimate.inflate()
        return found

    def _track(self, found: Registration, view: _View, stamp_ns: int) -> Attempt:
        """Correct the pose by a registration of a short-term map."""
        found = self._corrected(self.estimate, found, view)
        self._is_settled |= found.is_accepted
        self.health.update(found, self.estimate.deviation[0])
        return self._attempt(Kind.TRACKING, found, view, stamp_ns)

    def _go_on_searching(self, under_way: _Search, stamp_ns: int) -> Attempt | None:
        """Search the whole map for a while; the estimate is not changed."""
        if not under_way.search.step(self._search_slice):
            return None
        found = under_way.search.result
        self._search = None
        # Several are told apart by scans, where the map knows nearly all that the robot sees.
        can_be_told = self._uses_scans and found.known >= _LEAST_KNOWN
        most = _MOST_HYPOTHESES if can_be_told else 1
        is_one_right = found.is_accepted or found.reason is Reason.AMBIGUOUS
        if is_one_right and found.is_complete and len(found.candidates) <= most:
            estimates = self._found_estimates(found, under_way)
            self._hypotheses = Hypotheses(estimates)
            self._confirmed = self._refused = 0
        return self._attempt(Kind.SEARCH, found, under_way.view, stamp_ns)

    def _found_estimates(self, found: SearchResult, under_way: _Search) -> Iterator[Estimate]:
        T_map_odom = under_way.T_map_odom
        T_map_base = T_map_odom @ under_way.view.T_odom_base
        for candidate in found.candidates:
            x, y, yaw = candidate.offset
            shift = se3.correction_about(T_map_base, (float(x), float(y), candidate.z), float(yaw))
            yield self._estimate_at(shift @ T_map_odom, _FOUND_COVARIANCE)

    def _confirm(self, hypotheses: Hypotheses, cells: LocalCells, stamp_ns: int) -> Attempt:
        """Hold several hypotheses against scans, and one that is alone against short-term maps."""
        view = self._view(hypotheses.best.estimate, cells)
        if len(hypotheses) > 1:
            assert self.long_term is not None
            returns = self._window.take(self._short_term.distance, stamp_ns)
            found = hypotheses.update(returns, view.T_odom_base, self.long_term)
            self._refused = self._refused + 1 if found.reason in CONTRADICTIONS else 0
            if self._refused >= self._params.localization.degraded_refusals:
                hypotheses.clear()  # not even the best one is right
        else:
            found = self._register(hypotheses.best.estimate, view)
            self._confirmed += 1
            # As in the search: a robot that sees beyond the map could be at any of its borders.
            if not found.is_accepted or found.known < self._params.registration.min_overlap:
                hypotheses.clear()
        weights = hypotheses.weights
        if not weights:
            self._hypotheses = None
        elif self._confirmed >= self._params.localization.confirmations:
            estimate = hypotheses.best.estimate
            self.set_pose(estimate.T_map_odom, estimate.covariance)
            self._is_settled = True
            self.health.begin(is_confirmed=True)
            self._is_search_wanted = False
        return replace(self._attempt(Kind.CONFIRMATION, found, view, stamp_ns), weights=weights)
