# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The topics on which a map is published, and their messages."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from nav_msgs.msg import OccupancyGrid
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Float32MultiArray, MultiArrayDimension

from heightmap25d_msgs.msg import HeightGrid, LocalizationLayers, UpperSurfaces
from heightmap25d_ros.grid.height_map import Area, HeightMap
from heightmap25d_ros.grid.levels import UpperSurfaces as Surfaces
from heightmap25d_ros.io import encode
from heightmap25d_ros.localization.layers import LayerMap
from heightmap25d_ros.nodes.map_transform import AnchorTransform
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.terrain.traversability import ObstacleMap

try:
    from grid_map_msgs.msg import GridMap
except ImportError:
    GridMap = None

try:
    from map_msgs.msg import OccupancyGridUpdate
except ImportError:
    OccupancyGridUpdate = None

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

UPDATED_TOPICS = {"height_grid": HeightGrid}
"""The topics of which updates are published, and the type of these."""

if UPDATE is not None:
    UPDATED_TOPICS |= {"map": UPDATE, "cost_map": UPDATE}


class Content:
    """What is published of an area of the map; each part is made when a message needs it.

    Parameters
    ----------
    mapping : Mapping
    area : Area
        Of the grid.
    """

    def __init__(self, mapping: Mapping, area: Area) -> None:
        self._mapping, self.area = mapping, area
        self.geometry = mapping.grid.geometry.part(area)

    @cached_property
    def heights(self) -> HeightMap:
        """The heights."""
        return self._mapping.heights(self.area)

    @cached_property
    def obstacles(self) -> ObstacleMap:
        """What they are converted to."""
        return self._mapping.obstacles(self.area)

    @property
    def upper(self) -> Surfaces:
        """The surfaces above the lowest ones."""
        return self._mapping.upper(self.area)

    @property
    def probability_threshold(self) -> float:
        """Below which a cell is unknown."""
        return self._mapping.probability_threshold


def message_of(
    topic: str, content: Content, stamp: int, frame: str, anchor: AnchorTransform, loaded: int
) -> Any:
    """The message of one of `TOPICS`, but for `LAYERS`.

    Parameters
    ----------
    topic : str
    content : Content
    stamp : int [ns]
    frame : str
        Of the map.
    anchor : AnchorTransform
        Frame and position of points in single precision.
    loaded : int [ns]
        When all of the map is published, which tells it and its updates apart from others.
    """
    message = TOPICS[topic]()
    if topic == "upper_surfaces":
        encode.fill_upper_surfaces(message, content, stamp, frame)
    elif topic == "height_grid":
        encode.fill_height_grid(message, content.heights, stamp, frame, loaded=loaded)
    elif topic == "height_points":
        encode.fill_height_points(
            message, PointField, content.heights, stamp, anchor.frame, anchor.origin
        )
    elif topic == "grid_map":
        encode.fill_grid_map(
            message, Float32MultiArray, MultiArrayDimension, content.heights, stamp, frame
        )
    else:
        cells = _occupancy(topic, content.obstacles)
        encode.fill_occupancy_grid(message, cells, content.geometry, stamp, frame)
    return message


def layers_message(layers: LayerMap, stamp: int, frame: str) -> LocalizationLayers:
    """The message of the localization layers at a stamp [ns]."""
    message = LocalizationLayers()
    encode.fill_localization_layers(message, layers, stamp, frame)
    return message


def update_of(topic: str, part: Content, whole: Area, stamp: int, frame: str, loaded: int) -> Any:
    """The update of one of `UPDATED_TOPICS`.

    Parameters
    ----------
    topic : str
    part : Content
        The cells that are replaced.
    whole : Area
        Of the grid: the cells of the whole map.
    stamp : int [ns]
    frame : str
        Of the map.
    loaded : int [ns]
        When all of the map was published.
    """
    message = UPDATED_TOPICS[topic]()
    if topic == "height_grid":
        encode.fill_height_grid(message, part.heights, stamp, frame, loaded=loaded)
    else:
        corner = part.area.iy - whole.iy, part.area.ix - whole.ix
        cells = _occupancy(topic, part.obstacles)
        encode.fill_occupancy_grid_update(message, cells, corner, stamp, frame)
    return message


def _occupancy(topic: str, obstacle_map: ObstacleMap) -> NDArray[np.int8]:
    """(rows, columns) int8: the cells of ``map`` or of ``cost_map``."""
    return obstacle_map.occupancy if topic == "map" else obstacle_map.cost
