# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Beams of a scan in the map, from its ranges, the mount of the laser and the poses of the robot.

`beams` decides which ranges are used, and whether a beam hits or only clears; `lone_returns` finds
outliers among the returns, and `voids` beams of which none near by met the ground.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.kernels import inlined_kernel, kernel
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.params.sections import SensorParams

_VOID = 5  # neighbouring beams without return: fewer are dropouts of the laser


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

    def moved(self, T: se3.Matrix) -> Beams:
        """The same, transformed by a pose (4, 4)."""
        origins, ends = (
            np.ascontiguousarray(se3.transform_points(T, points))
            for points in (self.origins, self.ends)
        )
        return replace(self, origins=origins, ends=ends)


_CONVENTIONS = ("rep117", "zero", "range_max", "out_of_range")  # as numbers, for kernels
_ZERO, _RANGE_MAX, _OUT_OF_RANGE = 1, 2, 3


def no_returns(scan: Scan, convention: str) -> NDArray[np.bool_]:
    """(N,) bool: the beams that met nothing within the reach of the laser.

    Parameters
    ----------
    scan : Scan
    convention : str
        Which ranges mean that, besides +inf (REP-117): those of parameter ``sensor.no_return``.
    """
    is_miss = np.empty(len(scan.ranges), bool)
    _find_misses(scan.ranges, _misses_of(scan, convention), is_miss)
    return is_miss


def _misses_of(scan: Scan, convention: str) -> tuple[int, float, float]:
    """Convention, range_min and range_max, as `_is_miss` takes them."""
    return _CONVENTIONS.index(convention), scan.range_min, scan.range_max


def count_returns(scan: Scan, convention: str) -> tuple[int, int, int, int]:
    """How many ranges are returns; of these: beyond range_max, below range_min, at range_max.

    Parameters
    ----------
    scan : Scan
    convention : str
        As of `no_returns`: what is no return is not counted, wherever it lies.
    """
    counted: tuple[int, int, int, int] = _count_returns(scan.ranges, _misses_of(scan, convention))
    return counted


@kernel
def _count_returns(ranges, misses):
    returns = beyond = below = at_max = 0
    range_min, range_max = np.float32(misses[1]), np.float32(misses[2])
    for i in range(len(ranges)):
        if np.isfinite(ranges[i]) and not _is_miss(ranges[i], misses):
            returns += 1
            beyond += ranges[i] > range_max
            below += ranges[i] < range_min
            at_max += ranges[i] == range_max
    return returns, beyond, below, at_max


@kernel
def _find_misses(ranges, misses, is_miss):
    for i in range(len(ranges)):
        is_miss[i] = _is_miss(ranges[i], misses)


@inlined_kernel
def _is_miss(distance, misses):
    # The limits in the precision of the ranges: 4.1 is a little more as float32.
    convention, range_min, range_max = misses[0], np.float32(misses[1]), np.float32(misses[2])
    if distance == np.inf:
        return True
    if convention == _ZERO:
        return distance == 0.0
    is_far = convention >= _RANGE_MAX and distance >= range_max
    is_near = convention == _OUT_OF_RANGE and -np.inf < distance <= range_min
    return is_far or is_near


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
    is_lone = np.zeros(len(ranges), bool)
    _find_lone(ranges, is_return, distance, is_lone)
    return is_lone


@kernel
def _find_lone(ranges, is_return, distance, is_lone):
    count = len(ranges)
    for i in range(count):
        is_supported, is_informative = distance == 0.0 or not is_return[i], False
        for side in (-1, 1):
            one, two = i + side, i + 2 * side
            if is_supported or one < 0 or one >= count:
                continue
            is_informative |= is_return[one] or ranges[one] == np.inf
            if not is_return[one]:
                continue
            is_supported = abs(ranges[one] - ranges[i]) <= distance
            if not is_supported and 0 <= two < count and is_return[two]:
                expected = 1.0 / (2.0 / ranges[one] - 1.0 / ranges[two])
                is_supported = abs(expected - ranges[i]) <= distance
        is_lone[i] = is_informative and not is_supported


def voids(is_ground_missed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The beams in the middle of `_VOID` neighbours, none of which met the ground.

    The ground is missing there, or swallows light, as water and black surfaces do.

    Parameters
    ----------
    is_ground_missed : (N,) bool
        Whether a beam returned nothing, though the ground that the robot stands on is within
        reach.
    """
    is_void = np.zeros(len(is_ground_missed), bool)
    _find_voids(is_ground_missed, is_void)
    return is_void


@kernel
def _find_voids(is_ground_missed, is_void):
    in_a_row = 0
    for i in range(len(is_ground_missed)):
        in_a_row = in_a_row + 1 if is_ground_missed[i] else 0
        if in_a_row >= _VOID:
            is_void[i - _VOID // 2] = True


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
    return np.ascontiguousarray(stack)


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
    count = len(scan.ranges)
    body = _NO_BODY
    if params.body_box:
        body = np.sort(np.reshape(params.body_box, (2, 3)), axis=0)
    origins, ends, is_hit, is_lone, is_void = _beams(
        scan.ranges, (scan.angle_min, scan.angle_increment),
        (max(scan.range_min, params.min_range), scan.range_max),
        _misses_of(scan, params.no_return),
        stacked_poses("T_map_base", T_map_base, count),
        stacked_poses("T_base_sensor", T_base_sensor, count), body,
        (params.max_range, params.clearing_range, params.min_height, params.max_height),
        lone_return,
    )  # fmt: skip
    return Beams(
        origins=origins, ends=ends, is_hit=is_hit, is_lone=is_lone, is_void=is_void, sensor=sensor
    )


_NO_BODY = np.full((2, 3), np.inf)


@kernel
def _beams(  # noqa: PLR0913
    stored, angles, valid, misses, T_map_base, T_base_sensor, body, limits, lone_return
):
    """The arrays of `Beams`, of ranges (N,) float32 that are valid between two limits [m]."""
    count = len(stored)
    base_step, mount_step = min(len(T_map_base) - 1, 1), min(len(T_base_sensor) - 1, 1)
    max_range, clearing_range, min_height, max_height = limits
    farthest = min(clearing_range, valid[1])
    ranges, in_plane, to_ground = np.empty(count), np.empty((count, 2)), np.empty(count)
    is_return, is_ground_missed = np.empty(count, np.bool_), np.empty(count, np.bool_)
    is_lone, is_void = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    has_body = body[0, 0] < np.inf
    for i in range(count):
        is_miss = _is_miss(stored[i], misses)
        distance = np.inf if is_miss else np.float64(stored[i])
        angle = angles[0] + angles[1] * i
        in_plane[i, 0], in_plane[i, 1] = np.cos(angle), np.sin(angle)
        mount = T_base_sensor[i * mount_step]
        is_valid = valid[0] <= distance <= valid[1] and distance > 0.0 and not is_miss
        if is_valid and has_body:
            is_valid = not _is_in(body, mount, distance * in_plane[i, 0], distance * in_plane[i, 1])
        ranges[i], is_return[i] = distance, is_valid
        to_ground[i] = _range_to_ground(mount, in_plane[i, 0], in_plane[i, 1])
        is_ground_missed[i] = is_miss and to_ground[i] < farthest
    _find_lone(ranges, is_return, lone_return, is_lone)
    _find_voids(is_ground_missed, is_void)

    origins, ends, is_hit = np.empty((count, 3)), np.empty((count, 3)), np.empty(count, np.bool_)
    used = 0
    for i in range(count):
        if not is_return[i] and ranges[i] != np.inf:
            continue
        mount, base = T_base_sensor[i * mount_step], T_map_base[i * base_step]
        x, y = in_plane[i]
        reach = min(ranges[i], max_range) if is_return[i] else min(farthest, to_ground[i])
        if not reach > 0.0:
            continue
        for axis in range(3):
            ahead, origin = 0.0, base[axis, 3]
            for k in range(3):
                ahead += base[axis, k] * (mount[k, 0] * x + mount[k, 1] * y)
                origin += base[axis, k] * mount[k, 3]
            origins[used, axis], ends[used, axis] = origin, origin + reach * ahead
        above_base = ends[used, 2] - base[2, 3]
        is_in_window = min_height <= above_base <= max_height
        is_hit[used] = is_return[i] and ranges[i] <= max_range and is_in_window
        is_lone[used], is_void[used] = is_lone[i], is_void[i]
        used += 1
    return origins[:used], ends[:used], is_hit[:used], is_lone[:used], is_void[:used]


@inlined_kernel
def _range_to_ground(mount, x, y):
    """Range [m] to the plane of base_link along a beam in the plane of the scan; inf: none."""
    fall = -(mount[2, 0] * x + mount[2, 1] * y)
    return max(mount[2, 3], 0.0) / fall if fall > 0.0 else np.inf


@inlined_kernel
def _is_in(body, mount, x, y):
    """Whether a point [m] of the plane of the scan is between two corners (2, 3) in base_link."""
    is_in = True
    for axis in range(3):
        place = mount[axis, 0] * x + mount[axis, 1] * y + mount[axis, 3]
        is_in &= body[0, axis] <= place <= body[1, axis]
    return is_in
