# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages into arrays and arrays into messages.

Incoming messages are taken by duck type: rclpy's and rosbags' serve alike. What comes out of
here is sound; what is not raises `InputError` with the field. Outgoing messages are rclpy's:
their big arrays are set as ``array.array``, since every other way checks each element.
"""

from __future__ import annotations

import array
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid import HEIGHT_RESOLUTION, PROBABILITY_SCALE, Geometry, HeightMap
from heightmap25d_ros.sensor import Scan

QUATERNION_TOLERANCE = 0.01
"""How far the norm of a rotation may be from 1, as in tf2; within it, it is normalised."""

POSITION_LIMIT = 1e8
"""Coordinates beyond this are nonsense [m]: a place on Earth has none as large."""

ANGLE_COUNT_TOLERANCE = 2
"""How many beams more or fewer than the angles say: drivers disagree about the last one."""

SWEEP_LIMIT = 60.0
"""A scan that takes longer than this from first to last beam is nonsense [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Odometry:
    """A pose of the robot, as nav_msgs/Odometry.

    Attributes
    ----------
    stamp_ns : int [ns]
    frame_id, child_frame_id : str
    T : (4, 4) float64
        Pose of the child frame in the frame.
    """

    stamp_ns: int
    frame_id: str
    child_frame_id: str
    T: se3.Matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class Transform:
    """Pose ``T`` (4, 4) of the child frame in its parent, as geometry_msgs/TransformStamped."""

    parent: str
    child: str
    stamp_ns: int
    T: se3.Matrix


def stamp_ns(header: Any) -> int:
    """Stamp [ns] of a std_msgs/Header.

    Raises
    ------
    InputError
        If it is negative, or its nanoseconds make a second or more.
    """
    seconds, nanoseconds = int(header.stamp.sec), int(header.stamp.nanosec)
    if seconds < 0 or not 0 <= nanoseconds < 10**9:
        raise InputError(f"header.stamp: {seconds} s {nanoseconds} ns is not a time")
    return seconds * 10**9 + nanoseconds


def scan(message: Any) -> Scan:
    """`Scan` of a sensor_msgs/LaserScan; shares the memory of its ranges.

    Raises
    ------
    InputError
        If the angles or times are not finite, or do not go with the number of ranges.
    """
    stamp = stamp_ns(message.header)
    ranges = np.asarray(message.ranges, dtype=np.float32)
    for name in ("angle_min", "angle_max", "angle_increment", "time_increment"):
        if not math.isfinite(getattr(message, name)):
            raise InputError(f"{name}: {getattr(message, name)} is not finite")
    steps = len(ranges) - 1
    if steps < 0:
        raise InputError("ranges: empty")
    increment = float(message.angle_increment)
    span = float(message.angle_max) - float(message.angle_min)
    if steps and not increment:
        raise InputError(f"angle_increment: zero with {len(ranges)} ranges")
    if abs(span - increment * steps) > ANGLE_COUNT_TOLERANCE * abs(increment):
        raise InputError(
            f"ranges: {len(ranges)} do not go with angles over {span:g} rad by {increment:g} rad"
        )
    if not message.range_min <= message.range_max:
        raise InputError(f"range_min: {message.range_min} is above range_max {message.range_max}")
    if abs(message.time_increment) * steps > SWEEP_LIMIT:
        raise InputError(f"time_increment: {message.time_increment:g} s between beams")
    return Scan(
        stamp_ns=stamp,
        frame_id=_frame(message.header.frame_id),
        angle_min=float(message.angle_min),
        angle_increment=increment,
        time_increment=float(message.time_increment),
        range_min=float(message.range_min),
        range_max=float(message.range_max),
        ranges=ranges,
    )


def odometry(message: Any) -> Odometry:
    """`Odometry` of a nav_msgs/Odometry; refuses unnamed frames, and what `pose` refuses."""
    frame_id, child_frame_id = _frame(message.header.frame_id), _frame(message.child_frame_id)
    if not (frame_id and child_frame_id):
        raise InputError("child_frame_id: empty" if frame_id else "header.frame_id: empty")
    return Odometry(
        stamp_ns=stamp_ns(message.header),
        frame_id=frame_id,
        child_frame_id=child_frame_id,
        T=pose(message.pose.pose, "pose.pose"),
    )


def height_map(message: Any) -> HeightMap:
    """`HeightMap` of a heightmap25d_msgs/HeightGrid.

    Raises
    ------
    InputError
        If its geometry is not that of a grid along the axes, the arrays do not go with it, or the
        heights are in another unit.
    """
    geometry = _geometry(message.info)
    if not math.isclose(message.height_resolution, HEIGHT_RESOLUTION, rel_tol=1e-5):
        raise InputError(
            f"height_resolution: is {message.height_resolution:g} m, not {HEIGHT_RESOLUTION:g} m"
        )
    threshold = float(message.probability_threshold)
    if not 0.0 < threshold <= 1.0:
        raise InputError(f"probability_threshold: {threshold:g} is not within 0 .. 1")
    rows, columns = geometry.shape
    for name in ("height", "probability"):
        if len(getattr(message, name)) != rows * columns:
            raise InputError(
                f"{name}: {len(getattr(message, name))} values for {columns} x {rows} cells"
            )
    probability = np.asarray(message.probability, np.uint16) * (PROBABILITY_SCALE // 255)
    return HeightMap(
        geometry=geometry,
        height=np.array(message.height, np.int16).reshape(geometry.shape),
        probability=probability.astype(np.uint16).reshape(geometry.shape),
        probability_threshold=threshold,
    )


def _geometry(info: Any) -> Geometry:
    """Of a nav_msgs/MapMetaData without rotation."""
    resolution = float(info.resolution)
    if not 0.001 <= resolution <= 1000.0:
        raise InputError(f"info.resolution: {resolution:g} m is not the side of a cell")
    if not (info.width and info.height):
        raise InputError(f"info: {info.width} x {info.height} cells are no map")
    x, y, _, *rotation = _coordinates(info.origin.position, info.origin.orientation, "info.origin")
    if abs(rotation[3]) < 1.0 - 1e-6:
        raise InputError("info.origin: the map is turned")
    # The resolution is a float32 there: 0.1 is not the 0.1 that the cells were made with.
    return Geometry(
        resolution=float(f"{resolution:.7g}"), origin=(x, y), shape=(info.height, info.width)
    )


def pose_in(message: Any, frame_id: str, field: str) -> se3.Matrix:
    """(4, 4) matrix of a geometry_msgs/PoseStamped that must be in a frame.

    Raises
    ------
    InputError
        If it is in another one; and for what `pose` refuses.
    """
    try:
        require_frame(message.header, frame_id)
        return pose(message.pose, "pose")
    except InputError as error:
        raise InputError(f"{field}.{error}") from None


def require_frame(header: Any, frame_id: str) -> None:
    """Refuse a std_msgs/Header of another frame.

    Raises
    ------
    InputError
        If it is another one.
    """
    frame = _frame(header.frame_id)
    if frame != frame_id:
        raise InputError(f"header.frame_id: is {frame!r}, not {frame_id!r}")


def pose(message: Any, field: str) -> se3.Matrix:
    """(4, 4) matrix of a geometry_msgs/Pose that stands in the given field of a message.

    Raises
    ------
    InputError
        If a value is not finite, the position is farther away than `POSITION_LIMIT`, or the
        orientation is no unit quaternion within `QUATERNION_TOLERANCE`.
    """
    return np.asarray(_matrices([_coordinates(message.position, message.orientation, field)])[0])


def planar_covariance(message: Any) -> NDArray[np.float64]:
    """(3, 3) of x, y [m], yaw [rad] of a geometry_msgs/PoseWithCovarianceStamped.

    Raises
    ------
    InputError
        If it is not finite, or is no covariance: a variance is negative, for instance.
    """
    whole = np.asarray(message.pose.covariance, np.float64).reshape(6, 6)
    covariance = whole[np.ix_((0, 1, 5), (0, 1, 5))]
    if not np.isfinite(covariance).all() or np.linalg.eigvalsh(covariance)[0] < -1e-9:
        raise InputError(f"pose.covariance: {covariance.tolist()} is not a covariance")
    return np.asarray((covariance + covariance.T) / 2)


def transforms(message: Any) -> list[Transform]:
    """The sound ones of the transforms of a tf2_msgs/TFMessage.

    Unsound ones are left out, as tf2 does: one broken joint of an arm must not take the
    laser's mount away. Where all are unsound `InputError` names the first one's field.
    """
    sound: list[tuple[str, str, int]] = []
    coordinates: list[tuple[float, ...]] = []
    faults: list[InputError] = []
    for index, stamped in enumerate(message.transforms):
        field, content = f"transforms[{index}]", stamped.transform
        try:
            names = _frame(stamped.header.frame_id), _frame(stamped.child_frame_id)
            if not all(names):
                raise InputError(f"{field}: a frame has no name")
            entry = (*names, stamp_ns(stamped.header))
            coordinates.append(_coordinates(content.translation, content.rotation, field))
            sound.append(entry)
        except InputError as fault:
            faults.append(fault)
    if not sound:
        if faults:
            raise faults[0]
        return []
    return [
        Transform(parent=parent, child=child, stamp_ns=stamp, T=T)
        for (parent, child, stamp), T in zip(sound, _matrices(coordinates), strict=True)
    ]


def _frame(name: str) -> str:
    """Frame name without the leading slash of old recordings, as tf2 reads it."""
    return name.lstrip("/")


def _coordinates(position: Any, quaternion: Any, field: str) -> tuple[float, ...]:
    """Position and quaternion as seven numbers, checked."""
    place = position.x, position.y, position.z
    rotation = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    if not all(abs(coordinate) <= POSITION_LIMIT for coordinate in place):
        raise InputError(f"{field}: {place} is not a place")
    if not abs(math.hypot(*rotation) - 1.0) <= QUATERNION_TOLERANCE:
        raise InputError(f"{field}: {rotation} is not a unit quaternion")
    return place + rotation


def _matrices(coordinates: list[tuple[float, ...]]) -> se3.Matrix:
    values = np.array(coordinates, dtype=np.float64)
    return se3.from_quaternion(values[:, :3], values[:, 3:])


def fill_occupancy_grid(
    message: Any, occupancy: NDArray[np.int8], geometry: Geometry, stamp: int, frame_id: str
) -> None:
    """Fill a nav_msgs/OccupancyGrid.

    Parameters
    ----------
    message : nav_msgs.msg.OccupancyGrid
    occupancy : (rows, columns) int8
        -1 unknown, 0 .. 100.
    geometry : Geometry
        Of the same shape.
    stamp : int [ns]
        Of the newest reading in the map.
    frame_id : str
    """
    if occupancy.shape != geometry.shape or occupancy.dtype != np.int8:
        raise ValueError(f"{occupancy.dtype} {occupancy.shape} does not go with {geometry}")
    fill_header(message.header, stamp, frame_id)
    _fill_info(message.info, geometry, stamp)
    message.data = _array("b", occupancy)


def fill_height_grid(message: Any, height_map: HeightMap, stamp: int, frame_id: str) -> None:
    """Fill a heightmap25d_msgs/HeightGrid.

    Rounding to a byte must not make a known cell unknown, nor an observed one unobserved. So
    the published threshold lies half-way between two bytes (0.5 stays 0.5), known cells are
    rounded to the upper side of it or above, other observed cells to the lower side.
    """
    fill_header(message.header, stamp, frame_id)
    _fill_info(message.info, height_map.geometry, stamp)
    message.height_resolution = HEIGHT_RESOLUTION
    step = PROBABILITY_SCALE / 255.0
    rounded = np.rint(height_map.probability / step)
    lowest_known = max(2, round(height_map.probability_threshold * 255.0))
    observed = height_map.probability > 0
    unknown = np.where(observed, np.clip(rounded, 1, lowest_known - 1), 0)
    probability = np.where(height_map.known, np.maximum(rounded, lowest_known), unknown)
    message.probability_threshold = (lowest_known - 0.5) / 255.0
    message.height = _array("h", height_map.height)
    message.probability = _array("B", probability.astype(np.uint8))


def fill_height_points(
    message: Any, point_field: Any, height_map: HeightMap, stamp: int, frame_id: str
) -> None:
    """Fill a sensor_msgs/PointCloud2 with the tops of the known cells.

    Parameters
    ----------
    message : sensor_msgs.msg.PointCloud2
        Becomes one row of points: x, y, z [m] and the probability as intensity, float32.
    point_field : the class sensor_msgs.msg.PointField
    height_map : HeightMap
    stamp : int [ns]
    frame_id : str
    """
    fill_header(message.header, stamp, frame_id)
    cells = np.argwhere(height_map.known)
    iy, ix = cells.T
    points = np.empty((len(cells), 4), dtype="<f4")
    points[:, :2] = height_map.geometry.cell_center(cells)
    points[:, 2] = height_map.height[iy, ix] * HEIGHT_RESOLUTION
    points[:, 3] = height_map.probability[iy, ix] / PROBABILITY_SCALE
    message.height, message.width = 1, len(points)
    message.fields = [
        point_field(name=name, offset=4 * index, datatype=point_field.FLOAT32, count=1)
        for index, name in enumerate(("x", "y", "z", "intensity"))
    ]
    message.is_bigendian = False
    message.point_step = 16
    message.row_step = 16 * len(points)
    message.data = _array("B", points)
    message.is_dense = True


def fill_grid_map(
    message: Any,
    multi_array: Any,
    dimension: Any,
    height_map: HeightMap,
    stamp: int,
    frame_id: str,
) -> None:
    """Fill a grid_map_msgs/GridMap with the layers ``elevation`` [m] and ``probability``.

    Its cells are stored as Eigen stores a matrix, column by column, where rows run along -x and
    columns along -y from the corner of the largest x and y. Unknown heights are NaN, as its
    readers expect.

    Parameters
    ----------
    message : grid_map_msgs.msg.GridMap
    multi_array, dimension : the classes std_msgs.msg.Float32MultiArray and MultiArrayDimension
    height_map : HeightMap
    stamp : int [ns]
    frame_id : str
    """
    fill_header(message.header, stamp, frame_id)
    geometry = height_map.geometry
    columns, rows = geometry.shape  # of the matrix: our rows run along y
    message.info.resolution = geometry.resolution
    message.info.length_x, message.info.length_y = (
        cells * geometry.resolution for cells in (rows, columns)
    )
    centre = message.info.pose
    centre.position.x = geometry.origin[0] + message.info.length_x / 2
    centre.position.y = geometry.origin[1] + message.info.length_y / 2
    centre.orientation.w = 1.0
    elevation = np.where(height_map.known, height_map.height * HEIGHT_RESOLUTION, np.nan)
    layers = {"elevation": elevation, "probability": height_map.probability / PROBABILITY_SCALE}
    message.layers, message.basic_layers = list(layers), ["elevation"]
    for values in layers.values():
        data = multi_array(data=_array("f", values[::-1, ::-1].astype(np.float32)))
        data.layout.dim = [
            dimension(label="column_index", size=columns, stride=rows * columns),
            dimension(label="row_index", size=rows, stride=rows),
        ]
        message.data.append(data)


def fill_path(
    message: Any, pose_stamped: Any, poses: NDArray[np.float64], stamp: int, frame_id: str
) -> None:
    """Fill a nav_msgs/Path with poses (N, 4, 4).

    Parameters
    ----------
    message : nav_msgs.msg.Path
    pose_stamped : the class geometry_msgs.msg.PoseStamped
    poses : (N, 4, 4) float64 [m], frame_id
    stamp : int [ns]
    frame_id : str
    """
    fill_header(message.header, stamp, frame_id)
    quaternions = se3.to_quaternion(poses) if len(poses) else np.empty((0, 4))
    for T, quaternion in zip(poses, quaternions, strict=True):
        stamped = pose_stamped()
        fill_header(stamped.header, stamp, frame_id)
        place, rotation = stamped.pose.position, stamped.pose.orientation
        place.x, place.y, place.z = (float(coordinate) for coordinate in T[:3, 3])
        rotation.x, rotation.y, rotation.z, rotation.w = (float(part) for part in quaternion)
        message.poses.append(stamped)


def fill_pose(
    message: Any, T: se3.Matrix, covariance: NDArray[np.float64], stamp: int, frame_id: str
) -> None:
    """Fill a geometry_msgs/PoseWithCovarianceStamped.

    Parameters
    ----------
    message : geometry_msgs.msg.PoseWithCovarianceStamped
    T : (4, 4) float64
    covariance : (3, 3) float64
        Of x, y [m], yaw [rad]; that of z, roll and pitch is not known and 0.
    stamp : int [ns]
    frame_id : str
    """
    fill_header(message.header, stamp, frame_id)
    _fill_position(message.pose.pose.position, T)
    _fill_rotation(message.pose.pose.orientation, T)
    whole = np.zeros((6, 6))
    whole[np.ix_((0, 1, 5), (0, 1, 5))] = covariance
    message.pose.covariance = whole.reshape(-1)


def fill_transform(message: Any, T: se3.Matrix, stamp: int, parent: str, child: str) -> None:
    """Fill a geometry_msgs/TransformStamped with the pose (4, 4) of the child in its parent."""
    fill_header(message.header, stamp, parent)
    message.child_frame_id = child
    _fill_position(message.transform.translation, T)
    _fill_rotation(message.transform.rotation, T)


def fill_poses(
    message: Any, pose_type: Any, poses: NDArray[np.float64], stamp: int, frame_id: str
) -> None:
    """Fill a geometry_msgs/PoseArray; parameters as of `fill_path`, with the class Pose."""
    fill_header(message.header, stamp, frame_id)
    for T in poses:
        filled = pose_type()
        _fill_position(filled.position, T)
        _fill_rotation(filled.orientation, T)
        message.poses.append(filled)


def _fill_position(message: Any, T: se3.Matrix) -> None:
    message.x, message.y, message.z = map(float, T[:3, 3])


def _fill_rotation(message: Any, T: se3.Matrix) -> None:
    message.x, message.y, message.z, message.w = map(float, se3.to_quaternion(T))


def _fill_stamp(message: Any, stamp: int) -> None:
    message.sec, message.nanosec = divmod(stamp, 10**9)


def fill_header(message: Any, stamp: int, frame_id: str) -> None:
    """Fill a std_msgs/Header; the stamp in ns."""
    _fill_stamp(message.stamp, stamp)
    message.frame_id = frame_id


def _fill_info(message: Any, geometry: Geometry, stamp: int) -> None:
    """nav_msgs/MapMetaData: the origin is the outer corner of cell (0, 0), without rotation."""
    _fill_stamp(message.map_load_time, stamp)
    message.resolution = float(geometry.resolution)
    message.height, message.width = (int(side) for side in geometry.shape)
    message.origin.position.x, message.origin.position.y = map(float, geometry.origin)
    message.origin.position.z = 0.0
    message.origin.orientation.x = message.origin.orientation.y = 0.0
    message.origin.orientation.z, message.origin.orientation.w = 0.0, 1.0


def _array(code: str, values: NDArray[Any]) -> array.array[Any]:
    return array.array(code, values.tobytes())
