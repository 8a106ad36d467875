# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Why a cell is what it is, asked of the mapping node over DDS."""

import numpy as np
from geometry_msgs.msg import PointStamped
from node_client import Client, mapping_node
from visualization_msgs.msg import Marker

from heightmap25d_msgs.srv import Explain
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.terrain.traversability import to_obstacle_map


def point(x, y, frame="map"):
    message = PointStamped()
    message.header.frame_id = frame
    message.point.x, message.point.y = x, y
    return message


def test_the_service_and_a_click_tell_of_a_wall(tmp_path):
    metres = np.zeros((20, 20))
    metres[:, 10:12] = 0.6
    wall = HeightMap.from_metres(metres)
    map_directory.save(tmp_path / "maps" / "wall", wall, to_obstacle_map(wall), "map")
    client = Client("/asked")
    client.subscribe("mapping/explanation", Marker)
    arguments = "-p", "mapping.initial_map:=wall"
    with mapping_node(tmp_path / "maps", *arguments, namespace="/asked"):
        answer = client.call("mapping/explain", Explain, point=point(1.3, 1.3))
        assert answer.success
        assert (answer.rule, answer.occupancy, answer.cost) == ("step", 100, 100)
        assert (round(answer.value, 3), answer.limit, answer.frame_id) == (0.6, 0.1, "map")
        assert (answer.position.x, answer.position.z) == (1.3125, 0.6)
        assert answer.because_of.x == 1.1875
        refused = client.call("mapping/explain", Explain, point=point(0.0, 0.0, "lidar"))
        assert (refused.success, refused.message) == (
            False, "header.frame_id: is 'lidar', not 'map'"
        )  # fmt: skip
        nowhere = client.call("mapping/explain", Explain, point=point(np.nan, 0.0))
        assert nowhere.message.startswith("point: (nan, 0.0, 0.0) is not a place")
        client.publish("clicked_point", point(50.0, 1.3))
        client.wait(lambda: "mapping/explanation" in client.newest)
        far = client.newest.pop("mapping/explanation")
        assert "unknown, no return has ended here" in far.text
        client.publish("clicked_point", point(1.0, 1.3))
        client.wait(lambda: "mapping/explanation" in client.newest)
    client.close()
    marker = client.newest["mapping/explanation"]
    assert marker.type == Marker.TEXT_VIEW_FACING
    assert "free, but 0.25 m from (1.31, 1.31), robot_radius is 0.50 m;\n" in marker.text
    assert (marker.pose.position.x, marker.header.frame_id) == (1.0625, "map")
