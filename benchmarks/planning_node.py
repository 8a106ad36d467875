# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The planning node over DDS: from a goal to its path, on a map of 1024 x 1024 cells.

    python benchmarks/planning_node.py

The node runs in a process of its own; this process publishes the map once, where the robot is
once, and goals one after the other, to random places that can be reached. Latency is from the
call that publishes a goal to the path in this process, deserialized. The node searches the whole
field for each goal, which then guides the robot wherever it is. The map is converted when the
first goal asks for it: that one is not among the others.
"""

from __future__ import annotations

import array
import math
import os
import signal
import subprocess
import sys
import time
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from terrains import rolling_terrain

from heightmap25d_msgs.msg import HeightGrid, PlanStatus
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, PROBABILITY_SCALE, Cell, HeightMap
from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.planning.graph import transition_graph
from heightmap25d_ros.planning.search import UNREACHABLE, cost_to_go

SIDE = 1024
GOALS = 100
PATIENCE = 60.0
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def measure() -> dict[str, float]:
    """Latencies in milliseconds."""
    os.environ["ROS_DOMAIN_ID"] = str((os.getpid() + 50) % 100 + 1)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    rclpy.init()
    node = rclpy.create_node("planning_benchmark")
    process = subprocess.Popen([sys.executable, "-m", "heightmap25d_ros.nodes.planning"])
    try:
        return _measured(node)
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(timeout=30)
        node.destroy_node()
        rclpy.shutdown()


def _measured(node: Node) -> dict[str, float]:
    height_map = rolling_terrain(SIDE)
    start, goals = _places(height_map)
    paths: list[Path] = []
    states: list[PlanStatus] = []
    subscriptions = [
        node.create_subscription(Path, "plan", paths.append, LATCHED),
        node.create_subscription(PlanStatus, "planning/status", states.append, LATCHED),
    ]
    maps = node.create_publisher(HeightGrid, "height_grid", LATCHED)
    odometry = node.create_publisher(Odometry, "odom", 10)
    asked = node.create_publisher(PoseStamped, "goal_pose", 10)
    end = time.monotonic() + PATIENCE
    while not all(publisher.get_subscription_count() for publisher in (maps, odometry, asked)):
        _spin(node, end)
    while not all(node.count_publishers(each.topic_name) for each in subscriptions):
        _spin(node, end)
    time.sleep(1.0)
    maps.publish(_map_message(height_map))
    odometry.publish(_odometry_message(height_map, start))
    time.sleep(2.0)
    latency, planned, missing = [], [], 0
    for goal in goals:
        message = _goal_message(height_map, goal)
        paths.clear()
        states.clear()
        end = time.monotonic() + PATIENCE
        began = time.perf_counter()
        asked.publish(message)
        while not paths:
            _spin(node, end)
        latency.append(1e3 * (time.perf_counter() - began))
        while not states:
            _spin(node, end)
        planned.append(1e3 * states[0].planning_time)
        missing += not paths[0].poses
    p50, p99 = np.percentile(latency[1:], [50, 99])
    return {
        "goals": len(goals) - 1,
        "goals without a path": missing,
        "first goal, with the map's conversion [ms]": latency[0],
        "goal -> path p50 [ms]": float(p50),
        "goal -> path p99 [ms]": float(p99),
        "of which planning p50 [ms]": float(np.median(planned[1:])),
    }


def _spin(node: Node, end: float) -> None:
    if time.monotonic() > end:
        raise TimeoutError("the planning node does not answer")
    rclpy.spin_once(node, timeout_sec=0.1)


def _places(height_map: HeightMap) -> tuple[Cell, list[Cell]]:
    """Where the robot is, and one goal more than are counted."""
    graph = transition_graph(height_map, TraversabilityParams(), PlannerParams())
    free = np.argwhere(graph.enterable)
    middle = np.abs(free - SIDE // 2).max(axis=1).argmin()
    start = (int(free[middle, 0]), int(free[middle, 1]))
    reachable = np.argwhere(cost_to_go(graph.incoming, start).dense() != UNREACHABLE)
    chosen: NDArray[Any] = np.random.default_rng(7).choice(reachable, GOALS + 1, replace=False)
    return start, [(y, x) for y, x in chosen.tolist()]


def _map_message(height_map: HeightMap) -> HeightGrid:
    message = HeightGrid()
    message.header.frame_id = "map"
    message.info.resolution = height_map.geometry.resolution
    message.info.height, message.info.width = height_map.geometry.shape
    message.height_resolution = HEIGHT_RESOLUTION
    message.probability_threshold = height_map.probability_threshold
    message.height = array.array("h", height_map.height.tobytes())
    probability = height_map.probability // (PROBABILITY_SCALE // 255)
    message.probability = array.array("B", probability.astype(np.uint8).tobytes())
    return message


def _odometry_message(height_map: HeightMap, cell: Cell) -> Odometry:
    message = Odometry(child_frame_id="base_link")
    message.header.frame_id = "odom"
    position = message.pose.pose.position
    position.x, position.y = height_map.geometry.cell_center(cell).tolist()
    return message


def _goal_message(height_map: HeightMap, cell: Cell) -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id = "map"
    position, rotation = message.pose.position, message.pose.orientation
    position.x, position.y = height_map.geometry.cell_center(cell).tolist()
    yaw = math.atan2(position.y, position.x)
    rotation.z, rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return message


if __name__ == "__main__":
    for figure, value in measure().items():
        print(f"{figure:45} {value:,.4g}")
