# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The topics on which a map is published, and their messages."""

from __future__ import annotations

from typing import Any

import numpy as np
from nav_msgs.msg import OccupancyGrid
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Float32MultiArray, MultiArrayDimension

from heightmap25d_msgs.msg import HeightGrid, LocalizationLayers, UpperSurfaces
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import encode
from heightmap25d_ros.localization.layers import LayerMap
from heightmap25d_ros.nodes.map_transform import AnchorTransform
from heightmap25d_ros.terrain.traversability import ObstacleMap

try:
    from grid_map_msgs.msg import GridMap
except ImportError:
    GridMap = None

try:
    from map_msgs.msg import OccupancyGridUpdate
except ImportError:
    OccupancyGridUpdate = None

Maps = tuple[HeightMap, ObstacleMap]

LAYERS = "localization_layers"

TOPICS = {
    LAYERS: LocalizationLayers,  # these before the grid of the same stamp, with which they are read
    "upper_surfaces": UpperSurfaces,
    "height_grid": HeightGrid,
    "map": OccupancyGrid,
    "cost_map": OccupancyGrid,
    "height_points": PointCloud2,
}
"""Type of the message of each topic."""

if GridMap is not None:
    TOPICS["grid_map"] = GridMap


UPDATE = OccupancyGridUpdate
"""Type of an update of a map; None where map_msgs is not installed."""

UPDATED_TOPICS = () if UPDATE is None else ("map", "cost_map")
"""The topics of which updates are published."""


def message_of(topic: str, maps: Maps, stamp: int, frame: str, anchor: AnchorTransform) -> Any:
    """The message of one of `TOPICS`, but for `LAYERS`.

    Parameters
    ----------
    topic : str
    maps : (HeightMap, ObstacleMap)
        Of the same cells.
    stamp : int [ns]
    frame : str
        Of the map.
    anchor : AnchorTransform
        Frame and position of points in single precision.
    """
    height_map, obstacle_map = maps
    message = TOPICS[topic]()
    if topic == "upper_surfaces":
        encode.fill_upper_surfaces(message, height_map, stamp, frame)
    elif topic == "height_grid":
        encode.fill_height_grid(message, height_map, stamp, frame)
    elif topic == "height_points":
        encode.fill_height_points(
            message, PointField, height_map, stamp, anchor.frame, anchor.origin
        )
    elif topic == "grid_map":
        encode.fill_grid_map(
            message, Float32MultiArray, MultiArrayDimension, height_map, stamp, frame
        )
    else:
        cells = _occupancy(topic, obstacle_map)
        encode.fill_occupancy_grid(message, cells, height_map.geometry, stamp, frame)
    return message


def layers_message(layers: LayerMap, stamp: int, frame: str) -> LocalizationLayers:
    """The message of the localization layers at a stamp [ns]."""
    message = LocalizationLayers()
    encode.fill_localization_layers(message, layers, stamp, frame)
    return message


def update_of(
    topic: str, part: ObstacleMap, corner: tuple[int, int], stamp: int, frame: str
) -> Any:
    """The map_msgs/OccupancyGridUpdate of one of `UPDATED_TOPICS`.

    Parameters
    ----------
    topic : str
    part : ObstacleMap
        The cells that are replaced.
    corner : (row, column)
        Of the first of them in the whole map.
    stamp : int [ns]
    frame : str
        Of the map.
    """
    message = UPDATE()
    encode.fill_occupancy_grid_update(message, _occupancy(topic, part), corner, stamp, frame)
    return message


def _occupancy(topic: str, obstacle_map: ObstacleMap) -> NDArray[np.int8]:
    """(rows, columns) int8: the cells of ``map`` or of ``cost_map``."""
    return obstacle_map.occupancy if topic == "map" else obstacle_map.cost
