# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the robot is where it has been before: a search of older submaps, and its proof.

The robot's surroundings are searched in older submaps, as far around the expected pose as the drift
may have led it, by the search that finds every place that fits (`global_search`). A pose counts if
no other one is as good, and if the returns of the last metres agree with walls and ground there
(`scan_update`), which also measure it to centimetres. One such pose may still be chance: it is
joined when the next search, some metres on, finds the same drift.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.global_search import GlobalSearch, Prior
from heightmap25d_ros.localization.landmarks import Landmarks, landmarks_of
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.registration import Reason
from heightmap25d_ros.localization.scan_update import Update, update_by_returns
from heightmap25d_ros.localization.sliced_search import SlicedSearch
from heightmap25d_ros.localization.surface import edges, surface_of
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.own_map import surroundings
from heightmap25d_ros.slam.submaps import MappedCells

_QUERY_REACH = 12.0  # [m] from the robot, of its surroundings
_LEAST_AGREEING = 0.75  # share of the returns over known places that must agree with these
_MOST_RESIDUAL = 0.04  # [m] mean distance from walls and ground, of at most 0.1 m each
_NEAR = np.square([0.1, 0.1, 0.03, 0.1])  # variances about a pose that was found
_FLOOR = np.diag(np.square([0.02, 0.02, 0.005, 0.02]))  # of a loop: submaps are not quite rigid
_LEAST_KNOWN = 0.5  # share of the returns near known places of which the map must tell something
_SAME_PLACE, _SAME_YAW = 0.2, 0.05  # [m], [rad] between the drifts that two searches find


@dataclass(frozen=True, slots=True, kw_only=True)
class Query:
    """The robot and what it has seen last, in the map as it is.

    Attributes
    ----------
    T_map_base : (4, 4) float64
    points : RegistrationPoints
        Cells of its surroundings, about the robot.
    returns : (N, 3) float64 [m]
        Returns of the last metres, seen from the robot along the axes of the map.
    """

    T_map_base: se3.Matrix
    points: RegistrationPoints
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
    """

    reason: Reason
    drift: se3.Matrix
    covariance: Array


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
    position, resolution = T_map_base[:3, 3], params.grid.resolution
    height_map, layers = surroundings(recent, position, _QUERY_REACH, resolution)
    heights = height_map.metres.astype(np.float32)
    is_edge = edges(heights, params.registration.edge_step)
    known = height_map.known
    use_elevated = layers.elevated_count > 0
    offset_x = np.where(use_elevated, layers.elevated_x, layers.ground_x)[known]
    offset_y = np.where(use_elevated, layers.elevated_y, layers.ground_y)[known]
    centres = height_map.geometry.cell_center(np.argwhere(known))
    xy = centres + np.column_stack([offset_x, offset_y]) - position[:2]
    points = RegistrationPoints(
        np.ascontiguousarray(np.column_stack([xy, heights[known]]), np.float64),
        is_edge[known], np.ones(len(xy)), (float(position[0]), float(position[1])),
    )  # fmt: skip
    seen = np.concatenate(returns) - position if returns else np.empty((0, 3))
    return Query(T_map_base=T_map_base, points=points, returns=seen)


class LoopSearch(SlicedSearch[Found]):
    """A search of submaps for the robot, that is done in slices.

    Parameters
    ----------
    query : Query
    submaps : sequence of MappedCells
    radius, turn : float [m], [rad]
        How far from the expected pose.
    params : Params
    """

    def __init__(
        self,
        query: Query,
        submaps: Sequence[MappedCells],
        radius: float,
        turn: float,
        params: Params,
    ) -> None:
        self._query, self._submaps, self._params = query, submaps, params
        x, y = (float(coordinate) for coordinate in query.T_map_base[:2, 3])
        self._prior = Prior(x, y, radius, turn)
        super().__init__()

    def _run(self) -> Iterator[Found | None]:
        query, params = self._query, self._params
        T_map_base, reach = query.T_map_base, params.slam.reach + self._prior.radius
        height_map, layers = surroundings(
            self._submaps, T_map_base[:3, 3], reach, params.grid.resolution
        )
        yield None
        surface = surface_of(height_map, params.registration.edge_step)
        yield None
        search = GlobalSearch(query.points, surface, params.registration, self._prior)
        while not search.step(0.0):
            yield None
        found = search.result
        if not found.is_accepted:
            yield Found(reason=found.reason, drift=np.eye(4), covariance=np.eye(4))
            return
        landmarks = landmarks_of(height_map, layers)
        yield None
        x, y, yaw = found.offset
        coarse = se3.correction_about(T_map_base, (float(x), float(y), found.z), float(yaw))
        yield _proven(query, coarse, landmarks, params)


def _proven(query: Query, coarse: se3.Matrix, landmarks: Landmarks, params: Params) -> Found:
    """Hold the returns against walls and ground, where a search has found the robot."""
    T_map_base = coarse @ query.T_map_base
    position = T_map_base[:3, 3]
    returns = query.returns @ coarse[:3, :3].T
    update = update_by_returns(
        np.ascontiguousarray(returns), np.ascontiguousarray(position), np.diag(1.0 / _NEAR),
        landmarks, params.scan_filter,
    )  # fmt: skip
    x, y, yaw, z = (float(error) for error in update.error[:4])
    drift = se3.correction_about(T_map_base, (x, y, z), yaw) @ coarse
    observed = update.information + np.diag(1.0 / _NEAR)
    covariance = np.asarray(np.linalg.inv(observed)) + _FLOOR
    return Found(reason=_judged(update, params), drift=drift, covariance=covariance)


def _judged(update: Update, params: Params) -> Reason:
    known = update.over_known
    if known < max(_LEAST_KNOWN * update.near_known, params.scan_filter.min_returns):
        return Reason.LITTLE_OVERLAP
    if update.agreeing < _LEAST_AGREEING * known or update.residual > _MOST_RESIDUAL:
        return Reason.HIGH_RESIDUAL
    return Reason.ACCEPTED


def same_drift(first: Found, second: Found, T_map_base: se3.Matrix) -> bool:
    """Whether two searches have found the same drift, within what a submap may be off."""
    apart = second.drift @ se3.inverse(first.drift)
    moved = (apart - np.eye(4)) @ second.drift @ T_map_base[:, 3]
    turn = abs(se3.yaw(apart))
    return bool(np.hypot(moved[0], moved[1]) < _SAME_PLACE and turn < _SAME_YAW)
