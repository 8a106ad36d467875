# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The markers node: a height grid in; blocks and the frontier of the known out, for RViz."""

from __future__ import annotations

import sys
from typing import Any

from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker

from heightmap25d_msgs.msg import HeightGrid, UpperSurfaces
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import HeightMap, local_origin
from heightmap25d_ros.io import decode, encode
from heightmap25d_ros.nodes import qos, runtime
from heightmap25d_ros.nodes.interface import Input, Output
from heightmap25d_ros.nodes.lifecycle import ManagedNode
from heightmap25d_ros.nodes.map_source import map_inputs
from heightmap25d_ros.nodes.map_transform import anchor_frame
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.level_map import LevelMap
from heightmap25d_ros.terrain.traversability import to_obstacle_map
from heightmap25d_ros.viz import marker_cdr, markers

_PERIOD = 1.0  # [s] between two looks at what is new


class MarkersNode(ManagedNode):
    """Shows the newest height grid, once a second at most and only to subscribers."""

    NAME = "markers"
    PARAMETERS = ("traversability",)

    def inputs(self) -> list[Input]:
        """The map, and its frame for coordinates in single precision."""
        return [
            *map_inputs(self, self._on_map, self._on_map_update, self._on_upper_surfaces),
            Input(TFMessage, "/tf_static", self._on_transforms, qos.STATIC_TRANSFORMS),
        ]

    def outputs(self) -> list[Output]:
        """What RViz shows of it."""
        return [
            Output(Marker, "~/blocks", qos.LATCHED),
            Output(PointCloud2, "~/frontier", qos.LATCHED),
        ]

    def set_up(self) -> None:
        """Begin without a map."""
        self._dropped = Drops()
        self._levels = LevelMap(None, self._dropped)
        self._newest: HeightMap | None = None
        self._header = Header()
        self._shown: dict[str, HeightMap] = {}
        self._anchors: dict[str, Array] = {}  # their positions in their parents, by name

    def start(self) -> None:
        """Show the map now and then."""
        self.create_wall_timer(_PERIOD, self._show)

    @property
    def dropped(self) -> Drops:
        """How many messages were not used, by reason."""
        return self._dropped

    def figures(self) -> dict[str, Any]:
        """How many viewers there are."""
        return {
            f"{topic.removeprefix('~/')} [subscribers]": publisher.get_subscription_count()
            for topic, publisher in self.publishers_by_topic.items()
        }

    def _on_map(self, message: HeightGrid) -> None:
        self._use(self._levels.take_lowest(message), message.header)

    def _on_map_update(self, message: HeightGrid) -> None:
        self._use(self._levels.take_update(message), message.header)

    def _on_upper_surfaces(self, message: UpperSurfaces) -> None:
        self._use(self._levels.take_upper(message), message.header)

    def _use(self, height_map: HeightMap | None, header: Header) -> None:
        """Show a map from now on, where there is one."""
        if height_map is not None:
            self._newest, self._header = height_map, header

    def _on_transforms(self, message: TFMessage) -> None:
        heard = self._dropped.decoded("transforms", decode.transforms, message.transforms)
        for transform in heard or ():
            if transform.child == anchor_frame(transform.parent):
                self._anchors[transform.child] = transform.T[:3, 3]

    def _show(self) -> None:
        height_map = self._newest
        if height_map is None:
            return
        for topic, content in (("~/blocks", self._blocks), ("~/frontier", self._frontier)):
            if self.has_subscribers(topic) and self._shown.get(topic) is not height_map:
                self._shown[topic] = height_map
                shown = self._dropped.decoded("map", content, height_map)
                if shown is not None:
                    self.publish(topic, shown)

    def _frontier(self, height_map: HeightMap) -> PointCloud2:
        obstacles = to_obstacle_map(height_map, self.params.traversability)
        frame, stamp = self._header.frame_id, decode.stamp_ns(self._header)
        origin = self._anchors.get(anchor_frame(frame))
        if origin is not None and origin.any():
            frame = anchor_frame(frame)
        cloud = PointCloud2()
        shown = markers.frontier(height_map, obstacles)
        encode.fill_height_points(cloud, PointField, shown, stamp, frame, origin)
        return cloud

    def _blocks(self, height_map: HeightMap) -> bytes:
        corners, colours = markers.blocks(height_map)
        geometry = height_map.geometry
        origin = local_origin((*geometry.origin, geometry.ground_zero))
        marker = Marker(header=self._header, ns="blocks", type=Marker.TRIANGLE_LIST)
        marker.scale.x = marker.scale.y = marker.scale.z = 1.0
        marker.color.a = 1.0
        # RViz takes the pose in double precision, and the points in single.
        place = marker.pose.position
        place.x, place.y, place.z = origin.tolist()
        return marker_cdr.with_faces(marker, serialize_message(marker), corners - origin, colours)


def main() -> int:
    """Run the node."""
    return runtime.run(MarkersNode)


if __name__ == "__main__":
    sys.exit(main())
