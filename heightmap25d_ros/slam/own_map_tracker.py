# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Localization on the map made so far, which grows by what it localizes.

The scan filter (`localization.scan_filter`) holds returns against walls and ground of the submaps
that are *active*: those that are near along the drive and its loops, so that all of them agree. The
scans since the update before are then inserted at the corrected pose. When a submap is long enough
the next one begins there; then older ones, to which the drift may have grown, are searched for the
robot (`loop_closure`).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization import surface
from heightmap25d_ros.localization.landmarks import Landmarks
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.odometry_errors import unknown_errors
from heightmap25d_ros.localization.registration import Reason, Registration
from heightmap25d_ros.localization.scan_filter import ScanFilter
from heightmap25d_ros.localization.scan_window import ScanWindow
from heightmap25d_ros.localization.short_term import distance_travelled
from heightmap25d_ros.localization.tracking_state import CONTRADICTIONS
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.bundle import Keyframe
from heightmap25d_ros.slam.loop_closure import Found, Query, same_drift, search
from heightmap25d_ros.slam.map_pass import ScanPose
from heightmap25d_ros.slam.own_map import landmarks_around, surroundings
from heightmap25d_ros.slam.pose_graph import Edge, PoseGraph, between
from heightmap25d_ros.slam.submaps import Submap

_START = np.diag(np.square([1e-3, 1e-3, 1e-3]))  # the map begins where the robot is
_WAIT_NS = 200_000_000  # after which scans are inserted without another update
_LEAST_EDGE = np.diag(np.square([0.01, 0.01, 0.002, 0.01]))  # covariance of a submap's length
_QUERY_DISTANCE = 8.0  # [m] of submaps in a robot's surroundings, when they are searched for
_QUERY_REACH = 12.0  # [m] from the robot
_QUERY_VIEWS, _VIEW_DISTANCE, _VIEW_RETURNS = 12, 0.5, 300  # windows of returns that prove a loop
_SIGMAS, _LEAST_RADIUS = 3.0, 1.0  # of a search for the robot; [m]
_LEAST_TURN = 0.2  # [rad] likewise
_IN_DOUBT = 1.0  # [m] travelled in contradiction to the map, without a new one being begun
_KEYFRAME_DISTANCE, _KEYFRAME_RETURNS = 0.08, 600  # [m] from one to the next
_MOSTLY_KNOWN = 0.3  # share of the returns, below which the map is used anew at once


class Placed(NamedTuple):
    """A scan, and where it was taken.

    Attributes
    ----------
    stamp_ns : int [ns]
    T_odom_base : (4, 4) float64
        At its first beam.
    submap : int
    T_submap_odom : (4, 4) float64
        In the frame of that submap.
    covariance : (3, 3) float64
        Of x, y [m], yaw [rad] since the beginning of that submap, along the axes of its frame.
    is_sure : bool
        Otherwise the map contradicts it, and it was not inserted.
    """

    stamp_ns: int
    T_odom_base: se3.Matrix
    submap: int
    T_submap_odom: se3.Matrix
    covariance: Array
    is_sure: bool


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


class _Waiting(NamedTuple):
    stamp_ns: int
    T_odom_base: se3.Matrix
    beams: Beams


class _View(NamedTuple):
    """Returns [m, odom] of a moment, and the correction that they were inserted with."""

    returns: Array
    submap: int
    T_submap_odom: se3.Matrix


class OwnMapTracker:
    """Maps without known poses.

    Parameters
    ----------
    params : Params
    T_map_odom : (4, 4) float64, optional
        Where the odometry's frame is in the map at first; the same by default.
    is_recording : bool
        Whether `placed` and `keyframes` are kept, which grow with time and distance.

    Attributes
    ----------
    submaps : list of Submap
        The last one is growing.
    graph : PoseGraph
        Of the beginnings of the submaps.
    attempts : list of LoopAttempt
    placed : list of Placed
    keyframes : list of Keyframe
    estimate : ScanFilter
        The correction of the odometry; its covariance is that to the active submaps.
    distance : float [m]
        Travelled so far, as of `distance_travelled`.
    unobserved : float [m]
        Of these without an update that was accepted.
    last : Registration or None
        The last update by scans.
    loops_closed : int
    """

    def __init__(
        self, params: Params, T_map_odom: se3.Matrix | None = None, *, is_recording: bool = True
    ) -> None:
        self._params = params
        self._is_recording = is_recording
        self.last: Registration | None = None
        self.loops_closed = 0
        self.submaps: list[Submap] = []
        self.graph = PoseGraph()
        self.attempts: list[LoopAttempt] = []
        self.placed: list[Placed] = []
        self.keyframes: list[Keyframe] = []
        self.estimate = ScanFilter(
            params, np.eye(4) if T_map_odom is None else T_map_odom, _START, unknown_errors(params)
        )
        self.distance = self.unobserved = 0.0
        self._window = ScanWindow(params.scan_filter)
        self._waiting: list[_Waiting] = []
        self._views: deque[_View] = deque(maxlen=_QUERY_VIEWS)
        self._T_odom_base: se3.Matrix | None = None
        self._landmarks: Landmarks | None = None
        self._active: list[Submap] = []
        self._refreshed = self._submap_begun = self._viewed = self._kept = -np.inf
        self._agreed = 0.0  # [m] travelled at the last update that the map did not contradict
        self._observed = 0.0  # [m] travelled at the last one that observed something
        self._is_contradicted = False
        self._drift = _Drift(params, self.estimate)
        self._covariance_begun = np.zeros((3, 3))
        self._inserted_ns = 0
        self._is_new_around = False
        self._pending: tuple[Edge, Found] | None = None

    @property
    def T_map_base(self) -> se3.Matrix:
        """Pose (4, 4) of the robot in the map."""
        assert self._T_odom_base is not None
        return np.asarray(self.estimate.T_map_odom @ self._T_odom_base)

    def covariance(self) -> Array:
        """(3, 3) float64: of x, y [m], yaw [rad] of the robot, seen from where it began."""
        if not self.submaps:
            return np.asarray(_START)
        away = (self.T_map_base - self.submaps[-1].T_map_submap @ self.submaps[-1].start)[:2, 3]
        begun = _carried(self._covariance_begun, away)
        return np.asarray(begun + self._drift.covariance[:3, :3] + _START)

    def mend(self, T_map_odom: se3.Matrix) -> None:
        """Odometry has jumped: its frame is now at a pose (4, 4), and the robot where it was."""
        if self._waiting:
            self._insert()
        if self._T_odom_base is not None:
            self._T_odom_base = se3.inverse(T_map_odom) @ self.T_map_base
        self.estimate.T_map_odom = T_map_odom
        self._window.clear()
        self._views.clear()

    def integrate(self, beams: Beams, T_odom_base: se3.Matrix, stamp_ns: int) -> None:
        """Take a scan in, with its beams in odom and the pose (4, 4) of the robot at its end."""
        self._move(T_odom_base)
        self._window.add(beams, stamp_ns)
        self._waiting.append(_Waiting(stamp_ns, T_odom_base, beams))
        if not self.submaps:
            self._begin_submap()
            self._insert()
        elif self._window.is_due(self.distance, stamp_ns):
            self._update(stamp_ns)
            self._insert()
        elif stamp_ns - self._waiting[0].stamp_ns > _WAIT_NS:
            self._insert()

    def finish(self) -> None:
        """No more scans will come."""
        if self._waiting:
            self._insert()
        if self.submaps:
            self._next_submap(self._inserted_ns)

    def poses(self) -> list[ScanPose]:
        """Where each scan was taken, by the submaps as they are now."""
        return [
            ScanPose(p.stamp_ns, self.submaps[p.submap].T_map_submap @ p.T_submap_odom, p.is_sure)
            for p in self.placed
        ]

    def covariances(self) -> list[Array]:
        """(3, 3) of x, y [m], yaw [rad] of the robot at each scan, seen from its first pose."""
        starts = [self.graph.covariance(0, number)[:3, :3] for number in range(len(self.submaps))]
        found = []
        for p in self.placed:
            submap = self.submaps[p.submap]
            start = submap.T_map_submap @ submap.start
            away = (submap.T_map_submap @ p.T_submap_odom @ p.T_odom_base - start)[:2, 3]
            found.append(_carried(starts[p.submap], away) + p.covariance)
        return found

    def _move(self, T_odom_base: se3.Matrix) -> None:
        before, self._T_odom_base = self._T_odom_base, T_odom_base
        if before is None:
            return
        travelled = distance_travelled(before, T_odom_base)
        if self.distance - self._observed > self._params.slam.refresh_distance:
            self.unobserved += travelled
        self.estimate.predict(before, T_odom_base)
        self._drift.move(before, T_odom_base)
        self.distance += travelled

    def _update(self, stamp_ns: int) -> None:
        """Hold the returns of the last moment against the active submaps."""
        assert self._T_odom_base is not None
        returns = self._window.take(self.distance, stamp_ns)
        if self._landmarks is None:
            self._window.confirm()
            return
        found = self.estimate.update_growing(returns, self._T_odom_base, self._landmarks)
        self.last = found
        self._is_new_around = found.known < _MOSTLY_KNOWN
        if found.reason in (Reason.ACCEPTED, Reason.UNOBSERVED):
            self._observed = self.distance
        self._is_contradicted = found.reason is Reason.HIGH_RESIDUAL
        if not self._is_contradicted:
            self._agreed = self.distance
        if found.reason not in CONTRADICTIONS:
            self._window.confirm()
        self._drift.see(found)
        if self._is_recording and self.distance - self._kept >= _KEYFRAME_DISTANCE:
            self._keep(returns)
        if self.distance - self._viewed >= _VIEW_DISTANCE:
            self._viewed = self.distance
            some = returns[:: 1 + len(returns) // _VIEW_RETURNS]
            self._views.append(_View(some, len(self.submaps) - 1, self._T_submap_odom()))

    def _keep(self, returns: Array) -> None:
        """Keep a moment of the drive, with its returns."""
        assert self._T_odom_base is not None
        self._kept = self.distance
        some = returns[:: 1 + len(returns) // _KEYFRAME_RETURNS].astype(np.float32)
        self.keyframes.append(Keyframe(
            len(self.placed) + len(self._waiting) - 1, len(self.submaps) - 1,
            self._T_submap_odom(), self._T_odom_base, some,
        ))  # fmt: skip

    def _T_submap_odom(self) -> se3.Matrix:
        T_submap_map = se3.inverse(self.submaps[-1].T_map_submap)
        return np.asarray(T_submap_map @ self.estimate.T_map_odom)

    def _insert(self) -> None:
        """Insert the scans that wait, at the pose as it is now."""
        T_submap_odom = self._T_submap_odom()
        covariance = self._drift.covariance[:3, :3]
        is_sure = not self._is_contradicted or self.distance - self._agreed > _IN_DOUBT
        for waiting in self._waiting:
            beams = waiting.beams
            placed = replace(
                beams,
                origins=np.ascontiguousarray(se3.transform_points(T_submap_odom, beams.origins)),
                ends=np.ascontiguousarray(se3.transform_points(T_submap_odom, beams.ends)),
            )
            if is_sure:
                self.submaps[-1].integrate(placed, self.distance)
            if self._is_recording:
                self.placed.append(Placed(
                    waiting.stamp_ns, waiting.T_odom_base, len(self.submaps) - 1, T_submap_odom,
                    covariance, is_sure,
                ))  # fmt: skip
        stamp_ns = self._inserted_ns = self._waiting[-1].stamp_ns
        self._waiting.clear()
        slam = self._params.slam
        if self.distance - self._submap_begun >= slam.submap_length:
            self._next_submap(stamp_ns)
        if self._is_new_around or self.distance - self._refreshed >= slam.refresh_distance:
            self._refresh()

    def _refresh(self) -> None:
        """Use what has been mapped since."""
        slam = self._params.slam
        self._refreshed, self._is_new_around = self.distance, False
        self._landmarks = landmarks_around(
            self._active, self.T_map_base[:3, 3], slam.reach, self._params.grid.resolution
        )

    def _begin_submap(self) -> None:
        """The next submap begins at the robot; scans are held against those near along the way."""
        submap = Submap(self.T_map_base, self._params)
        self.submaps.append(submap)
        self.graph.add(submap.pose)
        self._submap_begun = self.distance
        self._drift = _Drift(self._params, self.estimate)
        self._choose_active()

    def _choose_active(self) -> None:
        limit = self._params.slam.active_distance
        near = self.graph.distances(len(self.submaps) - 1, limit)
        self._active = [s for s, d in zip(self.submaps, near, strict=True) if np.isfinite(d)]

    def _next_submap(self, stamp_ns: int) -> None:
        """Finish a submap, begin the next one, and look whether the robot has been there before."""
        before = self.submaps[-1].pose
        self.submaps[-1].finish()
        travelled = self.distance - self._submap_begun
        covariance = self._drift.covariance + _LEAST_EDGE
        self._begin_submap()
        newest = len(self.submaps) - 1
        turned = _turned(covariance, -before[2])
        self.graph.join(Edge(
            newest - 1, newest, between(before, self.submaps[-1].pose),
            np.asarray(np.linalg.inv(turned)), distance=travelled,
        ))  # fmt: skip
        self._choose_active()
        self._covariance_begun = self.graph.covariance(0, newest)[:3, :3]
        if self._params.slam.close_loops:
            self._look_back(stamp_ns)

    def _look_back(self, stamp_ns: int) -> None:
        """Search older submaps for the robot; join them where the search before agrees."""
        newest = len(self.submaps) - 1
        candidate = self._oldest_near(newest)
        if candidate is None:
            return
        first, radius, turn, older = candidate
        query = self._query()
        found = search(query, older, radius, turn, self._params)
        edge, outcome = self._edge(first, newest, found), found.reason.value
        pending, self._pending = self._pending, None
        if found.reason is Reason.ACCEPTED:
            outcome = "waits for another one"
            self._pending = edge, found
            if pending is not None and same_drift(pending[1], found, query.T_map_base):
                outcome = "closed"
        away = float(np.linalg.norm(((found.drift - np.eye(4)) @ query.T_map_base)[:2, 3]))
        self.attempts.append(LoopAttempt(
            stamp_ns=stamp_ns, first=first, second=newest, outcome=outcome, drift=away,
            radius=radius,
        ))  # fmt: skip
        if outcome == "closed" and pending is not None:
            self._close([pending[0], edge])

    def _oldest_near(self, newest: int) -> tuple[int, float, float, list[Submap]] | None:
        """The nearest of the submaps that are not active, how far off it may be, and its like."""
        slam, position = self._params.slam, self.T_map_base[:3, 3]
        active = {id(submap) for submap in self._active}
        near: list[tuple[float, int]] = []
        for number, submap in enumerate(self.submaps):
            if id(submap) not in active:
                low, high = submap.bounds()
                away = float(np.linalg.norm(np.clip(position[:2], low, high) - position[:2]))
                begun = float(np.linalg.norm(submap.pose[:2] - position[:2]))
                if away < slam.max_drift and begun < slam.max_drift + slam.submap_length:
                    near.append((begun, number))
        for begun, number in sorted(near):
            covariance = self.graph.covariance(number, newest)
            deviation = float(np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
            radius = _SIGMAS * deviation + _LEAST_RADIUS
            if begun <= radius + slam.submap_length:
                turn = _SIGMAS * float(np.sqrt(covariance[2, 2])) + _LEAST_TURN
                reached = self.graph.distances(number, slam.active_distance)
                older = [
                    s for s, d in zip(self.submaps, reached, strict=True)
                    if np.isfinite(d) and id(s) not in active
                ]  # fmt: skip
                return number, min(radius, slam.max_drift), min(turn, np.pi), older
        return None

    def _query(self) -> Query:
        T_map_base, params = self.T_map_base, self._params
        near = self.graph.distances(len(self.submaps) - 1, _QUERY_DISTANCE)
        recent = [s for s, d in zip(self.submaps, near, strict=True) if np.isfinite(d)]
        position = T_map_base[:3, 3]
        height_map, layers = surroundings(recent, position, _QUERY_REACH, params.grid.resolution)
        heights = height_map.metres.astype(np.float32)
        is_edge = surface.edges(heights, params.registration.edge_step)
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
        returns = [
            se3.transform_points(self.submaps[v.submap].T_map_submap @ v.T_submap_odom, v.returns)
            for v in self._views
        ]
        seen = np.concatenate(returns) - position if returns else np.empty((0, 3))
        return Query(T_map_base=T_map_base, points=points, returns=seen)

    def _edge(self, first: int, newest: int, found: Found) -> Edge:
        x, y, z, _, _, yaw = se3.to_xyz_rpy(found.drift @ self.T_map_base)
        old = self.submaps[first].pose
        measured = between(old, np.array([x, y, yaw, z]))
        information = np.asarray(np.linalg.inv(_turned(found.covariance, -old[2])))
        return Edge(first, newest, measured, information, is_loop=True)

    def _close(self, edges: list[Edge]) -> None:
        """Join submaps, move all of them to where they agree, and the robot with the newest."""
        for edge in edges:
            self.graph.join(edge)
        before = self.submaps[-1].T_map_submap @ self.submaps[-1].start
        self.graph.optimise()
        for submap, pose in zip(self.submaps, self.graph.poses, strict=True):
            submap.move_to(pose)
        self.loops_closed += 1
        self._covariance_begun = self.graph.covariance(0, len(self.submaps) - 1)[:3, :3]
        newest = self.submaps[-1]
        moved = newest.T_map_submap @ newest.start @ se3.inverse(before)
        self.estimate.T_map_odom = moved @ self.estimate.T_map_odom
        self._choose_active()
        self._refresh()


class _Drift:
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


def _carried(covariance: Array, away: Array) -> Array:
    """A covariance (3, 3) of x, y, yaw at one place, at another (2,) [m] away from it."""
    lever = np.eye(3)
    lever[0, 2], lever[1, 2] = -away[1], away[0]
    return np.asarray(lever @ covariance @ lever.T)


def _turned(covariance: Array, yaw: float) -> Array:
    """A covariance (4, 4) of x, y, yaw, z along axes that are turned by a yaw [rad]."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.eye(4)
    turn[:2, :2] = [[cos, -sin], [sin, cos]]
    return np.asarray(turn @ covariance @ turn.T)
