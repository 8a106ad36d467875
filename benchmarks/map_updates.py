# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map of 4000 x 4000 cells with a robot that drives in it: whole maps against updates.

    python benchmarks/map_updates.py

The mapping node runs in a process of its own, with the large map loaded, and bags/ramp is replayed
into it in real time. This process subscribes to ``map`` and ``cost_map``, and to ``height_grid``,
each with and without their updates, and counts what comes. Those of the first two need map_msgs.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from nav_msgs.msg import OccupancyGrid
from process_cpu import cpu_seconds
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile

from heightmap25d_msgs.msg import HeightGrid
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.terrain.traversability import to_obstacle_map

try:
    from map_msgs.msg import OccupancyGridUpdate
except ImportError:
    OccupancyGridUpdate = None

RAMP = Path(__file__).parent.parent / "bags" / "ramp"
SIDE = 4000
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
UPDATES = QoSProfile(depth=100)
PATIENCE = 300.0  # [s] until the map is loaded, and until it is there


def measure() -> dict[str, float]:
    """CPU of the node, and bytes per second of its topics, for each kind of listener."""
    os.environ["ROS_DOMAIN_ID"] = str(os.getpid() % 100 + 1)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    whole: dict[str, Any] = {"map": OccupancyGrid, "cost_map": OccupancyGrid}
    updates = {f"{topic}_updates": OccupancyGridUpdate for topic in whole}
    heights = {"height_grid": HeightGrid}
    listeners = {"nobody": {}, "whole": whole, "heights": heights}
    if OccupancyGridUpdate is not None:
        listeners["updates"] = whole | updates
    listeners["updates of heights"] = heights | {"height_grid_updates": HeightGrid}
    rclpy.init()
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as directory:
        _save_map(Path(directory) / "large")
        for name, topics in listeners.items():
            for figure, value in _run(directory, topics).items():
                figures[f"{name}: {figure}"] = value
    rclpy.shutdown()
    return figures


def _save_map(path: Path) -> None:
    """Rolling ground, known everywhere, around the place of the bag's drive."""
    metres = 0.125 * np.arange(SIDE)
    ground = np.sin(metres / 7.0) * 0.3 + np.sin(metres / 9.0)[:, None] * 0.3
    origin = -0.0625 * SIDE, -0.0625 * SIDE
    height_map = HeightMap.from_metres(ground, resolution=0.125, origin=origin)
    map_directory.save(path, height_map, to_obstacle_map(height_map), "map")


def _run(directory: str, topics: dict[str, Any]) -> dict[str, float]:
    received: list[int] = []
    node = rclpy.create_node("listener")
    for topic, kind in topics.items():
        profile = UPDATES if topic.endswith("_updates") else LATCHED
        node.create_subscription(
            kind, topic, lambda data: received.append(len(data)), profile, raw=True
        )
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    parameters = {
        "mapping.map_directory": directory, "mapping.initial_map": "large",
        "intake.scan_topics": "[scan, scan_down]", "mapping.localization_layers": "false",
    }  # fmt: skip
    arguments = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    process = _start("mapping", "--ros-args", *arguments)
    _spin_until(executor, lambda: node.count_publishers("map") > 0)
    first = sum(not topic.endswith("_updates") for topic in topics)
    _spin_until(executor, lambda: len(received) >= first)
    _spin_until(executor, lambda: _is_idle(executor, process.pid))
    received.clear()
    played = _start("replay", str(RAMP), "--topics", "/scan", "/scan_down", "/odom", "/tf_static")
    _spin_until(executor, lambda: node.count_publishers("scan") > 0)
    began, cpu = time.monotonic(), cpu_seconds(process.pid)
    _spin_until(executor, lambda: played.poll() is not None)
    seconds, cpu = time.monotonic() - began, cpu_seconds(process.pid) - cpu
    process.send_signal(signal.SIGINT)
    process.wait()
    node.destroy_node()
    return {
        "CPU [s per s]": cpu / seconds,
        "received [MB/s]": sum(received) / seconds * 1e-6,
        "largest message [MB]": max(received, default=0) * 1e-6,
        "messages per second": len(received) / seconds,
    }


def _start(name: str, *arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", f"heightmap25d_ros.nodes.{name}", *arguments])


def _spin_until(executor: SingleThreadedExecutor, is_done: Any) -> None:
    end = time.monotonic() + PATIENCE
    while not is_done():
        if time.monotonic() > end:
            raise TimeoutError
        executor.spin_once(timeout_sec=0.05)


def _is_idle(executor: SingleThreadedExecutor, pid: int) -> bool:
    """Whether a process takes nearly no CPU for a second."""
    cpu, end = cpu_seconds(pid), time.monotonic() + 1.0
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    return cpu_seconds(pid) - cpu < 0.1


if __name__ == "__main__":
    print(json.dumps(measure(), indent=2))
