# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages into arrays.

Messages are taken by duck type: rclpy's and rosbags' serve alike. What comes out of here is sound;
what is not raises `InputError` with the field.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heightmap25d_ros import memory, se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import (
    HEIGHT_RESOLUTION,
    POSITION_LIMIT,
    PROBABILITY_SCALE,
    Geometry,
    HeightMap,
    require_plausible,
)
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.io import _scan_fields
from heightmap25d_ros.io.layers_file import MOST_LEVELS, checked
from heightmap25d_ros.localization.layers import NAMES, LayerMap
from heightmap25d_ros.mapping.scan import Scan

QUATERNION_TOLERANCE = 0.01
"""How far the norm of a rotation may be from 1, as in tf2; within it, it is normalised."""

LONGEST_PATH = 1e5
"""No robot is sent so far at once [m]."""

_NO_VARIANCE = 1e-9  # rounding

LONGEST_FRAME = 100
"""Characters of the name of a frame: names are kept, logged and sent."""


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
        If a field is not finite, or contradicts the others or the number of ranges.
    """
    stamp = stamp_ns(message.header)
    ranges = np.asarray(message.ranges, dtype=np.float32)
    _scan_fields.check_fields(message, len(ranges))
    return Scan(
        stamp_ns=stamp,
        frame_id=frame_name(message.header.frame_id, "header.frame_id"),
        angle_min=float(message.angle_min),
        angle_increment=float(message.angle_increment),
        time_increment=float(message.time_increment),
        range_min=float(message.range_min),
        range_max=float(message.range_max),
        ranges=ranges,
    )


def odometry(message: Any, base_frame: str = "") -> Odometry:
    """`Odometry` of a nav_msgs/Odometry, a PoseStamped or a PoseWithCovarianceStamped.

    The child is the base frame where the message names none, as poses never do. Refuses unnamed
    frames, and what `pose` refuses.
    """
    frame_id = frame_name(message.header.frame_id, "header.frame_id")
    given = frame_name(getattr(message, "child_frame_id", ""), "child_frame_id")
    child_frame_id = given or base_frame
    if not (frame_id and child_frame_id):
        raise InputError("child_frame_id: empty" if frame_id else "header.frame_id: empty")
    return Odometry(
        stamp_ns=stamp_ns(message.header),
        frame_id=frame_id,
        child_frame_id=child_frame_id,
        T=_stamped_pose(message),
    )


def height_map(message: Any, frame_id: str | None = None) -> HeightMap:
    """`HeightMap` of a heightmap25d_msgs/HeightGrid, which must be in a frame if one is given.

    Raises
    ------
    InputError
        If it is in another frame, its geometry is not that of a grid along the axes, the arrays do
        not go with it, or the heights are in another unit.
    """
    geometry = _map_geometry(message, frame_id)
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
        is_level=bool(getattr(message, "level_lasers", False)),  # older bags have none
    )


def upper_surfaces(message: Any, frame_id: str | None = None) -> tuple[Geometry, UpperSurfaces]:
    """The content of a heightmap25d_msgs/UpperSurfaces, and the cells that it is counted in.

    Raises
    ------
    InputError
        For what `height_map` refuses, and where a surface is in no cell, or below its bottom.
    """
    geometry = _map_geometry(message, frame_id)
    cell, top, bottom, probability = (
        np.asarray(getattr(message, name), np.int64) for name in _UPPER
    )
    count = len(cell)
    for name, values in zip(_UPPER, (cell, top, bottom, probability), strict=True):
        if len(values) != count:
            raise InputError(f"{name}: {len(values)} values for {count} surfaces")
    rows, columns = geometry.shape
    if (cell >= rows * columns).any():
        raise InputError(f"cell: {cell.max()} is not one of {columns} x {rows} cells")
    if (bottom > top).any():
        raise InputError("bottom: is above the top")
    return geometry, UpperSurfaces.of(
        np.column_stack(np.divmod(cell, columns)),
        top,
        bottom,
        probability * (PROBABILITY_SCALE // 255),
    )


_UPPER = ("cell", "top", "bottom", "probability")


def localization_layers(message: Any, frame_id: str | None = None) -> LayerMap:
    """The content of a heightmap25d_msgs/LocalizationLayers.

    Raises
    ------
    InputError
        For a map that `height_map` refuses, arrays of different lengths, values that no layer has,
        and if the memory is not available.
    """
    if frame_id is not None:
        require_frame(message.header, frame_id)
    geometry = _geometry(message.info)
    cell, number = (np.asarray(getattr(message, name), np.int64) for name in ("cell", "level"))
    rows, columns = geometry.shape
    for name in ("level", *NAMES):
        if len(getattr(message, name)) != len(cell):
            raise InputError(f"{name}: {len(getattr(message, name))} values for {len(cell)} cells")
    if (cell >= rows * columns).any():
        raise InputError(f"cell: {cell.max()} is not one of {columns} x {rows} cells")
    if (number > MOST_LEVELS).any():
        raise InputError(f"level: {number.max()} is not 0 .. {MOST_LEVELS}")
    levels = 1 + int(number.max(initial=0))
    memory.require(4 * len(NAMES) * levels * rows * columns, "the localization layers")
    lowest, *above = (
        _layers_of(message, geometry, cell, number == level) for level in range(levels)
    )
    return replace(lowest, above=tuple(above))


def _layers_of(
    message: Any, geometry: Geometry, cell: NDArray[np.int64], is_here: NDArray[np.bool_]
) -> LayerMap:
    """Dense layers of the entries of one level."""
    dense = {name: np.zeros(geometry.shape, np.float32) for name in NAMES}
    for name, values in dense.items():
        values.ravel()[cell[is_here]] = np.asarray(getattr(message, name), np.float32)[is_here]
    return checked(geometry, dense)


def _map_geometry(message: Any, frame_id: str | None) -> Geometry:
    """Of a message with the header and the heights of a map; its frame is checked if given."""
    if frame_id is not None:
        require_frame(message.header, frame_id)
    geometry = _geometry(message.info)
    if not math.isclose(message.height_resolution, HEIGHT_RESOLUTION, rel_tol=1e-5):
        raise InputError(
            f"height_resolution: is {message.height_resolution:g} m, not {HEIGHT_RESOLUTION:g} m"
        )
    return geometry


def _geometry(info: Any) -> Geometry:
    """Of a nav_msgs/MapMetaData without rotation."""
    if not (info.width and info.height):
        raise InputError(f"info: {info.width} x {info.height} cells are no map")
    x, y, z, *rotation = _coordinates(info.origin.position, info.origin.orientation, "info.origin")
    if abs(rotation[3]) < 1.0 - 1e-6:
        raise InputError("info.origin: the map is turned")
    geometry = Geometry(
        # A float32 there: 0.1 is not the 0.1 that the cells were made with.
        resolution=float(f"{info.resolution:.7g}"),
        origin=(x, y),
        shape=(info.height, info.width),
        ground_zero=z,
    )
    try:
        require_plausible(geometry)
    except InputError as error:
        raise InputError(f"info.{error}") from None
    return geometry


def pose_in(message: Any, frame_id: str) -> se3.Matrix:
    """(4, 4) matrix of a geometry_msgs/PoseStamped or PoseWithCovarianceStamped in a frame.

    Raises
    ------
    InputError
        If it is in another one; and for what `pose` refuses.
    """
    require_frame(message.header, frame_id)
    return _stamped_pose(message)


def _stamped_pose(message: Any) -> se3.Matrix:
    """(4, 4) of the pose of a PoseStamped, a PoseWithCovarianceStamped or an Odometry."""
    nested = message.pose
    return pose(nested.pose, "pose.pose") if hasattr(nested, "pose") else pose(nested, "pose")


def require_frame(header: Any, frame_id: str) -> None:
    """Refuse a std_msgs/Header of another frame.

    Raises
    ------
    InputError
        If it is another one.
    """
    frame = frame_name(header.frame_id, "header.frame_id")
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


def point(message: Any) -> NDArray[np.float64]:
    """(3,) [m] of a geometry_msgs/Point.

    Raises
    ------
    InputError
        If it is not finite, or farther away than `POSITION_LIMIT`.
    """
    place = np.array([message.x, message.y, message.z], np.float64)
    if not (np.abs(place) <= POSITION_LIMIT).all():
        raise InputError(f"point: {tuple(place.tolist())} is not a place")
    return place


def twist(message: Any) -> tuple[float, float]:
    """Speed [m/s] along x and turn rate [rad/s] about z of a geometry_msgs/Twist.

    Raises
    ------
    InputError
        If one is not finite.
    """
    command = float(message.linear.x), float(message.angular.z)
    if not all(map(math.isfinite, command)):
        raise InputError(f"linear.x, angular.z: {command} is not a command")
    return command


def path_in(message: Any, frame_id: str) -> NDArray[np.float64]:
    """(N, 3) float64 [m, m, rad]: x, y and heading of the poses of a nav_msgs/Path in a frame.

    Raises
    ------
    InputError
        If it is in another frame or longer than `LONGEST_PATH`; and for what `pose` refuses.
    """
    require_frame(message.header, frame_id)
    poses = path_poses(message)
    points = poses[:, :2, 3]
    if np.abs(np.diff(points, axis=0)).sum() > LONGEST_PATH:
        raise InputError(f"poses: are more than {LONGEST_PATH:g} m long")
    return np.column_stack([points, np.arctan2(poses[:, 1, 0], poses[:, 0, 0])])


def polygon(message: Any, frame_id: str) -> NDArray[np.float64]:
    """(N, 2) float64 [m]: the corners of a geometry_msgs/PolygonStamped in a frame.

    Raises
    ------
    InputError
        If it has corners and is in another frame.
    """
    points = message.polygon.points
    if len(points):
        require_frame(message.header, frame_id)
    return np.array([(point.x, point.y) for point in points], np.float64).reshape(-1, 2)


def path_poses(message: Any) -> NDArray[np.float64]:
    """(N, 4, 4) the poses of a nav_msgs/Path in its own frame; refuses what `pose` refuses."""
    poses = [stamped.pose for stamped in message.poses]
    coordinates = [
        _coordinates(pose.position, pose.orientation, f"poses[{index}]")
        for index, pose in enumerate(poses)
    ]
    return _matrices(coordinates) if coordinates else np.empty((0, 4, 4))


def planar_covariance(message: Any, limits: ArrayLike) -> NDArray[np.float64]:
    """(3, 3) of x, y [m], yaw [rad] of a geometry_msgs/PoseWithCovarianceStamped.

    Parameters
    ----------
    message : geometry_msgs.msg.PoseWithCovarianceStamped
    limits : (3,) float
        For which larger standard deviations are taken: many senders write 99999 for "unknown".

    Raises
    ------
    InputError
        If it is not finite, or is no covariance: a variance is negative, for instance.
    """
    whole = np.asarray(message.pose.covariance, np.float64)
    if whole.size != 36:
        raise InputError(f"pose.covariance: {whole.size} numbers are not 6 x 6")
    whole = whole.reshape(6, 6)
    covariance = whole[np.ix_((0, 1, 5), (0, 1, 5))]
    refused = InputError(f"pose.covariance: {covariance.tolist()} is not a covariance")
    if not np.isfinite(covariance).all() or np.diag(covariance).min() < -_NO_VARIANCE:
        raise refused
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    unit = np.where(deviation > 0.0, deviation, 1.0)
    with np.errstate(over="ignore", invalid="ignore"):
        correlation = (covariance / unit / unit[:, None] + covariance.T / unit / unit[:, None]) / 2
    # Where an entry is beyond 1, or no number, there are no eigenvalues to ask for.
    is_one = bool((np.abs(correlation) < 1.0 + 1e-6).all())
    if not is_one or np.linalg.eigvalsh(correlation)[0] < -_NO_VARIANCE:
        raise refused
    limited = np.minimum(deviation, limits)
    return np.asarray(correlation * np.outer(limited, limited))


def transforms(stamped_transforms: Iterable[Any]) -> list[Transform]:
    """The sound ones of some geometry_msgs/TransformStamped, as a tf2_msgs/TFMessage has them.

    Unsound ones are left out, as tf2 does: one broken joint of an arm must not take the
    laser's mount away. Where all are unsound `InputError` names the first one's field.
    """
    sound: list[tuple[str, str, int]] = []
    coordinates: list[tuple[float, ...]] = []
    faults: list[InputError] = []
    for index, stamped in enumerate(stamped_transforms):
        field, content = f"transforms[{index}]", stamped.transform
        try:
            parent = frame_name(stamped.header.frame_id, field)
            child = frame_name(stamped.child_frame_id, field)
            if not (parent and child):
                raise InputError(f"{field}: a frame has no name")
            entry = parent, child, stamp_ns(stamped.header)
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


def frame_name(name: str, field: str) -> str:
    """Name of a frame without the leading slash of old recordings, as tf2 reads it.

    Raises
    ------
    InputError
        If it has more than `LONGEST_FRAME` characters, or one that cannot be printed.
    """
    if len(name) > LONGEST_FRAME or not name.isprintable():
        raise InputError(f"{field}: {name[:LONGEST_FRAME]!r} is not the name of a frame")
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
