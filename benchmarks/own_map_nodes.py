# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Localization on a robot's own map, with mapping beside it, over DDS: the CPU time of both nodes.

    python benchmarks/own_map_nodes.py [BAG]

`bags/room_1`, or another drive of the simulator, is replayed in real time: two lasers of 361 beams
at 37.5 Hz each, and odometry at 50 Hz. Nobody listens to the maps.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import rclpy
from process_cpu import cpu_seconds
from rclpy.qos import DurabilityPolicy, QoSProfile

from heightmap25d_msgs.msg import LocalizationStatus

BAG = Path(__file__).parent.parent / "bags" / "room_1"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SCANS = "intake.scan_topics:=[scan, scan_down]"
NODES = {
    "localization": "localization.own_map:=true",
    "mapping": "mapping.needs_localization:=true",
}
PATIENCE = 120.0


def measure(bag: Path = BAG) -> dict[str, float]:
    """CPU seconds a second of each node, and whether the robot never knew where it was."""
    os.environ["ROS_DOMAIN_ID"] = str((os.getpid() + 50) % 100 + 1)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    rclpy.init()
    node = rclpy.create_node("own_map_benchmark")
    states: list[int] = []
    node.create_subscription(
        LocalizationStatus, "localization/status", lambda m: states.append(m.state), LATCHED
    )
    processes = {
        name: subprocess.Popen([
            sys.executable, "-m", f"heightmap25d_ros.nodes.{name}",
            "--ros-args", "-p", SCANS, "-p", own,
        ])
        for name, own in NODES.items()
    }  # fmt: skip
    try:
        end = time.monotonic() + PATIENCE
        while not states or not node.count_publishers("height_grid"):
            if time.monotonic() > end:
                raise TimeoutError("the nodes do not answer")
            rclpy.spin_once(node, timeout_sec=0.1)
        command = [sys.executable, "-m", "heightmap25d_ros.nodes.replay", bag, "--wait", "60"]
        topics = ["--topics", "/scan", "/scan_down", "/odom", "/tf_static"]
        before = {name: cpu_seconds(process.pid) for name, process in processes.items()}
        began = time.monotonic()
        replay = subprocess.Popen([*command, *topics], stdout=subprocess.DEVNULL)
        while replay.poll() is None:
            rclpy.spin_once(node, timeout_sec=0.1)
        seconds = time.monotonic() - began
        used = {name: cpu_seconds(p.pid) - before[name] for name, p in processes.items()}
    finally:
        for process in processes.values():
            process.send_signal(signal.SIGINT)
        for process in processes.values():
            process.wait(timeout=60)
        node.destroy_node()
        rclpy.shutdown()
    return {
        **{f"{name}: CPU seconds a second": cpu / seconds for name, cpu in used.items()},
        "together": sum(used.values()) / seconds,
        "never tracking": float(LocalizationStatus.TRACKING not in states),
    }


if __name__ == "__main__":
    for name, value in measure(*map(Path, sys.argv[1:2])).items():
        print(f"{name:40} {value:12.4g}")
