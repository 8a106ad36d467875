# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Beams of a point cloud: what `sensor_model` does for a planar scan, for 3-D lidars and cameras.

A cloud has 100,000 points and more, so one kernel makes its beams in one pass over them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heightmap25d_ros.kernels import inlined_kernel, kernel
from heightmap25d_ros.mapping.sensor_model import Beams, stacked_poses
from heightmap25d_ros.params.sections import CloudParams, SensorParams

KNOT_NS = 1_000_000
"""Poses are looked up this often [ns] during a sweep, and are linear in between.

Within a millisecond a robot that turns by 6 rad/s is off by 5e-6 rad at the most.
"""

_GAP = 2.5  # angles between neighbours of a line beyond which something was left out between them
_SAMPLE = 4096  # pairs of neighbours of which the usual angle is estimated
_HASH_X, _HASH_Y, _HASH_Z = 73856093, 19349669, 83492791  # Teschner et al., 2003


@dataclass(frozen=True, slots=True, kw_only=True)
class Cloud:
    """One point cloud, as sensor_msgs/PointCloud2.

    Attributes
    ----------
    stamp_ns : int [ns]
    frame_id : str
    points : (N, 3) float32 [m], sensor
        Not finite, or all zero: no return.
    offsets_ns : (N,) int64 [ns], optional
        Time of each point after the stamp; None: all have the stamp.
    lines : (N,) uint16, optional
        Ring, or row, of each point: the points of a line are in the order in which they lie side
        by side. None: neighbours are not known, and outliers are not found.
    has_gaps : bool
        Whether points without return are left out of the lines.
    told : str
        How the message was read, for people.

    Examples
    --------
    >>> Cloud(points=np.zeros((4, 3), np.float32)).beam_stamps_ns()
    array([0])
    """

    KIND: ClassVar[str] = "cloud"

    stamp_ns: int = 0
    frame_id: str = ""
    points: NDArray[np.float32]
    offsets_ns: NDArray[np.int64] | None = None
    lines: NDArray[np.uint16] | None = None
    has_gaps: bool = False
    told: str = ""

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 3:
            raise ValueError(f"points: shape {self.points.shape}, not (N, 3)")
        for name in ("offsets_ns", "lines"):
            array = getattr(self, name)
            if array is not None and array.shape != self.points.shape[:1]:
                raise ValueError(f"{name}: shape {array.shape} for {len(self.points)} points")

    def beam_stamps_ns(self) -> NDArray[np.int64]:
        """(M,) int64 [ns]: evenly from the first point to the last, at most `KNOT_NS` apart.

        Poses are needed at these times; (1,) where all points have the same one.
        """
        if self.offsets_ns is None:
            return np.array([self.stamp_ns], np.int64)
        first, last = int(self.offsets_ns.min()), int(self.offsets_ns.max())
        count = 1 + -(-(last - first) // KNOT_NS)
        between = np.rint(np.linspace(first, last, count)).astype(np.int64)
        return np.asarray(self.stamp_ns + between)


def compile_kernels() -> None:
    """Compile, or load from numba's cache, all that the beams of the first cloud need."""
    points = np.ones((6, 3), np.float32)
    lines, times = np.zeros(6, np.uint16), np.arange(6, dtype=np.int64)
    cloud = Cloud(points=points, lines=lines, offsets_ns=times, has_gaps=True)
    poses = np.eye(4), np.eye(4)
    cloud_beams(cloud, *poses, params=CloudParams(step=2, voxel_size=1.0), lone_return=1.0)


def cloud_beams(
    cloud: Cloud,
    T_map_base: ArrayLike,
    T_base_sensor: ArrayLike,
    sensor: SensorParams | None = None,
    params: CloudParams | None = None,
    lone_return: float = 0.0,
) -> Beams:
    """Beams of a cloud in the map frame, each from where the sensor was at its own time.

    As with scans, returns nearer than ``min_range`` or from the ``body_box`` make no beam, those
    beyond ``max_range`` clear up to there, and those outside of the window ``min_height ..
    max_height`` above base_link clear up to the return. Points without return have no direction,
    and make no beam; they contradict their neighbours, see `sensor_model.lone_returns`.

    Parameters
    ----------
    cloud : Cloud
    T_map_base, T_base_sensor : (M, 4, 4), (1, 4, 4) or (4, 4) float64
        At the times of `Cloud.beam_stamps_ns`, or once for all beams.
    sensor : SensorParams, optional
    params : CloudParams, optional
        How many of the returns are used.
    lone_return : float [m]
        Distance from its neighbours in its line at which a return is an outlier.

    Raises
    ------
    ValueError
        If the poses do not go with the times.

    Examples
    --------
    A return 2 m ahead of a lidar 0.4 m above the ground:

    >>> from heightmap25d_ros import se3
    >>> cloud = Cloud(points=np.array([[2.0, 0.0, 0.0]], np.float32))
    >>> cloud_beams(cloud, np.eye(4), se3.from_xyz_rpy([0.0, 0.0, 0.4, 0.0, 0.0, 0.0])).ends
    array([[2. , 0. , 0.4]])
    """
    given, sensor, params = sensor, sensor or SensorParams(), params or CloudParams()
    count = len(cloud.points)
    offsets = np.zeros(0, np.int64) if cloud.offsets_ns is None else cloud.offsets_ns
    knots = len(cloud.beam_stamps_ns())
    T_map_base = stacked_poses("T_map_base", T_map_base, knots)
    T_base_sensor = stacked_poses("T_base_sensor", T_base_sensor, knots)
    T_map_sensor = np.ascontiguousarray(np.broadcast_to(T_map_base @ T_base_sensor, (knots, 4, 4)))
    ranges = _ranges(cloud.points)
    is_kept = np.ones(count, bool)
    is_lone = np.zeros(count, bool)
    if cloud.lines is not None:
        # Stable: neighbours in a line keep their order.
        sequence = np.argsort(cloud.lines, kind="stable")
        if lone_return > 0.0:
            gap = _usual_angle(cloud, sequence, ranges) * _GAP if cloud.has_gaps else np.inf
            _find_lone(cloud.points, ranges, cloud.lines, sequence, lone_return, gap, is_lone)
        _thin_lines(cloud.lines, sequence, params.step, is_kept)
    else:
        is_kept[:] = np.arange(count) % params.step == 0
    if params.voxel_size > 0.0:
        _thin_voxels(cloud.points, ranges, is_lone, params.voxel_size, is_kept)
    body = np.sort(np.reshape(sensor.body_box or (np.inf,) * 6, (2, 3)), axis=0)
    origins, ends, is_hit, source = _beams(
        cloud.points, ranges, is_kept, offsets, T_map_sensor,
        np.ascontiguousarray(np.broadcast_to(T_map_base[:, 2, 3], knots)),
        np.ascontiguousarray(np.broadcast_to(T_base_sensor, (knots, 4, 4))), body,
        (sensor.min_range, sensor.max_range, sensor.min_height, sensor.max_height),
    )  # fmt: skip
    return Beams(origins=origins, ends=ends, is_hit=is_hit, is_lone=is_lone[source], sensor=given)


def _usual_angle(cloud: Cloud, sequence: NDArray[np.int64], ranges: NDArray[np.float64]) -> float:
    """Angle [rad] between neighbours in a line, the median of some; infinite where there are none.

    Where nothing is left out in between, which holds for more than half of them.
    """
    assert cloud.lines is not None
    pairs = np.stack([sequence[:-1], sequence[1:]])
    pairs = pairs[:, :: 1 + pairs.shape[1] // _SAMPLE]
    one, other = pairs[:, (ranges[pairs] > 0.0).all(axis=0)]
    is_same = cloud.lines[one] == cloud.lines[other]
    one, other = one[is_same], other[is_same]
    if not len(one):
        return np.inf
    points = cloud.points.astype(np.float64)  # holds the products of any of them
    across = np.linalg.norm(np.cross(points[one], points[other]), axis=1)
    return float(np.median(across / (ranges[one] * ranges[other])))


@kernel
def _ranges(points):
    """(N,) float64 [m]: distances of points; 0 where there is no return."""
    result = np.zeros(len(points))
    for i in range(len(points)):
        x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        distance = np.sqrt(x * x + y * y + z * z)
        if distance < np.inf:
            result[i] = distance
    return result


@kernel
def _find_lone(points, ranges, lines, sequence, distance, gap, is_lone):
    """`sensor_model.lone_returns` along lines; points are in their order of ``sequence``.

    A gap, an angle [rad] between neighbours, is where a beam without return was left out.
    """
    for at in range(len(sequence)):
        point = sequence[at]
        here = ranges[point]
        if here == 0.0:
            continue
        is_supported, is_informative = False, False
        for side in (-1, 1):
            one = _neighbour(at, side, lines, sequence)
            if one < 0:
                continue
            is_informative = True
            near = ranges[one]
            if near == 0.0 or _is_apart(points, ranges, point, one, gap):
                continue
            if abs(near - here) <= distance:
                is_supported = True
                continue
            two = _neighbour(at + side, side, lines, sequence)
            if two < 0 or ranges[two] == 0.0 or _is_apart(points, ranges, one, two, gap):
                continue
            expected = 1.0 / (2.0 / near - 1.0 / ranges[two])
            is_supported |= abs(expected - here) <= distance
        is_lone[point] = is_informative and not is_supported


@inlined_kernel
def _neighbour(at, side, lines, sequence):
    """The next point of a line on one side; -1: the line ends here."""
    beside = at + side
    if beside < 0 or beside >= len(sequence) or lines[sequence[beside]] != lines[sequence[at]]:
        return -1
    return sequence[beside]


@inlined_kernel
def _is_apart(points, ranges, one, other, gap):
    """Whether the angle between two returns exceeds a gap [rad]."""
    if gap == np.inf:
        return False
    x = points[one, 1] * points[other, 2] - points[one, 2] * points[other, 1]
    y = points[one, 2] * points[other, 0] - points[one, 0] * points[other, 2]
    z = points[one, 0] * points[other, 1] - points[one, 1] * points[other, 0]
    return np.sqrt(x * x + y * y + z * z) > gap * ranges[one] * ranges[other]


@kernel
def _thin_lines(lines, sequence, step, is_kept):
    """Keep every ``step``-th point of each line."""
    if step == 1:
        return
    place = 0
    for at in range(len(sequence)):
        if at > 0 and lines[sequence[at]] != lines[sequence[at - 1]]:
            place = 0
        is_kept[sequence[at]] = place % step == 0
        place += 1


@kernel
def _thin_voxels(points, ranges, is_lone, size, is_kept):
    """Keep the first return of each voxel [m], of those that are kept and no outliers.

    The places are kept in a hash table, in which what collides takes the next slot.
    """
    slots = 1
    while slots < 2 * len(points):
        slots *= 2
    table = np.full(slots, -1, np.int64)
    for i in range(len(points)):
        if not is_kept[i] or ranges[i] == 0.0 or is_lone[i]:
            continue
        x, y, z = _voxel(points, i, size)
        slot = (x * _HASH_X ^ y * _HASH_Y ^ z * _HASH_Z) & (slots - 1)
        while table[slot] >= 0 and (x, y, z) != _voxel(points, table[slot], size):
            slot = (slot + 1) & (slots - 1)
        if table[slot] >= 0:
            is_kept[i] = False
        else:
            table[slot] = i


@inlined_kernel
def _voxel(points, index, size):
    return (
        np.int64(np.floor(points[index, 0] / size)),
        np.int64(np.floor(points[index, 1] / size)),
        np.int64(np.floor(points[index, 2] / size)),
    )


@kernel
def _beams(  # noqa: PLR0913
    points, ranges, is_kept, offsets, T_map_sensor, base_z, T_base_sensor, body, limits,
):  # fmt: skip
    """Origins and ends (K, 3), whether they hit (K,), and their points (K,)."""
    min_range, max_range, min_height, max_height = limits
    origins, ends = np.empty((len(points), 3)), np.empty((len(points), 3))
    is_hit = np.empty(len(points), np.bool_)
    source = np.empty(len(points), np.int64)
    has_body, has_times = body[0, 0] < np.inf, len(offsets) > 0 and len(base_z) > 1
    first = offsets.min() if has_times else 0
    knots_per_ns = (len(base_z) - 1) / (offsets.max() - first) if has_times else 0.0
    count = 0
    for i in range(len(points)):
        distance = ranges[i]
        if not is_kept[i] or distance == 0.0 or distance < min_range:
            continue
        x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        knot, share = 0, 0.0
        if has_times:
            place = (offsets[i] - first) * knots_per_ns
            knot = min(int(place), len(base_z) - 2)
            share = place - knot
        if has_body and _is_in(body, T_base_sensor[knot], x, y, z):
            continue
        if distance > max_range:
            scale = max_range / distance
            x, y, z = x * scale, y * scale, z * scale
        for axis in range(3):
            origin, end = _placed(T_map_sensor[knot], axis, x, y, z)
            if share > 0.0:
                next_origin, next_end = _placed(T_map_sensor[knot + 1], axis, x, y, z)
                origin += share * (next_origin - origin)
                end += share * (next_end - end)
            origins[count, axis], ends[count, axis] = origin, end
        ground = base_z[knot]
        if share > 0.0:
            ground += share * (base_z[knot + 1] - ground)
        above = ends[count, 2] - ground
        is_hit[count] = distance <= max_range and min_height <= above <= max_height
        source[count] = i
        count += 1
    return origins[:count], ends[:count], is_hit[:count], source[:count]


@inlined_kernel
def _placed(T, axis, x, y, z):
    """One coordinate of the origin of a frame, and of a point in it."""
    return T[axis, 3], T[axis, 3] + T[axis, 0] * x + T[axis, 1] * y + T[axis, 2] * z


@inlined_kernel
def _is_in(body, T_base_sensor, x, y, z):
    """Whether a point lies in a box of base_link, of which the least corner comes first."""
    for axis in range(3):
        _, place = _placed(T_base_sensor, axis, x, y, z)
        if not body[0, axis] <= place <= body[1, axis]:
            return False
    return True
