# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Localization on the map made so far, which grows by what it localizes.

The scan filter (`localization.scan_filter`) holds returns against walls and ground of the submaps
that are active (`submap_graph`). The scans since the update before are then inserted at the
corrected pose. When a submap is long enough the next one begins there; then older ones, to which
the drift may have grown, are searched for the robot (`loop_closure`).

What is called odom here is the odometry as level lasers correct it, see `laser_odometry`; that of
the wheels is told from it where scans come in, and where poses go out. For all other robots they
are the same.
"""

from __future__ import annotations

from collections import deque
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.landmarks import Landmarks
from heightmap25d_ros.localization.odometry_errors import unknown_errors
from heightmap25d_ros.localization.registration import Reason, Registration
from heightmap25d_ros.localization.scan_filter import ScanFilter
from heightmap25d_ros.localization.scan_window import ScanWindow
from heightmap25d_ros.localization.short_term import distance_travelled
from heightmap25d_ros.localization.tracking_state import CONTRADICTIONS
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.bundle import Keyframe
from heightmap25d_ros.slam.drift import Drift, carried
from heightmap25d_ros.slam.edges import edges_of
from heightmap25d_ros.slam.laser_odometry import LaserOdometry
from heightmap25d_ros.slam.live_refinement import LiveRefinement
from heightmap25d_ros.slam.loop_closure import (
    Found,
    LoopAttempt,
    LoopSearch,
    query_of,
    same_drift,
)
from heightmap25d_ros.slam.map_pass import ScanPose
from heightmap25d_ros.slam.own_map import landmarks_around
from heightmap25d_ros.slam.pose_graph import Edge, PoseGraph
from heightmap25d_ros.slam.saved_map import SavedMap
from heightmap25d_ros.slam.submap_graph import Candidate, SubmapGraph
from heightmap25d_ros.slam.submaps import Submap

_START = np.diag(np.square([1e-3, 1e-3, 1e-3]))  # the map begins where the robot is
_WAIT_NS = 200_000_000  # after which scans are inserted without another update
_QUERY_DISTANCE = 8.0  # [m] of submaps in a robot's surroundings, when they are searched for
_QUERY_VIEWS, _VIEW_DISTANCE, _VIEW_RETURNS = 12, 0.5, 300  # windows of returns that prove a loop
_IN_DOUBT = 1.0  # [m] travelled in contradiction to the map, without a new one being begun
_KEYFRAME_DISTANCE, _KEYFRAME_RETURNS = 0.08, 600  # [m] from one to the next
_LEAST_SUBMAP = 1.0  # [m] after which a submap ends that scans alone do not hold together
_LOOSE, _LOOSE_YAW = 0.025, 0.005  # [m], [rad] standard deviation along it, from which that is so
_MOSTLY_KNOWN = 0.3  # share of the returns, below which the map is used anew at once


class Placed(NamedTuple):
    """A scan, and where it was taken.

    Attributes
    ----------
    stamp_ns : int [ns]
    T_odom_base : (4, 4) float64
        At its end.
    T_odom_wheels : (4, 4) float64
        Where the frame of the odometry that came with the scan is.
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
    T_odom_wheels: se3.Matrix
    submap: int
    T_submap_odom: se3.Matrix
    covariance: Array
    is_sure: bool


class _Waiting(NamedTuple):
    stamp_ns: int
    T_odom_base: se3.Matrix
    T_odom_wheels: se3.Matrix
    beams: Beams


class _View(NamedTuple):
    """Returns [m, odom] of a moment, and the correction that they were inserted with."""

    returns: Array
    submap: int
    T_submap_odom: se3.Matrix


class _Searching(NamedTuple):
    """A search of older submaps that is under way, from where the newest one was begun.

    Attributes
    ----------
    moved : (4, 4) float64
        What has moved the robot since.
    """

    search: LoopSearch
    candidate: Candidate
    second: int
    T_map_base: se3.Matrix
    stamp_ns: int
    moved: se3.Matrix

    def seen_from(self, moved: se3.Matrix) -> _Searching:
        """The same, after a motion (4, 4) of the robot."""
        return self._replace(moved=moved @ self.moved)


class OwnMapTracker:
    """Maps without known poses.

    Parameters
    ----------
    params : Params
    T_map_odom : (4, 4) float64, optional
        Where the odometry's frame is in the map at first; the same by default.
    covariance : (3, 3) float64, optional
        Of x, y [m], yaw [rad] of the robot there, on the saved map.
    saved : SavedMap, optional
        From which the drive goes on, in its frame.
    search_slice : float [s]
        Time of a search for loops between two scans; all at once by default, so that the result
        does not depend on the machine.
    is_recording : bool
        Whether `placed` and `keyframes` are kept, which grow with time.

    Attributes
    ----------
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
    refined : int
        How often the last metres were refined together.
    begun_ns : int [ns]
        Stamp of the first scan.
    """

    def __init__(
        self,
        params: Params,
        T_map_odom: se3.Matrix | None = None,
        covariance: Array = _START,
        *,
        saved: SavedMap | None = None,
        search_slice: float = np.inf,
        is_recording: bool = True,
    ) -> None:
        self._params = params
        self._is_recording = is_recording
        self.last: Registration | None = None
        self.loops_closed = self.refined = self.begun_ns = 0
        self._search_slice = search_slice
        self._map = SubmapGraph(params, saved)
        self.attempts: list[LoopAttempt] = []
        self.placed: list[Placed] = []
        self.keyframes: list[Keyframe] = []
        self.estimate = ScanFilter(
            params,
            np.eye(4) if T_map_odom is None else T_map_odom,
            covariance,
            unknown_errors(params),
        )
        self.distance = self.unobserved = 0.0
        self._laser = LaserOdometry(params.slam.active_distance)
        self._window = ScanWindow(params.scan_filter)
        self._waiting: list[_Waiting] = []
        self._views: deque[_View] = deque(maxlen=_QUERY_VIEWS)
        self._T_odom_base: se3.Matrix | None = None
        self._landmarks: Landmarks | None = None
        self._refreshed = self._submap_begun = self._viewed = self._kept = -np.inf
        self._looked = 0.0  # [m] travelled at the last look back
        self._agreed = 0.0  # [m] travelled at the last update that the map did not contradict
        self._observed = 0.0  # [m] travelled at the last one that observed something
        self._is_contradicted = self._is_on_saved = False
        self._drift = Drift(params, self.estimate)
        self._refinement = LiveRefinement(params.scan_filter)
        self._moved = np.eye(4)  # with the map, all in all
        self._inserted_ns = 0
        self._is_new_around = False
        self._searching: _Searching | None = None
        self._next: _Searching | None = None  # the newest one that waits
        self._pending: tuple[Edge, Found] | None = None

    @property
    def submaps(self) -> list[Submap]:
        """All of them; the last one is growing."""
        return self._map.submaps

    @property
    def graph(self) -> PoseGraph:
        """Of the beginnings of the submaps."""
        return self._map.graph

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
        begun = carried(self._map.covariance[:3, :3], away)
        return np.asarray(begun + self._drift.covariance[:3, :3] + _START)

    @property
    def z_variance(self) -> float:
        """Of the robot [m^2], seen from where it began."""
        return float(self._map.covariance[3, 3] + self._drift.covariance[3, 3] + _START[0, 0])

    @property
    def is_level(self) -> bool:
        """Whether no laser has seen the ground so far."""
        return self._laser.is_level

    @property
    def T_map_wheels(self) -> se3.Matrix:
        """Pose (4, 4) in the map of the frame of the odometry that comes with the scans."""
        return np.asarray(self.estimate.T_map_odom @ self._laser.T_odom_wheels)

    def mend(self, T_map_wheels: se3.Matrix) -> None:
        """The wheels' odometry has jumped: its frame is at a pose (4, 4), the robot as before."""
        if self._waiting:
            self._insert()
        self._laser.mend(se3.inverse(self.estimate.T_map_odom) @ T_map_wheels)
        self._window.clear()
        self._views.clear()

    def integrate(self, beams: Beams, T_wheels_base: se3.Matrix, stamp_ns: int) -> None:
        """Take a scan in, with its beams and the pose (4, 4) of the robot at its end by wheels."""
        beams = self._laser.correct(beams, T_wheels_base)
        T_odom_wheels = self._laser.T_odom_wheels
        T_odom_base = T_odom_wheels @ T_wheels_base
        self._move(T_odom_base)
        self._window.add(beams, stamp_ns)
        self._waiting.append(_Waiting(stamp_ns, T_odom_base, T_odom_wheels, beams))
        if not self.submaps:
            self.begun_ns = stamp_ns
            self._map.begin(self.T_map_base, self.estimate.covariance)
            self._begun()
            self._insert()
        elif self._window.is_due(self.distance, stamp_ns):
            self._update(stamp_ns)
            self._insert()
        elif stamp_ns - self._waiting[0].stamp_ns > _WAIT_NS:
            self._insert()
        self.go_on_searching()

    def go_on_searching(self) -> None:
        """Give what is under way its time, whatever else there is to do."""
        self._refine_for_a_while()
        if self._searching is not None:
            self._search_for_a_while(self._searching)

    def finish(self) -> None:
        """No more scans will come."""
        if self._waiting:
            self._insert()
        if self.submaps:
            self._looked = -np.inf  # once more, however near the last look was
            self._next_submap(self._inserted_ns)
            self.go_on_searching()

    def poses(self) -> list[ScanPose]:
        """Where each scan was taken, by the submaps as they are now."""
        return [
            ScanPose(
                p.stamp_ns,
                self.submaps[p.submap].T_map_submap @ p.T_submap_odom @ p.T_odom_wheels,
                p.is_sure,
            )
            for p in self.placed
        ]

    def covariances(self) -> list[Array]:
        """(3, 3) of x, y [m], yaw [rad] of the robot at each scan, seen from its first pose."""
        starts = self.graph.covariances(0, range(len(self.submaps)))[:, :3, :3]
        found = []
        for p in self.placed:
            submap = self.submaps[p.submap]
            start = submap.T_map_submap @ submap.start
            away = (submap.T_map_submap @ p.T_submap_odom @ p.T_odom_base - start)[:2, 3]
            found.append(carried(starts[p.submap], away) + p.covariance)
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
        if self._is_on_saved:
            found = self.estimate.update(returns, self._T_odom_base, self._landmarks)
        else:
            found = self.estimate.update_growing(
                returns, self._T_odom_base, self._landmarks, has_ground=not self._laser.is_level
            )
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
        # The first update has one scan, of the ground perhaps, and the frame is what it tells of.
        is_beginning = self.distance < _KEYFRAME_DISTANCE
        self._keep(is_beginning)
        if self.distance - self._viewed >= _VIEW_DISTANCE:
            self._viewed = self.distance
            some = returns[:: 1 + len(returns) // _VIEW_RETURNS]
            self._views.append(_View(some, len(self.submaps) - 1, self._T_submap_odom()))

    def _keep(self, is_beginning: bool) -> None:
        """Keep a moment of the drive, with its returns, where it is due."""
        is_recorded = self._is_recording and (
            is_beginning or self.distance - self._kept >= _KEYFRAME_DISTANCE
        )
        is_refined = is_beginning or self._refinement.is_due(self.distance)
        if not is_recorded and not is_refined:
            return
        keyframe = self._keyframe()
        if is_recorded:
            self._kept = self.distance
            self.keyframes.append(keyframe)
        if is_refined:
            self._refinement.keep(keyframe, self.distance)

    def _keyframe(self) -> Keyframe:
        assert self._T_odom_base is not None
        returns, origins = (
            np.concatenate([of(w.beams)[w.beams.is_hit & ~w.beams.is_lone] for w in self._waiting])
            for of in (attrgetter("ends"), attrgetter("origins"))
        )
        edges = np.concatenate([edges_of(waiting.beams) for waiting in self._waiting])
        some = np.s_[:: 1 + len(returns) // _KEYFRAME_RETURNS]
        return Keyframe(
            len(self.placed) + len(self._waiting) - 1, len(self.submaps) - 1,
            self._T_submap_odom(), self._T_odom_base,
            np.asarray(se3.inverse(self._moved) @ self.estimate.T_map_odom),
            returns[some].astype(np.float32), origins[some].astype(np.float32),
            edges.astype(np.float32),
        )  # fmt: skip

    def _T_submap_odom(self) -> se3.Matrix:
        T_submap_map = se3.inverse(self.submaps[-1].T_map_submap)
        return np.asarray(T_submap_map @ self.estimate.T_map_odom)

    def _insert(self) -> None:
        """Insert the scans that wait, at the pose as it is now, and with its tilt."""
        T_submap_odom = self._T_submap_odom()
        tilting = se3.tilt_about(self.T_map_base, self.estimate.tilt)
        T_submap_map = se3.inverse(self.submaps[-1].T_map_submap)
        tilted = T_submap_map @ tilting @ self.estimate.T_map_odom
        covariance = self._drift.covariance[:3, :3]
        is_sure = not self._is_contradicted or self.distance - self._agreed > _IN_DOUBT
        for waiting in self._waiting:
            if is_sure:
                self.submaps[-1].integrate(waiting.beams.moved(tilted), self.distance)
            if self._is_recording:
                self.placed.append(Placed(
                    waiting.stamp_ns, waiting.T_odom_base, waiting.T_odom_wheels,
                    len(self.submaps) - 1, T_submap_odom, covariance, is_sure,
                ))  # fmt: skip
        stamp_ns = self._inserted_ns = self._waiting[-1].stamp_ns
        self._waiting.clear()
        slam = self._params.slam
        length = self.distance - self._submap_begun
        if length >= slam.submap_length or (length >= _LEAST_SUBMAP and self._is_loose()):
            self._next_submap(stamp_ns)
        if self._is_new_around or self.distance - self._refreshed >= slam.refresh_distance:
            self._refresh()

    def _refresh(self) -> None:
        """Use what has been mapped since; on a saved map it alone, as long as scans agree with it.

        What was mapped since errs as the pose does, and would confirm its errors.
        """
        slam = self._params.slam
        is_contradicted = self.last is not None and self.last.reason in CONTRADICTIONS
        saved = self._map.saved_landmarks(self.T_map_base)
        self._is_on_saved = not (saved is None or is_contradicted or self._is_new_around)
        self._refreshed, self._is_new_around = self.distance, False
        if self._is_on_saved:
            self._landmarks = saved
            return
        self._landmarks = landmarks_around(
            self._map.active(self.T_map_base),
            self.T_map_base[:3, 3],
            slam.reach,
            self._params.grid.resolution,
        )

    def _next_submap(self, stamp_ns: int) -> None:
        """Begin the next submap, and look whether the robot has been there before."""
        travelled = self.distance - self._submap_begun
        is_refined = self._is_loose()
        self._map.follow(self.T_map_base, self._drift.covariance, travelled)
        self._begun()
        if self.last is not None and self.last.is_accepted:
            self._map.anchor(self.estimate.covariance)
        if is_refined:
            self._refinement.begin(self.submaps)
            self._refine_for_a_while()
        slam = self._params.slam
        if slam.close_loops and self.distance - self._looked >= slam.submap_length:
            self._looked = self.distance
            self._look_back(stamp_ns)

    def _is_loose(self) -> bool:
        """Whether scans alone have left open what the newest submap is like.

        Level lasers are held against the last metres as a whole already, and scans on a saved map
        against what does not err with them.
        """
        if self._laser.is_level or self._is_on_saved:
            return False
        position, yaw = self._drift.deviation
        return position > _LOOSE or yaw > _LOOSE_YAW

    def _refine_for_a_while(self) -> None:
        """Refine the last metres together; what was made there moves."""
        moves = self._refinement.step(self._search_slice)
        if moves is None:
            return
        moved = self._map.move(moves.motions, moves.newest)
        self.refined += 1
        self._move_with_map(moved)
        self.estimate.learn_heading_bias(moves.heading_bias)
        if self._searching is not None:
            self._searching = self._searching.seen_from(moved)
        if self._next is not None:
            self._next = self._next.seen_from(moved)
        if self._pending is not None:
            edge, found = self._pending
            self._pending = edge, found.seen_from(moved)
        self._refresh()

    def _begun(self) -> None:
        """A submap was begun at the robot."""
        self._submap_begun = self.distance
        self._drift = Drift(self._params, self.estimate)

    def _look_back(self, stamp_ns: int) -> None:
        """Search older submaps for the robot."""
        T_map_base = self.T_map_base
        candidate = self._map.candidate(T_map_base)
        if candidate is None:
            return
        returns = [
            se3.transform_points(self.submaps[v.submap].T_map_submap @ v.T_submap_odom, v.returns)
            for v in self._views
        ]
        recent = self._map.recent(_QUERY_DISTANCE)
        query = query_of(recent, T_map_base, returns, self._params)
        waiting = None if self._pending is None else self._pending[1].drift
        search = LoopSearch(
            query, candidate.cells, candidate.radius, candidate.turn, self._params, waiting
        )
        second = len(self.submaps) - 1
        self._next = _Searching(search, candidate, second, T_map_base, stamp_ns, np.eye(4))
        if self._searching is None:
            self._searching, self._next = self._next, None

    def _search_for_a_while(self, under_way: _Searching) -> None:
        """Join submaps where the search before agrees."""
        if not under_way.search.step(self._search_slice):
            return
        self._searching, self._next = self._next, None
        _, candidate, second, begun, stamp_ns, moved = under_way
        found, T_map_base = under_way.search.result.seen_from(moved), moved @ begun
        edge = self._map.loop(candidate.number, second, T_map_base, found)
        outcome = found.reason.value
        pending = self._pending
        if pending is not None and not any(
            same_drift(pending[1].drift, drift, T_map_base) for drift in found.possible
        ):
            pending = self._pending = None
        if found.reason is Reason.ACCEPTED:
            outcome = "waits for another one" if pending is None else "closed"
            self._pending = (edge, found) if pending is None else None
        away = float(np.linalg.norm(((found.drift - np.eye(4)) @ T_map_base)[:2, 3]))
        self.attempts.append(LoopAttempt(
            stamp_ns=stamp_ns, first=candidate.number, second=second, outcome=outcome, drift=away,
            radius=candidate.radius,
        ))  # fmt: skip
        if outcome == "closed" and pending is not None:
            moved = self._map.close([pending[0], edge])
            self.loops_closed += 1
            self._searching = None  # it is of the map as it was
            self._refinement.cancel()
            self._move_with_map(moved)
            self._refresh()

    def _move_with_map(self, moved: se3.Matrix) -> None:
        """The robot goes with what has been mapped, and did not drive."""
        self.estimate.T_map_odom = moved @ self.estimate.T_map_odom
        self._moved = np.asarray(moved @ self._moved)
