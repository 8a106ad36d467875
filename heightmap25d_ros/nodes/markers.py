# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The markers node: a height grid in; blocks and the frontier of the known out, for RViz."""

from __future__ import annotations

import sys
from collections import Counter
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2, PointField
from visualization_msgs.msg import Marker

from heightmap25d_msgs.msg import HeightGrid
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import decode, encode
from heightmap25d_ros.nodes import qos, runtime
from heightmap25d_ros.nodes.lifecycle import ManagedNode
from heightmap25d_ros.terrain.traversability import to_obstacle_map
from heightmap25d_ros.viz import marker_cdr, markers

_PERIOD = 1.0  # [s] between two looks at what is new


class MarkersNode(ManagedNode):
    """Thin: shows the newest height grid, once a second at most and only to who subscribes."""

    def __init__(self) -> None:
        super().__init__("markers")

    def set_up(self) -> None:
        """Make what shows the map."""
        self._dropped: Counter[str] = Counter()
        self._newest: HeightGrid | None = None
        self._shown: dict[str, HeightGrid] = {}
        self._outlets = {
            "blocks": self.create_lifecycle_publisher(Marker, "~/blocks", qos.LATCHED),
            "frontier": self.create_lifecycle_publisher(PointCloud2, "~/frontier", qos.LATCHED),
        }

    def start(self) -> None:
        """Hear the map, and show it."""
        self.subscribe(HeightGrid, "height_grid", self._on_map, qos.LATCHED, is_needed=True)
        wall_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_PERIOD, self._show, clock=wall_clock)

    @property
    def dropped(self) -> Counter[str]:
        """How many messages were not used, by reason."""
        return self._dropped

    def figures(self) -> dict[str, Any]:
        """What /diagnostics tells of the viewers."""
        return {name: outlet.get_subscription_count() for name, outlet in self._outlets.items()}

    def _on_map(self, message: HeightGrid) -> None:
        self._newest = message

    def _show(self) -> None:
        if self._newest is None:
            return
        for name, outlet in self._outlets.items():
            if outlet.get_subscription_count() and self._shown.get(name) is not self._newest:
                self._shown[name] = self._newest
                try:
                    outlet.publish(self._content(name, self._newest))
                except InputError as error:
                    self._dropped[f"map: bad {str(error).partition(':')[0]}"] += 1

    def _content(self, name: str, grid: HeightGrid) -> bytes | PointCloud2:
        height_map, stamp = decode.height_map(grid), decode.stamp_ns(grid.header)
        if name == "frontier":
            cloud = PointCloud2()
            edge = markers.frontier(
                height_map, to_obstacle_map(height_map, self.params.traversability)
            )
            encode.fill_height_points(cloud, PointField, edge, stamp, grid.header.frame_id)
            return cloud
        marker = Marker(header=grid.header, ns="blocks", type=Marker.TRIANGLE_LIST)
        marker.scale.x = marker.scale.y = marker.scale.z = 1.0
        marker.color.a = 1.0
        corners, colours = markers.blocks(height_map)
        return marker_cdr.with_faces(marker, serialize_message(marker), corners, colours)


def main() -> int:
    """Run the node."""
    return runtime.run(MarkersNode)


if __name__ == "__main__":
    sys.exit(main())
