# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Beams of a scan in the map, from its ranges, the mount of the laser and the poses of the robot.

`beams` decides which ranges are used, and whether a beam hits or only clears; `lone_returns` finds
outliers among the returns, and `voids` beams of which none near by met the ground.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import minimum_filter1d

from heightmap25d_ros import se3
from heightmap25d_ros.params.sections import SensorParams

_VOID = 5  # neighbouring beams without return: fewer are dropouts of the laser


@dataclass(frozen=True, slots=True, kw_only=True)
class Scan:
    """One planar scan, as sensor_msgs/LaserScan.

    Attributes
    ----------
    stamp_ns : int [ns]
        Of the first beam.
    frame_id : str
    angle_min, angle_increment : float [rad]
    time_increment : float [s]
        Between beams; negative where the laser scans against the order of the angles.
    range_min, range_max : float [m]
    ranges : (N,) float32 [m]
        A list is taken as well.

    Examples
    --------
    >>> Scan(angle_min=0.0, angle_increment=0.01, ranges=[2.0, 2.1]).ranges
    array([2. , 2.1], dtype=float32)
    """

    KIND: ClassVar[str] = "scan"

    stamp_ns: int = 0
    frame_id: str = ""
    angle_min: float
    angle_increment: float
    time_increment: float = 0.0
    range_min: float = 0.0
    range_max: float = np.inf
    ranges: NDArray[np.float32]

    def __post_init__(self) -> None:
        if not isinstance(self.ranges, np.ndarray):
            object.__setattr__(self, "ranges", np.asarray(self.ranges, np.float32))
        if self.ranges.ndim != 1:
            raise ValueError(f"ranges: shape {self.ranges.shape}, not (N,)")

    def beam_stamps_ns(self) -> NDArray[np.int64]:
        """(N,) int64 [ns]: stamp of each beam; (1,) where all beams have the same one."""
        count = len(self.ranges) if self.time_increment else 1
        offsets = np.arange(count) * (self.time_increment * 1e9)
        stamps: NDArray[np.int64] = self.stamp_ns + np.rint(offsets).astype(np.int64)
        return stamps


@dataclass(frozen=True, slots=True, kw_only=True)
class Beams:
    """Straight lines through free space; those that hit end on an object.

    Attributes
    ----------
    origins : (N, 3) float64 [m], map
        The laser at each beam's own time.
    ends : (N, 3) float64 [m], map
    is_hit : (N,) bool
        Whether the end is on an object, at the least height of its top; otherwise the beam
        only clears.
    is_lone : (N,) bool
        Whether no neighbouring beam supports the return: a mixed pixel, a phantom.
    is_void : (N,) bool, optional
        Whether the beam ends on the plane of base_link, where neither it nor its neighbours
        returned anything, see `voids`; None: no such beam.
    sensor : SensorParams, optional
        The sensor that they are from; None: that of the mapper.
    """

    origins: NDArray[np.float64]
    ends: NDArray[np.float64]
    is_hit: NDArray[np.bool_]
    is_lone: NDArray[np.bool_]
    is_void: NDArray[np.bool_] | None = None
    sensor: SensorParams | None = None


def no_returns(scan: Scan, convention: str) -> NDArray[np.bool_]:
    """(N,) bool: the beams that met nothing within the reach of the laser.

    Parameters
    ----------
    scan : Scan
    convention : str
        Which ranges mean that, besides +inf (REP-117): those of parameter ``sensor.no_return``.
    """
    ranges = scan.ranges
    is_miss: NDArray[np.bool_] = ranges == np.inf
    is_finite = np.isfinite(ranges)
    if convention == "zero":
        is_miss |= ranges == 0.0
    if convention in ("range_max", "out_of_range"):
        is_miss |= is_finite & (ranges >= np.float32(scan.range_max))
    if convention == "out_of_range":
        is_miss |= is_finite & (ranges <= np.float32(scan.range_min))
    return is_miss


def lone_returns(
    ranges: NDArray[np.float64], is_return: NDArray[np.bool_], distance: float
) -> NDArray[np.bool_]:
    """Returns that their neighbouring beams contradict: mixed pixels and phantoms.

    A return is supported within ``distance`` of a neighbour's, or of the range that the two
    beams next to it on one side extrapolate to: along a straight surface the inverse of the range
    is linear in small angles, however grazing the beams are. A neighbour without measurement
    (NaN) is ignored; one without return (+inf) contradicts.

    Parameters
    ----------
    ranges : (N,) float64 [m]
    is_return : (N,) bool
    distance : float [m]
        0: no outlier rejection.
    """
    if distance == 0.0:
        return np.zeros(len(ranges), bool)
    inverse = np.full(len(ranges) + 4, np.nan)
    inverse[2:-2][is_return] = 1.0 / ranges[is_return]
    before2, before, after, after2 = inverse[:-4], inverse[1:-3], inverse[3:-1], inverse[4:]
    is_supported = np.zeros(len(ranges), bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        for expected in (before, after, 2 * before - before2, 2 * after - after2):
            is_supported |= np.abs(1.0 / expected - ranges) <= distance
    is_informative = np.pad(is_return | (ranges == np.inf), 1)
    is_lone: NDArray[np.bool_] = (
        is_return & ~is_supported & (is_informative[:-2] | is_informative[2:])
    )
    return is_lone


def voids(is_ground_missed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The beams in the middle of `_VOID` neighbours, none of which met the ground.

    The ground is missing there, or swallows light, as water and black surfaces do.

    Parameters
    ----------
    is_ground_missed : (N,) bool
        Whether a beam returned nothing, though the ground that the robot stands on is within
        reach.
    """
    return np.asarray(minimum_filter1d(is_ground_missed, _VOID, mode="constant"))


def _range_to_ground(
    directions: NDArray[np.float64], T_base_sensor: se3.Matrix
) -> NDArray[np.float64]:
    """(N,) float64 [m]: range to the plane of base_link, infinite where a beam does not meet it.

    Parameters
    ----------
    directions : (N, 2) float64
        Of the beams, in the plane of the scan.
    T_base_sensor : (N, 4, 4) or (1, 4, 4) float64
    """
    height = T_base_sensor[:, 2, 3]
    fall = -(T_base_sensor[:, 2, 0] * directions[:, 0] + T_base_sensor[:, 2, 1] * directions[:, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(fall > 0.0, np.maximum(height, 0.0) / fall, np.inf)


def _in_box(
    ends: NDArray[np.float64], T_base_sensor: se3.Matrix, corners: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(N,): whether ends (N, 2) [m] in the plane of the scan lie in a box of base_link.

    Parameters
    ----------
    ends : (N, 2) float64 [m]
    T_base_sensor : (N, 4, 4) or (1, 4, 4) float64
    corners : (2, 3) float64 [m]
        Two opposite ones.
    """
    axes = T_base_sensor[:, :3, :2]
    in_base = T_base_sensor[:, :3, 3] + axes[:, :, 0] * ends[:, :1] + axes[:, :, 1] * ends[:, 1:]
    lowest, highest = corners.min(axis=0), corners.max(axis=0)
    return np.asarray(((in_base >= lowest) & (in_base <= highest)).all(axis=1))


def stacked_poses(name: str, poses: ArrayLike, count: int) -> se3.Matrix:
    """(N, 4, 4) or (1, 4, 4): poses of so many beams.

    Raises
    ------
    ValueError
        If they are of another shape; the message begins with their name.
    """
    stack = np.asarray(poses, np.float64)
    stack = stack[None] if stack.ndim == 2 else stack
    if stack.shape[1:] != (4, 4) or len(stack) not in (1, count):
        raise ValueError(f"{name}: shape {np.shape(poses)}, not (4, 4), nor ({count}, 4, 4)")
    return stack


def beams(
    scan: Scan,
    T_map_base: ArrayLike,
    T_base_sensor: ArrayLike,
    params: SensorParams | None = None,
    lone_return: float = 0.0,
) -> Beams:
    """Beams of a scan in the map frame, by REP-117 or what else ``no_return`` says.

    No return (+inf, see `no_returns`): clears to ``clearing_range``, ``range_max`` or the plane of
    base_link, the nearest one: below the ground on which the robot stands there is no free space,
    so that such a beam was absorbed or deflected. NaN, -inf, 0, values outside of ``range_min ..
    range_max`` or below ``min_range``, and returns from the robot's ``body_box``: no beam. Returns
    beyond ``max_range`` clear up to there, and returns outside of the window ``min_height ..
    max_height`` above base_link clear up to the return; neither hits.

    Parameters
    ----------
    scan : Scan
    T_map_base, T_base_sensor : (N, 4, 4), (1, 4, 4) or (4, 4) float64
        At each beam's own time, or once for all beams.
    params : SensorParams, optional
    lone_return : float [m]
        Distance from its neighbours at which a return is an outlier, see `lone_returns`.

    Raises
    ------
    ValueError
        If the poses do not go with the number of beams.

    Examples
    --------
    A return 2 m ahead of a laser 0.4 m above the ground:

    >>> scan = Scan(angle_min=0.0, angle_increment=0.01, ranges=[2.0])
    >>> beams(scan, np.eye(4), se3.from_xyz_rpy([0.0, 0.0, 0.4, 0.0, 0.0, 0.0])).ends
    array([[2. , 0. , 0.4]])
    """
    sensor, params = params, params or SensorParams()
    T_map_base = stacked_poses("T_map_base", T_map_base, len(scan.ranges))
    T_base_sensor = stacked_poses("T_base_sensor", T_base_sensor, len(scan.ranges))
    with np.errstate(invalid="ignore"):  # there are NaNs that signal when they are converted
        ranges = scan.ranges.astype(np.float64)
    is_miss = no_returns(scan, params.no_return)
    ranges[is_miss] = np.inf
    nearest = max(scan.range_min, params.min_range)
    is_return = (ranges >= nearest) & (ranges <= scan.range_max) & (ranges > 0.0) & ~is_miss
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    in_plane = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if params.body_box:
        ends = np.where(is_return, ranges, 0.0)[:, None] * in_plane
        is_return &= ~_in_box(ends, T_base_sensor, np.reshape(params.body_box, (2, 3)))
    to_ground = _range_to_ground(in_plane, T_base_sensor)
    farthest = min(params.clearing_range, scan.range_max)
    cleared = np.minimum(farthest, to_ground)
    reach = np.where(is_miss, cleared, np.minimum(ranges, params.max_range))
    used = (is_return | is_miss) & (reach > 0.0)

    T_map_sensor = T_map_base @ T_base_sensor
    origins = np.broadcast_to(T_map_sensor[:, :3, 3], (len(ranges), 3))[used]
    base_z = np.broadcast_to(T_map_base[:, 2, 3], len(ranges))[used]
    axes = np.broadcast_to(T_map_sensor[:, :3, :2], (len(ranges), 3, 2))[used]
    along = in_plane[used]
    direction = axes[:, :, 0] * along[:, :1] + axes[:, :, 1] * along[:, 1:]
    ends = origins + reach[used, None] * direction

    above_base = ends[:, 2] - base_z
    in_window = (above_base >= params.min_height) & (above_base <= params.max_height)
    is_hit = is_return[used] & (ranges[used] <= params.max_range) & in_window
    return Beams(
        origins=np.ascontiguousarray(origins),
        ends=ends,
        is_hit=is_hit,
        is_lone=lone_returns(ranges, is_return, lone_return)[used],
        is_void=voids(is_miss & (to_ground < farthest))[used],
        sensor=sensor,
    )
