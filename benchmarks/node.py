# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mapping node under two lasers: CPU, latency, drops.

    python benchmarks/node.py

The node runs in a process of its own (`measured_node.py`: the product's node, with a clock at
the place where a scan has been merged); this process replays bags/ramp in real time, two lasers of
361 beams at 37.5 Hz each, and then those of `fast_lasers`: 1081 beams at 75 Hz each, with odometry
at 200 Hz. Latency is from the call that publishes a scan, whose last beam is as old as that, to the
cells: most of it is waiting for the odometry that brackets the scan. The last scan of the bag has
none.
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

import fast_lasers
import numpy as np
import rclpy
from nav_msgs.msg import OccupancyGrid, Odometry
from process_cpu import cpu_seconds
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import LaserScan, PointCloud2
from tf2_msgs.msg import TFMessage

from heightmap25d_msgs.msg import HeightGrid
from heightmap25d_ros.io.bag import Bag

RAMP = Path(__file__).parent.parent / "bags" / "ramp"
TYPES = {"/scan": LaserScan, "/scan_down": LaserScan, "/odom": Odometry, "/tf_static": TFMessage}
MAPS = {
    "height_grid": HeightGrid,
    "map": OccupancyGrid,
    "cost_map": OccupancyGrid,
    "height_points": PointCloud2,
}
Played = tuple[int, str, bytes]
"""When a message was recorded [ns], its topic, and its bytes."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def measure() -> dict[str, float]:
    """With and without somebody who listens to the maps."""
    os.environ["ROS_DOMAIN_ID"] = str(os.getpid() % 100 + 1)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    rclpy.init()
    figures: dict[str, float] = {}
    drive = _drive()
    static = [message for message in drive if message[1] == "/tf_static"]
    for name, executor, listened, played in (
        ("nobody listens", "events", {}, drive),
        ("four maps at 2 Hz", "events", MAPS, drive),
        ("rclpy's default executor", "default", {}, drive),
        ("fast lasers", "events", {}, static + fast_lasers.messages()),
    ):
        for figure, value in _run(executor, listened, played).items():
            figures[f"{name}: {figure}"] = value
    rclpy.shutdown()
    return figures


def _drive() -> list[Played]:
    with Bag(RAMP) as bag:
        return [(event.stamp_ns, event.topic, event.data) for event in bag.raw_events(list(TYPES))]


def _run(executor: str, listened: dict[str, Any], played: list[Played]) -> dict[str, float]:
    node = rclpy.create_node("benchmark")
    received: list[str] = []
    for topic, kind in listened.items():
        node.create_subscription(
            kind, topic, lambda _, topic=topic: received.append(topic), LATCHED, raw=True
        )
    with tempfile.TemporaryDirectory() as directory:
        file = Path(directory) / "merged.json"
        process = subprocess.Popen(
            [sys.executable, Path(__file__).with_name("measured_node.py"), str(file), executor]
        )
        publishers = _publishers(node)
        cpu_before = cpu_seconds(process.pid)
        published, seconds = _publish(node, publishers, played)
        used = cpu_seconds(process.pid) - cpu_before
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        process.wait(timeout=30)
        merged = json.loads(file.read_text())
    node.destroy_node()
    latency = [
        1e3 * (merged["merged"][key] - sent)
        for key, sent in published.items()
        if key in merged["merged"]
    ]
    p50, p99 = np.percentile(latency, [50, 99])
    figures = {
        "CPU [s per s]": used / seconds,
        "latency p50 [ms]": float(p50),
        "latency p99 [ms]": float(p99),
        "scans published": len(published),
        "scans not merged": len(published) - len(latency),
        "messages dropped": merged["dropped"],
    }
    if listened:
        figures["maps received [1/s]"] = len(received) / seconds / len(listened)
    return figures


def _publishers(node: Node) -> dict[str, Any]:
    """Publishers that the measured node listens to, when it does."""
    publishers: dict[str, Any] = {
        topic: node.create_publisher(kind, topic, _profile(topic)) for topic, kind in TYPES.items()
    }
    while not all(publisher.get_subscription_count() for publisher in publishers.values()):
        time.sleep(0.05)
    time.sleep(1.0)
    return publishers


def _publish(
    node: Node, publishers: dict[str, Any], played: list[Played]
) -> tuple[dict[str, float], float]:
    """Play messages in real time; when each scan was published, by topic and stamp."""
    published: dict[str, float] = {}
    began = time.time()
    for stamp_ns, topic, data in played:
        due = began + (stamp_ns - played[0][0]) * 1e-9
        time.sleep(max(due - time.time(), 0.0))
        if topic.startswith("/scan"):
            published[f"{topic} {_stamp_ns(data)}"] = time.time()
        publishers[topic].publish(data)
        rclpy.spin_once(node, timeout_sec=0.0)
    return published, time.time() - began


def _profile(topic: str) -> QoSProfile:
    if topic == "/tf_static":
        return LATCHED
    return qos_profile_sensor_data if topic.startswith("/scan") else QoSProfile(depth=100)


def _stamp_ns(data: bytes) -> int:
    """Of the header at the beginning of a serialized message (CDR, little-endian)."""
    sec, nanosec = np.frombuffer(data[4:12], "<u4").tolist()
    return sec * 10**9 + nanosec


if __name__ == "__main__":
    for figure, value in measure().items():
        print(f"{figure:45} {value:,.4g}")
