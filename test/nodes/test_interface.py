# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""RViz's configuration and docs/interface.md against the graph of the running nodes."""

import re
from contextlib import ExitStack

import numpy as np
import pytest
import yaml
from bag_writer import odometry, rclpy_type
from geometry_msgs.msg import PoseArray, PoseStamped, TransformStamped
from grid_messages import grid
from node_client import LATCHED, PATIENCE, Client, node_process
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from repository import ROOT
from sensor_msgs.msg import PointCloud2
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker

CONFIG = ROOT / "rviz" / "heightmap25d.rviz"
NODES = (
    "mapping", "planning", "localization", "exploration", "path_follower", "markers", "simulator",
)  # fmt: skip
TYPES = {
    "Map": "nav_msgs/msg/OccupancyGrid",
    "Marker": "visualization_msgs/msg/Marker",
    "Odometry": "nav_msgs/msg/Odometry",
    "Path": "nav_msgs/msg/Path",
    "PointCloud2": "sensor_msgs/msg/PointCloud2",
    "PoseArray": "geometry_msgs/msg/PoseArray",
    "PoseWithCovariance": "geometry_msgs/msg/PoseWithCovarianceStamped",
}
TOOLS = {
    "PublishPoint": "geometry_msgs/msg/PointStamped",
    "SetGoal": "geometry_msgs/msg/PoseStamped",
    "SetInitialPose": "geometry_msgs/msg/PoseWithCovarianceStamped",
}
# A laser and a lidar.
BOTH = "-p", "intake.scan_topics:=[scan]", "-p", "intake.cloud_topics:=[points]"
SOURCES = {"mapping": BOTH, "localization": BOTH}
# Parameters, logs, types; life cycle; diagnostics.
OF_EVERY_NODE = (
    "rcl_interfaces/", "type_description_interfaces/", "lifecycle_msgs/", "diagnostic_msgs/",
)  # fmt: skip
# What is there only where these are installed.
OF_OTHERS = ("action_msgs/", "map_msgs/", "nav2_msgs/")


def entries(kind, types):
    """Of displays or tools: name of the class without its package, and the topic's properties."""
    listed = yaml.safe_load(CONFIG.read_text())["Visualization Manager"][kind]
    named = [(entry["Class"].rpartition("/")[2], entry.get("Topic")) for entry in listed]
    return [(types[name], topic) for name, topic in named if topic is not None]


@pytest.fixture(scope="module")
def graph():
    client = Client()
    with ExitStack() as stack:
        for name in NODES:
            stack.enter_context(node_process(name, *SOURCES.get(name, ())))
        for topic in ("odom", "markers/blocks", "planning/field", "exploration/status", "cmd_vel"):
            client.wait(lambda: client.node.count_publishers(topic) > 0, 3 * PATIENCE)  # noqa: B023
        client.wait(lambda: client.node.count_subscribers("initialpose") > 0, 3 * PATIENCE)
        client.wait_for_node()
        client.spin(0.5)
        yield client.node
    client.close()


def test_every_display_gets_what_our_nodes_publish(graph):
    displays = entries("Displays", TYPES)
    assert len(displays) == 10
    for kind, topic in displays:
        name = topic["Value"]
        offers = graph.get_publishers_info_by_topic(name)
        assert [offer.topic_type for offer in offers] == [kind], name
        offered = offers[0].qos_profile
        if topic["Durability Policy"] == "Transient Local":
            assert offered.durability is DurabilityPolicy.TRANSIENT_LOCAL, name
        if topic["Reliability Policy"] == "Reliable":
            assert offered.reliability is ReliabilityPolicy.RELIABLE, name


def test_goal_and_initial_pose_go_where_our_nodes_listen(graph):
    tools = entries("Tools", TOOLS)
    assert {topic["Value"] for _, topic in tools} == {
        "/goal_pose",
        "/initialpose",
        "/clicked_point",
    }
    for kind, topic in tools:
        listeners = graph.get_subscriptions_info_by_topic(topic["Value"])
        assert [listener.topic_type for listener in listeners] == [kind]


def documented(node):
    """(direction, name without ~, type) of the tables of docs/interface.md."""
    page = (ROOT / "docs" / "interface.md").read_text()
    section = page.partition(f"\n## {node}\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (in|out|service) \| `([^`]+)` \| `([^`]+)` .*\|$", section, re.M)
    return {(way, absolute(node, name), kind) for way, name, kind in rows}


def absolute(node, name):
    return name if name.startswith("/") else "/" + name.replace("~", node)


@pytest.mark.parametrize("node", NODES)
def test_interface_page_tells_what_a_node_has(graph, node):
    found = {
        (way, name, kind)
        for way, listed in (
            ("in", graph.get_subscriber_names_and_types_by_node(node, "/")),
            ("out", graph.get_publisher_names_and_types_by_node(node, "/")),
            ("service", graph.get_service_names_and_types_by_node(node, "/")),
        )
        for name, (kind,) in listed
        if not kind.startswith(OF_EVERY_NODE + OF_OTHERS) and "/_action/" not in name
    }
    assert found == documented(node)


def test_blocks_and_frontier_come_to_whoever_subscribes():
    client = Client("/shown")
    heights = np.zeros((8, 8))
    heights[4, 4] = 30.0
    heights[:, 7] = np.nan
    with node_process("markers", namespace="/shown"):
        client.publish("height_grid", grid(heights), LATCHED)
        client.spin(1.5)  # nobody has subscribed yet
        client.subscribe("markers/blocks", Marker)
        client.subscribe("markers/frontier", PointCloud2)
        client.wait(lambda: len(client.newest) == 2)
        blocks, frontier = client.newest["markers/blocks"], client.newest["markers/frontier"]
        assert blocks.header.frame_id == frontier.header.frame_id == "map"
        assert blocks.type == Marker.TRIANGLE_LIST
        # 56 tops and the four sides of the block, two triangles each; a colour for a triangle.
        assert len(blocks.points) == 3 * len(blocks.colors) == 3 * 2 * 60
        assert max(point.z for point in blocks.points) == pytest.approx(0.3)
        assert frontier.width == 26  # the border of 7 x 8 cells
        higher = grid(heights + 50.0)
        client.publish("height_grid", higher, LATCHED)
        client.wait(lambda: max(p.z for p in client.newest["markers/blocks"].points) > 0.7)
        # A broken one is left out, and the node goes on.
        broken = grid(heights)
        broken.height = higher.height[:3]
        client.publish("height_grid", broken, LATCHED)
        client.spin(1.2)
        client.publish("height_grid", grid(heights + 100.0), LATCHED)
        client.wait(lambda: max(p.z for p in client.newest["markers/blocks"].points) > 1.2)
    client.close()


def test_far_from_zero_blocks_and_frontier_are_told_near_an_offset():
    place = 500_000.0, 4_500_000.0, 2500.0
    anchor = TransformStamped(child_frame_id="map_anchor")
    anchor.header.frame_id = "map"
    offset = anchor.transform.translation
    offset.x, offset.y, offset.z = place
    anchor.transform.rotation.w = 1.0
    message = grid(np.array([[0.0, 30.0], [np.nan, 0.0]]), place[:2])
    message.info.origin.position.z = place[2]
    client = Client("/far")
    client.subscribe("markers/blocks", Marker)
    client.subscribe("markers/frontier", PointCloud2)
    with node_process("markers", namespace="/far"):
        client.publish("/tf_static", TFMessage(transforms=[anchor]), LATCHED)
        client.spin(0.5)
        client.publish("height_grid", message, LATCHED)
        client.wait(lambda: len(client.newest) == 2)
    client.close()
    blocks, frontier = client.newest["markers/blocks"], client.newest["markers/frontier"]
    assert (blocks.header.frame_id, frontier.header.frame_id) == ("map", "map_anchor")
    position = blocks.pose.position
    assert (position.x, position.y, position.z) == place
    assert {point.x for point in blocks.points} == {0.0, 0.125, 0.25}
    assert max(point.z for point in blocks.points) == pytest.approx(0.3)
    cloud = np.frombuffer(frontier.data.tobytes(), np.float32).reshape(-1, 4)
    np.testing.assert_allclose(cloud[:, 2], 0.0)
    np.testing.assert_array_equal(cloud[:, :2], [[0.0625, 0.0625], [0.1875, 0.1875]])


def test_field_of_the_plan_is_published_to_whoever_subscribes():
    client = Client("/field")
    with node_process("planning", namespace="/field"):
        client.publish("height_grid", grid(np.zeros((80, 160))), LATCHED)
        client.publish("odom", odometry(10**9, (2.0, 5.0, 0.0), type_of=rclpy_type))
        goal = PoseStamped()
        goal.header.frame_id = "map"
        goal.pose.position.x, goal.pose.position.y = 18.0, 5.0
        client.publish("goal_pose", goal)
        client.subscribe("planning/field", PoseArray)
        client.wait(lambda: "planning/field" in client.newest)
        poses = client.newest["planning/field"].poses
        assert client.newest["planning/field"].header.frame_id == "map"
        assert len(poses) > 300
        west = [p for p in poses if p.position.x < 10.0 and abs(p.position.y - 5.0) < 1.0]
        assert west
        assert all(p.orientation.w > 0.9 for p in west)  # to the east
    client.close()
