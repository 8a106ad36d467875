# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the robot is where it has been before: a search of older submaps, and its proof.

The robot's surroundings are searched in older submaps, as far around the expected pose as the drift
may have led it, by the search that finds every place that fits (`global_search`). At each of them
the returns of the last metres are held against walls and ground (`scan_update`), which measures the
pose to centimetres, and the surroundings against the older ones as two maps are
(`map_registration`): what the robot sees standing where there was free ground speaks against a
place, however much of it agrees. So does what stood there and is not seen. Rough ground is full of
low steps that are seen from one side alone, so only what stands 0.3 m high or more says so. That
matters most where the robot is on ground that it has not seen before, since then it is at none of
the places found.

A place counts if it is the only one that fits: the others must be ruled out by what was seen, and
not by their rank. One such place may still be chance: it is joined when it is the only one again
some metres on. There it is looked at whether the search finds it or not, and given up only if what
is seen there rules it out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.global_search import Candidate, GlobalSearch, Prior
from heightmap25d_ros.localization.registration import Reason
from heightmap25d_ros.localization.scan_update import Update, update_by_returns
from heightmap25d_ros.localization.sliced_search import SlicedSearch
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.map_registration import AS_GOOD, LEAST_SCORE, RegisteredMap, agreement
from heightmap25d_ros.slam.own_map import surroundings
from heightmap25d_ros.slam.submaps import MappedCells

_QUERY_REACH = 12.0  # [m] from the robot, of its surroundings
_LEAST_AGREEING = 0.75  # share of the returns over known places that must agree with these
_MOST_RESIDUAL = 0.04  # [m] mean distance from walls and ground, of at most 0.1 m each
_NEAR = np.square([0.1, 0.1, 0.03, 0.1])  # variances about a pose that was found
_AROUND = np.square([0.5, 0.5, 0.1, 0.5])  # what is known without what returns tell
_FLOOR = np.diag(np.square([0.02, 0.02, 0.005, 0.02]))  # of a loop: submaps are not quite rigid
_CONTRADICTION = 40.0  # cells of walls that agree, for each that stands where nothing was
_LEAST_KNOWN = 0.5  # share of the returns near known places of which the map must tell something
_SAME_PLACE, _SAME_YAW = 0.2, 0.05  # [m], [rad] between the drifts that two searches find


@dataclass(frozen=True, slots=True, kw_only=True)
class Query:
    """The robot and what it has seen last, in the map as it is.

    Attributes
    ----------
    T_map_base : (4, 4) float64
    surroundings : RegisteredMap
        Of the robot, as it has seen them last.
    returns : (N, 3) float64 [m]
        Returns of the last metres, seen from the robot along the axes of the map.
    """

    T_map_base: se3.Matrix
    surroundings: RegisteredMap
    returns: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """The outcome of a search of older submaps.

    Attributes
    ----------
    reason : Reason
        Accepted, or why not.
    drift : (4, 4) float64
        What moves the present map to where the older one has the same; map.
    covariance : (4, 4) float64
        Of x, y, yaw, z of the robot, as it was found in these.
    possible : tuple of (4, 4) float64
        All drifts that this search does not rule out.
    """

    reason: Reason
    drift: se3.Matrix
    covariance: Array
    possible: tuple[se3.Matrix, ...] = ()

    def seen_from(self, moved: se3.Matrix) -> Found:
        """The same place, after a motion (4, 4) of the robot in the present map."""
        back = se3.inverse(moved)
        return replace(
            self, drift=self.drift @ back, possible=tuple(drift @ back for drift in self.possible)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopAttempt:
    """A search of older submaps, and what became of it.

    Attributes
    ----------
    stamp_ns : int [ns]
    first, second : int
        The submaps that it would join; the second is the newer one.
    outcome : str
        "closed", or why not.
    drift : float [m]
        How far the robot was found from where it was expected.
    radius : float [m]
        Within which it was searched.
    """

    stamp_ns: int
    first: int
    second: int
    outcome: str
    drift: float
    radius: float


def query_of(
    recent: Sequence[MappedCells],
    T_map_base: se3.Matrix,
    returns: Sequence[Array],
    params: Params,
) -> Query:
    """The robot at a pose (4, 4) in the last submaps, with returns (N, 3) [m, map] of moments."""
    position = T_map_base[:3, 3]
    found = surroundings(recent, position, _QUERY_REACH, params.grid.resolution)
    seen = np.concatenate(returns) - position if returns else np.empty((0, 3))
    return Query(
        T_map_base=T_map_base,
        surroundings=RegisteredMap(*found, params, is_growing=True),
        returns=seen,
    )


class LoopSearch(SlicedSearch[Found]):
    """A search of submaps for the robot, that is done in slices.

    Parameters
    ----------
    query : Query
    submaps : sequence of MappedCells
    radius, turn : float [m], [rad]
        How far from the expected pose.
    params : Params
    waiting : (4, 4) float64, optional
        A drift that another search has found, some metres ago.
    """

    def __init__(
        self,
        query: Query,
        submaps: Sequence[MappedCells],
        radius: float,
        turn: float,
        params: Params,
        waiting: se3.Matrix | None = None,
    ) -> None:
        self._query, self._submaps, self._params = query, submaps, params
        self._waiting = [] if waiting is None else [waiting]
        x, y = (float(coordinate) for coordinate in query.T_map_base[:2, 3])
        self._prior = Prior(x, y, radius, turn)
        super().__init__()

    def _run(self) -> Iterator[Found | None]:
        query, params = self._query, self._params
        T_map_base, reach = query.T_map_base, params.slam.reach + self._prior.radius
        found_around = surroundings(self._submaps, T_map_base[:3, 3], reach, params.grid.resolution)
        older = RegisteredMap(*found_around, params, is_growing=True)
        yield None
        points = query.surroundings.piece(T_map_base[:3, 3], _QUERY_REACH)
        search = GlobalSearch(points, older.surface, params.registration, self._prior)
        yield None
        while not search.step(0.0):
            yield None
        found = search.result
        drifts, has_found = [*self._waiting], found.reason in (Reason.ACCEPTED, Reason.AMBIGUOUS)
        if has_found:
            drifts += [_drift_of(candidate, T_map_base) for candidate in found.candidates]
        if found.reason is Reason.LITTLE_OVERLAP or not drifts:
            yield _refused(found.reason, self._waiting)
            return
        places: list[_Place] = []
        for drift in drifts:
            place = _place(query, drift, older, params)
            if not any(same_drift(place.drift, other.drift, T_map_base) for other in places):
                places.append(place)
            yield None
        yield _judged(places, has_found_all=found.has_found_all or not has_found)


class _Place(NamedTuple):
    """Where a search has found the robot, measured, and whether it fits or why not.

    The score is the number of cells of walls that agree, less as many for each that stands where
    nothing was, or the other way round, as it weighs.
    """

    reason: Reason
    drift: se3.Matrix
    covariance: Array
    score: float


def _drift_of(candidate: Candidate, T_map_base: se3.Matrix) -> se3.Matrix:
    """The drift (4, 4) of a robot at a pose (4, 4) that is where a search has found it."""
    x, y, yaw = (float(offset) for offset in candidate.offset)
    return se3.correction_about(T_map_base, (x, y, candidate.z), yaw)


def _place(query: Query, coarse: se3.Matrix, older: RegisteredMap, params: Params) -> _Place:
    """Hold what was seen against walls and ground, about where a drift (4, 4) has the robot."""
    T_map_base = coarse @ query.T_map_base
    position = T_map_base[:3, 3]
    returns = query.returns @ coarse[:3, :3].T
    update = update_by_returns(
        np.ascontiguousarray(returns), np.ascontiguousarray(position), np.diag(1.0 / _NEAR),
        older.landmarks, params.scan_filter,
    )  # fmt: skip
    x, y, yaw, z = (float(error) for error in update.error[:4])
    drift = se3.correction_about(T_map_base, (x, y, z), yaw) @ coarse
    observed = update.information + np.diag(1.0 / _AROUND)
    covariance = np.asarray(np.linalg.inv(observed)) + _FLOOR
    found = agreement(drift, older, query.surroundings, params)
    score = found.agreeing - _CONTRADICTION * found.contradicted
    return _Place(_fit(update, score, params), drift, covariance, score)


def _fit(update: Update, score: float, params: Params) -> Reason:
    """Whether a place fits, is ruled out, or too little of it is known to tell."""
    known = update.over_known
    if known < max(_LEAST_KNOWN * update.near_known, params.scan_filter.min_returns):
        return Reason.LITTLE_OVERLAP
    if update.agreeing < _LEAST_AGREEING * known or update.residual > _MOST_RESIDUAL or score < 0:
        return Reason.HIGH_RESIDUAL
    return Reason.ACCEPTED


def _judged(places: Sequence[_Place], *, has_found_all: bool) -> Found:
    """The only place that fits, or why there is none."""
    fitting = sorted(
        (place for place in places if place.reason is Reason.ACCEPTED),
        key=lambda place: -place.score,
    )
    as_good = [place for place in fitting if place.score >= AS_GOOD * fitting[0].score]
    untold = [place for place in places if place.reason is Reason.LITTLE_OVERLAP]
    possible = [place.drift for place in as_good + untold]
    if not possible:
        return _refused(Reason.HIGH_RESIDUAL)
    if not fitting or fitting[0].score < LEAST_SCORE:
        return _refused(Reason.LITTLE_OVERLAP, possible)
    if len(possible) > 1 or not has_found_all:
        return _refused(Reason.AMBIGUOUS, possible)
    only = fitting[0]
    return Found(
        reason=only.reason, drift=only.drift, covariance=only.covariance, possible=(only.drift,)
    )


def _refused(reason: Reason, possible: Sequence[se3.Matrix] = ()) -> Found:
    return Found(reason=reason, drift=np.eye(4), covariance=np.eye(4), possible=tuple(possible))


def same_drift(first: se3.Matrix, second: se3.Matrix, T_map_base: se3.Matrix) -> bool:
    """Whether two drifts (4, 4) are the same for a robot, within what a submap may be off."""
    apart = second @ se3.inverse(first)
    moved = (apart - np.eye(4)) @ second @ T_map_base[:, 3]
    turn = abs(se3.yaw(apart))
    return bool(np.hypot(moved[0], moved[1]) < _SAME_PLACE and turn < _SAME_YAW)
