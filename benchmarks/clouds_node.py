# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mapping node under a lidar of 131,072 points at 10 Hz, over DDS: CPU, latency, drops.

    python benchmarks/clouds_node.py

The clouds of `clouds`, and odometry at 50 Hz, are published in real time; the node runs in a
process of its own (`measured_node.py`). A cloud is published when its sweep ends, and waits for the
next pose. Latency is from the call that publishes it to its last cell.
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

import clouds
import numpy as np
import rclpy
from nav_msgs.msg import Odometry
from process_cpu import cpu_seconds
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2

from heightmap25d_ros import se3

ARGUMENTS = (
    "-p", "intake.cloud_topics:=[points]",
    "-p", f"intake.cloud_mounts:={list(clouds.MOUNT)}",
)  # fmt: skip


def measure() -> dict[str, float]:
    """With nobody who listens to the maps."""
    os.environ["ROS_DOMAIN_ID"] = str(os.getpid() % 100 + 1)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    events = _events()
    rclpy.init()
    node = rclpy.create_node("benchmark")
    with tempfile.TemporaryDirectory() as directory:
        file = Path(directory) / "merged.json"
        process = subprocess.Popen(
            [sys.executable, Path(__file__).with_name("measured_node.py"), str(file), "events",
             *ARGUMENTS]
        )  # fmt: skip
        publishers = {
            "points": node.create_publisher(PointCloud2, "points", QoSProfile(depth=5)),
            "odom": node.create_publisher(Odometry, "odom", QoSProfile(depth=100)),
        }
        while not all(publisher.get_subscription_count() for publisher in publishers.values()):
            time.sleep(0.05)
        time.sleep(1.0)
        cpu_before = cpu_seconds(process.pid)
        published, seconds = _publish(publishers, events)
        used = cpu_seconds(process.pid) - cpu_before
        process.send_signal(signal.SIGINT)
        process.wait(timeout=30)
        merged = json.loads(file.read_text())
    node.destroy_node()
    rclpy.shutdown()
    latency = [
        1e3 * (merged["merged"][key] - sent)
        for key, sent in published.items()
        if key in merged["merged"]
    ]
    p50, p99 = np.percentile(latency, [50, 99])
    return {
        "clouds published": len(published),
        "clouds not merged": len(published) - len(latency),
        "messages dropped": merged["dropped"],
        "CPU [s per s]": used / seconds,
        "latency p50 [ms]": float(p50),
        "latency p99 [ms]": float(p99),
        "points/s": len(latency) * clouds.POINTS / seconds,
    }


def _events() -> list[tuple[float, str, str, bytes]]:
    """When to publish [s], topic, `merged` key and serialized message, in order of time."""
    types = clouds.STORE.types
    events = []
    for stamp, T in zip(*clouds.poses(), strict=True):
        seconds = (int(stamp) - clouds.START_NS) * 1e-9
        data = clouds.STORE.serialize_cdr(_odometry(types, int(stamp), T), "nav_msgs/msg/Odometry")
        events.append((seconds, "odom", "", bytes(data)))
    for index, points in enumerate(clouds.clouds()):
        message = clouds.message(points, index)
        data = clouds.STORE.serialize_cdr(message, "sensor_msgs/msg/PointCloud2")
        stamp = clouds.START_NS + round(index * clouds.PERIOD * 1e9)
        events.append(((index + 1) * clouds.PERIOD, "points", f"/points {stamp}", bytes(data)))
    return sorted(events, key=lambda event: event[0])


def _odometry(types: Any, stamp: int, T: se3.Matrix) -> Any:
    def of(name: str, *values: Any) -> Any:
        return types[f"geometry_msgs/msg/{name}"](*values)

    still = of("Vector3", 0.0, 0.0, 0.0)
    pose = of("Pose", of("Point", *T[:3, 3].tolist()),
              of("Quaternion", *se3.to_quaternion(T).tolist()))  # fmt: skip
    time_of = types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9))
    return types["nav_msgs/msg/Odometry"](
        types["std_msgs/msg/Header"](time_of, "odom"), "base_link",
        of("PoseWithCovariance", pose, np.zeros(36)),
        of("TwistWithCovariance", of("Twist", still, still), np.zeros(36)),
    )  # fmt: skip


def _publish(
    publishers: dict[str, Any], events: list[tuple[float, str, str, bytes]]
) -> tuple[dict[str, float], float]:
    """Publish in real time; when each cloud was published, and how long all took [s]."""
    published: dict[str, float] = {}
    began = time.time()
    for seconds, topic, key, data in events:
        time.sleep(max(began + seconds - time.time(), 0.0))
        if key:
            published[key] = time.time()
        publishers[topic].publish(data)
    took = time.time() - began
    time.sleep(1.0)
    return published, took


if __name__ == "__main__":
    for figure, value in measure().items():
        print(f"{figure:45} {value:,.4g}")
