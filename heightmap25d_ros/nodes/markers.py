# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The markers node: a height grid in; blocks and the frontier of the known out, for RViz."""

from __future__ import annotations

import sys
from typing import Any

from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2, PointField
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker

from heightmap25d_msgs.msg import HeightGrid, UpperSurfaces
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import local_origin
from heightmap25d_ros.io import decode, encode
from heightmap25d_ros.nodes import qos, runtime
from heightmap25d_ros.nodes.interface import Input, Output
from heightmap25d_ros.nodes.lifecycle import ManagedNode
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
            Input(UpperSurfaces, "upper_surfaces", self._on_upper_surfaces, qos.LATCHED),
            Input(HeightGrid, "height_grid", self._on_map, qos.LATCHED, is_needed=True),
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
        self._newest: HeightGrid | None = None
        self._upper: UpperSurfaces | None = None
        self._shown: dict[str, HeightGrid] = {}
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
        self._newest = message

    def _on_upper_surfaces(self, message: UpperSurfaces) -> None:
        self._upper = message
        self._shown.clear()

    def _on_transforms(self, message: TFMessage) -> None:
        heard = self._dropped.decoded("transforms", decode.transforms, message.transforms)
        for transform in heard or ():
            if transform.child == anchor_frame(transform.parent):
                self._anchors[transform.child] = transform.T[:3, 3]

    def _show(self) -> None:
        grid = self._newest
        if grid is None:
            return
        for topic, content in (("~/blocks", self._blocks), ("~/frontier", self._frontier)):
            if self.has_subscribers(topic) and self._shown.get(topic) is not grid:
                self._shown[topic] = grid
                shown = self._dropped.decoded("map", content, grid)
                if shown is not None:
                    self.publish(topic, shown)

    def _frontier(self, grid: HeightGrid) -> PointCloud2:
        height_map, stamp = decode.height_map(grid), decode.stamp_ns(grid.header)
        obstacles = to_obstacle_map(height_map, self.params.traversability)
        frame = grid.header.frame_id
        origin = self._anchors.get(anchor_frame(frame))
        if origin is not None and origin.any():
            frame = anchor_frame(frame)
        cloud = PointCloud2()
        shown = markers.frontier(height_map, obstacles)
        encode.fill_height_points(cloud, PointField, shown, stamp, frame, origin)
        return cloud

    def _blocks(self, grid: HeightGrid) -> bytes:
        levels = LevelMap(None, self._dropped)
        if self._upper is not None:
            levels.take_upper(self._upper)
        height_map = levels.take_lowest(grid) or decode.height_map(grid)
        corners, colours = markers.blocks(height_map)
        geometry = height_map.geometry
        origin = local_origin((*geometry.origin, geometry.ground_zero))
        marker = Marker(header=grid.header, ns="blocks", type=Marker.TRIANGLE_LIST)
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
