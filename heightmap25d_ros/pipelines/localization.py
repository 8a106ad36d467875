# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, the pose of odom in the map out: what the node and ``localize`` both drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.decode import Odometry
from heightmap25d_ros.localization import (
    global_search,
    matching,
    registration,
    scan_search,
    scan_update,
)
from heightmap25d_ros.localization.layers import LayerMap
from heightmap25d_ros.localization.long_term_map import LongTermMap
from heightmap25d_ros.localization.pose_filter import SmoothCorrection
from heightmap25d_ros.localization.short_term import ShortTermMaps
from heightmap25d_ros.localization.surface import Surface
from heightmap25d_ros.localization.tracker import Attempt, Tracker
from heightmap25d_ros.localization.tracking_state import State
from heightmap25d_ros.mapping import cloud, sensor_model
from heightmap25d_ros.params import sources
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines import scan_queue
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.input_watch import InputWatch
from heightmap25d_ros.pipelines.odometry_gate import Jump
from heightmap25d_ros.pipelines.scan_queue import Reading
from heightmap25d_ros.pipelines.sensor_intake import SensorIntake
from heightmap25d_ros.pipelines.transform_buffer import JUMP_BACK_NS
from heightmap25d_ros.slam import bundle
from heightmap25d_ros.slam.own_map_localization import OwnMapLocalization
from heightmap25d_ros.slam.own_map_tracker import OwnMapTracker
from heightmap25d_ros.slam.saved_map import SavedMap
from heightmap25d_ros.terrain import slices

_LEAST_COVARIANCE = np.diag(np.square([0.01, 0.01, 0.001]))  # nobody is surer of a pose


def compile_kernels(params: Params) -> None:
    """Compile, or load from numba's cache, all that the first registration or search needs."""
    reading = scan_queue.sample_reading()
    reading.beams(params)
    InputWatch().observe_ranges(reading.scan, params.sensor.no_return, Drops())
    if params.intake.cloud_topics:
        cloud.compile_kernels()
    surface = Surface(np.zeros((4, 4), np.float32), np.zeros((4, 4), bool), (0.0, 0.0), 1.0)
    count = registration.MIN_POINTS
    points = matching.RegistrationPoints(
        np.zeros((count, 3)), np.zeros(count, bool), np.ones(count), pivot=(2.0, 2.0)
    )
    registration.register(points, surface, 1e-4 * np.eye(3), params.registration)
    global_search.compile_kernels(params.registration)
    scan_update.compile_kernels(params.scan_filter)
    scan_search.compile_kernels()
    slices.compile_kernels()
    se3.from_xyz_rpy(se3.to_xyz_rpy(se3.inverse(np.eye(4))))  # for a pose that is given
    se3.to_quaternion(np.eye(4))  # of transforms that are published
    if params.localization.own_map:
        _compile_own_map(params)
    scratch = ShortTermMaps(params)
    beam = np.array([[0.0, 0.0, 1.0]])
    is_hit, is_lone = np.ones(1, bool), np.zeros(1, bool)
    beams = sensor_model.Beams(origins=beam, ends=beam + 1.0, is_hit=is_hit, is_lone=is_lone)
    for seconds in (0.0, params.short_term.mature_time):  # with a motion between them
        scratch.integrate(beams, np.eye(4), round(1e9 * seconds))
    scratch.mature()


def _compile_own_map(params: Params) -> None:
    """A metre of a drive towards a wall, at first with a level laser alone."""
    own = OwnMapTracker(params, is_recording=False)
    y = np.linspace(-2.0, 2.0, 400)
    wall = np.column_stack([np.full(400, 4.0), y, np.full(400, 0.4)])
    ground = np.column_stack([np.tile([1.5, 2.0], 200), y, np.zeros(400)])
    for step in range(11):
        T = se3.from_xyz_rpy([0.1 * step, 0.0, 0.0, 0.0, 0.0, 0.0])
        ends = wall if step < 3 else np.concatenate([wall, ground])
        origins = np.repeat(T[None, :3, 3] + (0.0, 0.0, 0.4), len(ends), axis=0)
        is_lone = np.zeros(len(ends), bool)
        beams = sensor_model.Beams(origins=origins, ends=ends, is_hit=~is_lone, is_lone=is_lone)
        own.integrate(beams, T, step * 10**8)
    bundle.compile_kernels(params.scan_filter)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Where the robot is, as told to others.

    Attributes
    ----------
    stamp_ns : int [ns]
    odom_frame : str
    T_map_odom, T_map_base : (4, 4) float64
    covariance : (3, 3) float64
        Of x, y [m] and yaw [rad] of the robot.
    vertical : (3,) float64
        Variances of z [m^2], roll and pitch [rad^2].
    """

    stamp_ns: int
    odom_frame: str
    T_map_odom: se3.Matrix
    T_map_base: se3.Matrix
    covariance: Array
    vertical: Array


class Localizer(SensorIntake[Attempt]):
    """Holds the pose of the robot to a long-term map, or to the map that it makes.

    Each ``take_...`` takes a message in, by duck type, and returns the attempts to register that
    it led to. A bad message is counted and changes nothing.

    Parameters
    ----------
    params : Params, optional
    search_slice : float, optional [s]
        Time that a search of the whole map may take between two scans; by default all that it
        needs, so that the result does not depend on the machine.

    Attributes
    ----------
    dropped : Drops

    Examples
    --------
    >>> localizer = Localizer()
    >>> localizer.set_long_term(HeightMap.from_metres(np.zeros((32, 64))))
    >>> localizer.begin_at([1.0, 2.0, 0.0, 0.0])
    >>> localizer.pose  # before the first odometry
    >>> localizer.state
    <State.DEGRADED: 1>
    """

    def __init__(self, params: Params | None = None, search_slice: float = np.inf) -> None:
        super().__init__(params or Params(), is_bridging=False)
        self._search_slice = search_slice
        self._long_term: LongTermMap | None = None
        self._saved: SavedMap | None = None
        self._waiting_pose: tuple[Array, Array] | None = None
        self._told_pose: tuple[se3.Matrix, Array] | None = None
        self._told_map: tuple[HeightMap, int] | None = None  # and its stamp [ns]
        self._told_layers: tuple[LayerMap, int] | None = None
        self._begin()

    def _begin(self) -> None:
        """Where others have told the robot to be, or else where the odometry is the map's frame."""
        position, yaw = (
            self._params.localization.initial_position,
            self._params.localization.initial_yaw,
        )
        self._initial_covariance = np.diag(np.square([position, position, yaw]))
        T_map_odom, covariance = self._told_pose or (np.eye(4), self._initial_covariance)
        self._tracker: Tracker | OwnMapLocalization
        if self._params.localization.own_map:
            self._tracker = OwnMapLocalization(
                self._params, T_map_odom, covariance, self._search_slice
            )
            self._use_saved_map()
        else:
            self._tracker = Tracker(self._params, T_map_odom, covariance, self._search_slice)
            self._tracker.set_long_term(self._long_term)
        self._smooth = SmoothCorrection(self._params.localization, T_map_odom)
        self._jumps_seen = self._tracker.jumps
        self._odometry: Odometry | None = None
        self._mended: Jump | None = None

    def _start_over(self, before: Odometry, odometry: Odometry) -> None:
        """The clock has jumped back: of a robot that stayed, alone the clock was wrong."""
        if self._queue.gate.is_continuous(before, odometry):
            self.dropped.record("poses: clock jumped back, the robot stayed")
            self._tracker.forget()
        else:
            self.dropped.record("poses: clock jumped back, localization starts over")
            self._begin()

    def set_params(self, params: Params) -> None:
        """Go on with other parameters; the pose stays, and so does what was seen."""
        self._params = params
        self._tracker.set_params(params)

    @property
    def state(self) -> State:
        """How sure the pose is; without one of its sources not more than DEGRADED."""
        state = self._tracker.state
        is_blind = state is State.TRACKING and bool(self._queue.silence.silent)
        return State.DEGRADED if is_blind else state

    @property
    def lapse(self) -> str:
        """Why the pose is less sure than the last registration left it; empty where it is not."""
        deviation, limit = self.deviation[0], self._params.localization.degraded_deviation
        grown = f"the deviation has grown to {deviation:.2f} m" if deviation > limit else ""
        return "; ".join(filter(None, [self._queue.silence.told, grown]))

    @property
    def deviation(self) -> tuple[float, float]:
        """Standard deviations of position [m] and yaw [rad] now."""
        return self._tracker.estimate.deviation

    def pass_time(self, now_ns: int) -> None:
        """Let the time [ns] pass in which sources can fall silent, see `Silence`."""
        self._queue.silence.pass_time(now_ns)

    @property
    def stamp_ns(self) -> int:
        """Of the newest odometry [ns]; 0 before the first."""
        return 0 if self._odometry is None else self._odometry.stamp_ns

    @property
    def pose(self) -> Pose | None:
        """Where the robot is; None before the first odometry.

        On its own map with roll and pitch as the map tells them, so that what is mapped at this
        pose is as level as the map.
        """
        if self._odometry is None:
            return None
        T_map_odom, own = self._smooth.T_map_odom, self._tracker
        if isinstance(own, OwnMapLocalization):
            T_map_odom = se3.tilt_about(T_map_odom @ self._odometry.T, own.tilt) @ T_map_odom
        return Pose(
            stamp_ns=self._odometry.stamp_ns,
            odom_frame=self._odometry.frame_id,
            T_map_odom=T_map_odom,
            T_map_base=T_map_odom @ self._odometry.T,
            covariance=self._told_covariance(),
            vertical=self._told_vertical(),
        )

    def _told_covariance(self) -> Array:
        """Of the published pose: of the estimate, and how far the pose lags behind it."""
        assert self._odometry is not None
        T_odom_base, T_map_odom = self._odometry.T, self._tracker.estimate.T_map_odom
        shift = ((T_map_odom - self._smooth.T_map_odom) @ T_odom_base)[:2, 3]
        between = T_map_odom @ se3.inverse(self._smooth.T_map_odom)
        lag = np.array([*shift, se3.yaw(between)])
        return self._tracker.estimate.covariance + np.outer(lag, lag)

    def _told_vertical(self) -> Array:
        """Of the published pose: z with its lag; roll and pitch are the inclinometer's."""
        assert self._odometry is not None
        correction = self._tracker.estimate.T_map_odom - self._smooth.T_map_odom
        lag = (correction @ self._odometry.T)[2, 3]
        tilt = self._params.scan_filter.tilt_noise**2
        return np.array([self._tracker.estimate.z_variance + lag**2, tilt, tilt])

    @property
    def map_version(self) -> tuple[int, int, int]:
        """Which map the robot makes [ns], of how many submaps, and how often they were moved.

        Without any submaps the robot makes no map, or has not begun it.
        """
        own = self._tracker
        return own.map_version if isinstance(own, OwnMapLocalization) else (0, 0, 0)

    def submap_poses(self) -> Array:
        """(K, 4, 4): the robot at the beginning of each submap of the map that it makes."""
        own = self._tracker
        return own.submap_poses() if isinstance(own, OwnMapLocalization) else np.empty((0, 4, 4))

    def short_term_map(self) -> HeightMap | None:
        """The short-term map that is registered next, in cells of its own in odom."""
        if isinstance(self._tracker, OwnMapLocalization):
            return None
        short_term_map = self._tracker.short_term_map()
        return None if short_term_map is None else short_term_map.height_map()

    def set_long_term(self, height_map: HeightMap, layers: LayerMap | None = None) -> None:
        """Take the long-term map in; it may come, and be replaced, at any time.

        With its localization layers single scans are tracked, without them short-term maps. With
        ``localization.own_map`` the robot is searched in it, and goes on from it.

        Raises
        ------
        InputError
            If the memory for it is not available; the map before stays.
        """
        if isinstance(self._tracker, OwnMapLocalization):
            self._saved = SavedMap(height_map, layers, self._params)
            self._long_term = self._saved.long_term
            self._use_saved_map()
        else:
            self._long_term = LongTermMap.of(height_map, layers, self._params)
            self._tracker.set_long_term(self._long_term)

    def _use_saved_map(self) -> None:
        """Go on from the saved map: where others have told the robot to be, or wherever it is."""
        if self._saved is not None and isinstance(self._tracker, OwnMapLocalization):
            self._tracker.set_saved_map(self._saved)
            if self._told_pose is None and self._waiting_pose is None:
                self._tracker.request_search()

    def begin_at(self, xyz_yaw: ArrayLike) -> None:
        """Where the robot is at the first odometry: x, y, z [m], yaw [rad] in the map.

        Raises
        ------
        ValueError
            If these are not four finite numbers.
        """
        pose = np.asarray(xyz_yaw, np.float64)
        if pose.shape != (4,) or not np.isfinite(pose).all():
            raise ValueError(f"xyz_yaw: {pose} is not x, y, z, yaw")
        self._waiting_pose = pose, self._initial_covariance

    def request_search(self) -> bool:
        """Search the whole map for the robot; whether there is one."""
        return self._tracker.request_search()

    def take_odometry(self, message: Any) -> list[Attempt]:
        """Take a nav_msgs/Odometry in; the pose is of its time afterwards."""
        before = self._odometry
        readings = self._queue.take_odometry(message)
        odometry = self._queue.odometry
        if odometry is None or odometry is before:
            return self._use(readings)
        if before is not None and odometry.stamp_ns < before.stamp_ns - JUMP_BACK_NS:
            self._start_over(before, odometry)
            before = None
        elif self._queue.gate.jump not in (None, self._mended):
            self._mended = self._queue.gate.jump
            self._mend_jump(self._mended)
        self._odometry = odometry
        self._tracker.move(odometry.T)
        if self._waiting_pose is not None:
            self._set_pose(*self._waiting_pose)
        attempts = self._use(readings)
        self._follow(before or odometry, odometry)
        return attempts

    def take_initial_pose(self, message: Any) -> None:
        """Take a geometry_msgs/PoseWithCovarianceStamped in: where the robot is now.

        It holds until the next one, also where the clock jumps back and localization starts over.

        z is taken from the long-term map where it is known there, since RViz gives none. The
        covariance says how far around it is searched, at most ``registration.window_distance`` and
        ``window_angle``; zeros: as at the start.
        """
        frame = self._params.mapping.map_frame
        search = self._params.registration
        limits = search.window_distance, search.window_distance, search.window_angle
        pose = self.dropped.decoded("initialpose", lambda m: decode.pose_in(m, frame), message)
        covariance = self.dropped.decoded(
            "initialpose", lambda m: decode.planar_covariance(m, limits), message
        )
        if pose is None or covariance is None:
            return
        x, y, z, _, _, yaw = se3.to_xyz_rpy(pose)
        covariance = (
            covariance + _LEAST_COVARIANCE if covariance.any() else self._initial_covariance
        )
        ground = z if self._long_term is None else self._long_term.ground_z(x, y, z)
        self._waiting_pose = np.array([x, y, ground, yaw]), covariance
        if self._odometry is not None:
            self._set_pose(*self._waiting_pose)

    def take_long_term(self, message: Any) -> None:
        """Take a heightmap25d_msgs/HeightGrid in: the long-term map."""
        frame = self._params.mapping.map_frame
        found = self.dropped.decoded(
            "long_term_grid",
            lambda m: (decode.height_map(m, frame), decode.stamp_ns(m.header)), message,
        )  # fmt: skip
        if found is not None:
            self._take_map(*found)

    def take_long_term_layers(self, message: Any) -> None:
        """Take a heightmap25d_msgs/LocalizationLayers in, of the long-term map of its stamp."""
        frame = self._params.mapping.map_frame
        found = self.dropped.decoded(
            "long_term_layers",
            lambda m: (decode.localization_layers(m, frame), decode.stamp_ns(m.header)), message,
        )  # fmt: skip
        if found is None:
            return
        self._told_layers = found
        if self._told_map is not None and self._told_map[1] == found[1]:
            self._take_map(*self._told_map)

    def _take_map(self, height_map: HeightMap, stamp_ns: int) -> None:
        """Localize in a map from elsewhere, with its layers where they have come."""
        self._told_map = height_map, stamp_ns
        layers, stamp_of_layers = self._told_layers or (None, 0)
        if layers is not None and (
            stamp_of_layers != stamp_ns or layers.geometry.shape != height_map.geometry.shape
        ):
            layers = None
        self.dropped.decoded(
            "long_term_grid", lambda _: self.set_long_term(height_map, layers), None
        )

    def _set_pose(self, xyz_yaw: Array, covariance: Array) -> None:
        assert self._odometry is not None
        x, y, z, yaw = xyz_yaw
        T_odom_base = self._odometry.T
        heading = float(se3.to_xyz_rpy(T_odom_base)[5])
        turn = se3.from_xyz_rpy([0.0, 0.0, 0.0, 0.0, 0.0, yaw - heading])
        turn[:3, 3] = np.array([x, y, z]) - turn[:3, :3] @ T_odom_base[:3, 3]
        self._told_pose = turn, covariance
        self._tracker.set_pose(turn, covariance)
        self._waiting_pose = None

    def _mend_jump(self, jump: Jump) -> None:
        """Where odometry jumps, the robot has not: it stays where it was in the map."""
        self._odometry = jump.after
        self._tracker.mend(
            self._tracker.estimate.T_map_odom @ jump.T_before_after,
            self._tracker.estimate.covariance + self._initial_covariance,
        )
        self._waiting_pose = None

    def _use(self, readings: list[Reading]) -> list[Attempt]:
        attempts = []
        for reading in readings:
            self.watch.observe_ranges(
                reading.scan, sources.sensor_of(self._params, reading.topic).no_return, self.dropped
            )
            beams = reading.beams(self._params)
            try:
                attempt = self._tracker.integrate(
                    beams, reading.T_map_base[-1], reading.scan.stamp_ns
                )
            except InputError as error:
                self.dropped.record("scan: not enough memory to register", str(error))
                continue
            if attempt is not None:
                attempts.append(attempt)
        self._jump()
        return attempts

    def _jump(self) -> bool:
        """Where the estimate was replaced, others are told so at once; whether it was."""
        has_jumped = self._tracker.jumps != self._jumps_seen
        if has_jumped:
            self._jumps_seen = self._tracker.jumps
            self._smooth.T_map_odom = self._tracker.estimate.T_map_odom
        return has_jumped

    def _follow(self, before: Odometry, odometry: Odometry) -> None:
        """Bring what is told to others nearer to the estimate."""
        if not self._jump():
            seconds = (odometry.stamp_ns - before.stamp_ns) * 1e-9
            self._smooth.follow(self._tracker.estimate.T_map_odom, odometry.T, seconds)
