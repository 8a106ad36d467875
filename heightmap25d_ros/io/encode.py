# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays into messages.

Outgoing messages are rclpy's: their big arrays are set as ``array.array``, since every other way
checks each element. Nothing that is not finite goes out: it raises `ValueError` here, but for what
a message defines as such (NaN where a layer of grid_map is unknown, an infinite clearance).
"""

from __future__ import annotations

import array
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import (
    HEIGHT_RESOLUTION,
    PROBABILITY_SCALE,
    Geometry,
    HeightMap,
    stored_probability,
)
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.localization.layers import NAMES, LayerMap

if TYPE_CHECKING:  # a node that fills other messages needs neither
    from heightmap25d_ros.localization.tracker import Attempt
    from heightmap25d_ros.planning.plan import Plan

_PROBABILITY_STEP = PROBABILITY_SCALE / 255.0
"""Of a probability that is published as a byte."""


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


def fill_occupancy_grid_update(
    message: Any, occupancy: NDArray[np.int8], corner: tuple[int, int], stamp: int, frame_id: str
) -> None:
    """Fill a map_msgs/OccupancyGridUpdate.

    Parameters
    ----------
    message : map_msgs.msg.OccupancyGridUpdate
    occupancy : (rows, columns) int8
        Of the cells that are replaced.
    corner : (row, column)
        Of the first of them in the whole map.
    stamp : int [ns]
    frame_id : str
    """
    fill_header(message.header, stamp, frame_id)
    message.y, message.x = corner
    message.height, message.width = occupancy.shape
    message.data = _array("b", occupancy)


def fill_height_grid(
    message: Any,
    height_map: HeightMap,
    stamp: int,
    frame_id: str,
    *,
    loaded: int | None = None,
) -> None:
    """Fill a heightmap25d_msgs/HeightGrid.

    Rounding to a byte must not make a known cell unknown, nor an observed one unobserved. So
    the published threshold lies half-way between two bytes (0.5 stays 0.5), known cells are
    rounded to the upper side of it or above, other observed cells to the lower side.

    Parameters
    ----------
    message : heightmap25d_msgs.msg.HeightGrid
    height_map : HeightMap
    stamp : int [ns]
    frame_id : str
    loaded : int [ns], optional
        ``map_load_time``, which tells whole maps with updates apart; the stamp by default.
    """
    fill_header(message.header, stamp, frame_id)
    _fill_info(message.info, height_map.geometry, stamp if loaded is None else loaded)
    message.height_resolution = HEIGHT_RESOLUTION
    lowest_known = _lowest_known(height_map.probability_threshold)
    message.probability_threshold = (lowest_known - 0.5) / 255.0
    message.height = _array("h", height_map.height)
    known = stored_probability(height_map.probability_threshold)
    message.probability = _array("B", _bytes_of(known, lowest_known)[height_map.probability])
    message.level_lasers = height_map.is_level


@cache
def _bytes_of(known: int, lowest_known: int) -> NDArray[np.uint8]:
    """The byte for each stored probability, of which those from one on are known."""
    probability = np.arange(PROBABILITY_SCALE + 1)
    rounded = np.rint(probability / _PROBABILITY_STEP)
    unknown = np.where(probability > 0, np.clip(rounded, 1, lowest_known - 1), 0)
    byte = np.where(probability >= known, np.maximum(rounded, lowest_known), unknown)
    return byte.astype(np.uint8)


class Leveled(Protocol):
    """What has surfaces above the lowest ones: a `HeightMap`, or what knows no more of one."""

    @property
    def geometry(self) -> Geometry:
        """Of the map."""

    @property
    def upper(self) -> UpperSurfaces:
        """All of them known."""

    @property
    def probability_threshold(self) -> float:
        """No surface is believed less."""


def fill_upper_surfaces(message: Any, shown: Leveled, stamp: int, frame_id: str) -> None:
    """Fill a heightmap25d_msgs/UpperSurfaces with what lies above the lowest surfaces."""
    fill_header(message.header, stamp, frame_id)
    _fill_info(message.info, shown.geometry, stamp)
    message.height_resolution = HEIGHT_RESOLUTION
    upper = shown.upper
    rounded = np.rint(upper.probability / _PROBABILITY_STEP)
    iy, ix = upper.cell.T
    message.cell = _array("I", (iy * shown.geometry.shape[1] + ix).astype(np.uint32))
    message.top, message.bottom = _array("h", upper.top), _array("h", upper.bottom)
    probability = np.maximum(rounded, _lowest_known(shown.probability_threshold)).astype(np.uint8)
    message.probability = _array("B", probability)


def fill_localization_layers(message: Any, layers: LayerMap, stamp: int, frame_id: str) -> None:
    """Fill a heightmap25d_msgs/LocalizationLayers."""
    fill_header(message.header, stamp, frame_id)
    _fill_info(message.info, layers.geometry, stamp)
    levels = layers, *layers.above
    cells = [np.nonzero(level.ground_count.ravel())[0] for level in levels]
    message.cell = _array("I", np.concatenate(cells).astype(np.uint32))
    numbers = np.repeat(np.arange(len(levels)), [len(of_level) for of_level in cells])
    message.level = _array("B", numbers.astype(np.uint8))
    for name in NAMES:
        values = [
            getattr(level, name).ravel()[of_level]
            for level, of_level in zip(levels, cells, strict=True)
        ]
        setattr(message, name, _array("f", np.concatenate(values)))


def _lowest_known(probability_threshold: float) -> int:
    """The least probability of a known cell, as a byte."""
    return max(2, round(probability_threshold * 255.0))


def fill_height_points(
    message: Any,
    point_field: Any,
    height_map: HeightMap,
    stamp: int,
    frame_id: str,
    origin: Array | None = None,
) -> None:
    """Fill a sensor_msgs/PointCloud2 with the tops of all known surfaces.

    Parameters
    ----------
    message : sensor_msgs.msg.PointCloud2
        Becomes one row of points: x, y, z [m] and the probability as intensity, float32.
    point_field : the class sensor_msgs.msg.PointField
    height_map : HeightMap
    stamp : int [ns]
    frame_id : str
    origin : (3,) float64 [m], map
        Position of that frame, as of `local_origin`: float32 has steps of 0.5 m at 5000 km.
    """
    fill_header(message.header, stamp, frame_id)
    lowest, upper = np.argwhere(height_map.known), height_map.upper
    iy, ix = lowest.T
    points = np.empty((len(lowest) + len(upper), 4), dtype="<f4")
    x, y, z = (0.0, 0.0, 0.0) if origin is None else origin
    ground_zero = height_map.geometry.ground_zero
    cells = np.concatenate([lowest, upper.cell])
    points[:, :2] = height_map.geometry.cell_center(cells) - (x, y)
    heights = upper.top * HEIGHT_RESOLUTION + ground_zero
    points[:, 2] = np.concatenate([height_map.metres[iy, ix], heights]) - z
    probabilities = np.concatenate([height_map.probability[iy, ix], upper.probability])
    points[:, 3] = probabilities / PROBABILITY_SCALE
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
    layers = {
        "elevation": height_map.metres,
        "probability": height_map.probability / PROBABILITY_SCALE,
    }
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
    _require_finite("path", poses)
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
    message: Any, T: se3.Matrix, covariance: NDArray[np.float64], vertical: ArrayLike, stamp: int,
    frame_id: str,
) -> None:  # fmt: skip
    """Fill a geometry_msgs/PoseWithCovarianceStamped.

    Parameters
    ----------
    message : geometry_msgs.msg.PoseWithCovarianceStamped
    T : (4, 4) float64
    covariance : (3, 3) float64
        Of x, y [m], yaw [rad].
    vertical : (3,) array-like
        Variances of z [m^2], roll and pitch [rad^2].
    stamp : int [ns]
    frame_id : str
    """
    _require_finite("pose", T, covariance, np.asarray(vertical))
    fill_header(message.header, stamp, frame_id)
    _fill_position(message.pose.pose.position, T)
    _fill_rotation(message.pose.pose.orientation, T)
    whole = np.diag([0.0, 0.0, *np.asarray(vertical, np.float64), 0.0])
    whole[np.ix_((0, 1, 5), (0, 1, 5))] = covariance
    message.pose.covariance = whole.reshape(-1)


def fill_transform(message: Any, T: se3.Matrix, stamp: int, parent: str, child: str) -> None:
    """Fill a geometry_msgs/TransformStamped with the pose (4, 4) of the child in its parent."""
    _require_finite("transform", T)
    fill_header(message.header, stamp, parent)
    message.child_frame_id = child
    _fill_position(message.transform.translation, T)
    _fill_rotation(message.transform.rotation, T)


def fill_poses(
    message: Any, pose_type: Any, poses: NDArray[np.float64], stamp: int, frame_id: str
) -> None:
    """Fill a geometry_msgs/PoseArray; parameters as of `fill_path`, with the class Pose."""
    _require_finite("poses", poses)
    fill_header(message.header, stamp, frame_id)
    for T in poses:
        filled = pose_type()
        _fill_position(filled.position, T)
        _fill_rotation(filled.orientation, T)
        message.poses.append(filled)


def fill_plan_status(message: Any, plan: Plan) -> None:
    """Fill a heightmap25d_msgs/PlanStatus, but for its header."""
    figures = plan.length, plan.climb, plan.steepest_slope, plan.seconds
    _require_finite("plan", figures)
    message.code, message.reason = int(plan.status), plan.reason
    message.length, message.climb, message.steepest_slope, message.planning_time = figures
    message.least_clearance = plan.least_clearance  # infinite beside nothing


def fill_localization_status(message: Any, attempt: Attempt) -> None:
    """Fill the figures of a heightmap25d_msgs/LocalizationStatus with those of a registration."""
    found = attempt.registration
    figures = *attempt.deviation, found.overlap, found.residual, found.ratio
    _require_finite("registration", figures)
    message.reason = f"{attempt.kind.value}: {found.reason.value}"
    message.position_deviation, message.yaw_deviation = figures[:2]
    message.overlap, message.residual, message.ratio = figures[2:]
    message.weights = list(attempt.weights)


def fill_twist(message: Any, speed: float, turn_rate: float) -> None:
    """Fill a geometry_msgs/Twist with a speed [m/s] along x and a turn rate [rad/s] about z."""
    _require_finite("command", (speed, turn_rate))
    message.linear.x, message.angular.z = float(speed), float(turn_rate)


def _require_finite(what: str, *values: ArrayLike) -> None:
    """The one check of what goes out; a `ValueError` for what is not finite."""
    if not all(np.isfinite(value).all() for value in values):
        raise ValueError(f"{what}: is not finite, and not published")


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
    """nav_msgs/MapMetaData: the origin is the outer corner of cell (0, 0), without rotation.

    Its z is ground zero.
    """
    _fill_stamp(message.map_load_time, stamp)
    message.resolution = float(geometry.resolution)
    message.height, message.width = (int(side) for side in geometry.shape)
    message.origin.position.x, message.origin.position.y = map(float, geometry.origin)
    message.origin.position.z = float(geometry.ground_zero)
    message.origin.orientation.x = message.origin.orientation.y = 0.0
    message.origin.orientation.z, message.origin.orientation.w = 0.0, 1.0


def _array(code: str, values: NDArray[Any]) -> array.array[Any]:
    return array.array(code, values.tobytes())
