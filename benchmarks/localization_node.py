# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The localization node over DDS: its CPU time, and when its corrections come.

    python benchmarks/localization_node.py

`bags/room_1` is replayed in real time, two lasers at 37.5 Hz, against the map of the same drive
with true poses. Latency is from a scan to the status of the registration that it led to, both as
they come to this process.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
from process_cpu import cpu_seconds
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

from heightmap25d_msgs.msg import LocalizationStatus

BAG = Path(__file__).parent.parent / "bags" / "room_1"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SCANS = ("scan", "scan_down")
PATIENCE = 120.0


def measure() -> dict[str, float]:
    """CPU seconds a second, latencies in milliseconds."""
    os.environ["ROS_DOMAIN_ID"] = str((os.getpid() + 25) % 100 + 1)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    with tempfile.TemporaryDirectory() as scratch:
        directory = Path(scratch) / "room"
        subprocess.run(
            ["heightmap25d", "map", BAG, "-o", directory, "--odom-topic", "/ground_truth"],
            check=True, capture_output=True,
        )  # fmt: skip
        rclpy.init()
        node = rclpy.create_node("localization_benchmark")
        process = subprocess.Popen([
            sys.executable, "-m", "heightmap25d_ros.nodes.localization", "--ros-args",
            "-p", f"intake.scan_topics:=[{', '.join(SCANS)}]",
            "-p", f"localization.map_directory:={directory}",
        ])  # fmt: skip
        try:
            return _measured(node, process.pid)
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(timeout=30)
            node.destroy_node()
            rclpy.shutdown()


def _measured(node: Node, pid: int) -> dict[str, float]:
    scanned: dict[tuple[int, int], float] = {}
    latency: list[float] = []
    states: list[int] = []

    def on_scan(message: LaserScan) -> None:
        scanned[message.header.stamp.sec, message.header.stamp.nanosec] = time.perf_counter()

    def on_status(message: LocalizationStatus) -> None:
        """The first one of a stamp tells of a registration; statuses are repeated."""
        stamp = message.header.stamp.sec, message.header.stamp.nanosec
        came = scanned.pop(stamp, None)
        if came is not None:
            latency.append(1e3 * (time.perf_counter() - came))
        if came is not None or not states:
            states.append(message.state)

    for topic in SCANS:
        node.create_subscription(LaserScan, topic, on_scan, qos_profile_sensor_data)
    node.create_subscription(LocalizationStatus, "localization/status", on_status, LATCHED)
    end = time.monotonic() + PATIENCE
    while not states:
        _spin(node, end)
    replay = subprocess.Popen(
        [sys.executable, "-m", "heightmap25d_ros.nodes.replay", BAG], stdout=subprocess.DEVNULL
    )
    while not scanned and not latency:
        _spin(node, end)
    began, cpu = time.monotonic(), cpu_seconds(pid)
    while replay.poll() is None:
        _spin(node, end)
    seconds = time.monotonic() - began
    p50, p99 = np.percentile(latency, [50, 99])
    return {
        "CPU seconds a second": (cpu_seconds(pid) - cpu) / seconds,
        "registrations": len(latency),
        "scan -> registered p50 [ms]": float(p50),
        "scan -> registered p99 [ms]": float(p99),
        "not tracking at the end": float(states[-1] != LocalizationStatus.TRACKING),
    }


def _spin(node: Node, end: float) -> None:
    if time.monotonic() > end:
        raise TimeoutError("the localization node does not answer")
    rclpy.spin_once(node, timeout_sec=0.1)


if __name__ == "__main__":
    for name, value in measure().items():
        print(f"{name:40} {value:12.4g}")
