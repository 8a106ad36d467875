# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mapping under two lasers of 1081 beams at 75 Hz each, and odometry at 200 Hz: CPU.

    python benchmarks/fast_lasers.py

The drive of bags/ramp with three beams for each one of its lasers, each scan twice (with noise of
its own) and each pose four times, as serialized messages. What a node does with them but for DDS
and rclpy's executor; by the CPU time of this process, as the machine may be busy. `node.py` plays
the same messages to the node, over DDS.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from rosbags.typesys import Stores, get_typestore

from heightmap25d_ros.io.bag import LASER_SCAN, ODOMETRY, Bag
from heightmap25d_ros.io.message_bytes import laser_scan, odometry
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping, compile_kernels

RAMP = Path(__file__).parent.parent / "bags" / "ramp"
STORE = get_typestore(Stores.ROS2_JAZZY)
SECONDS = 10
POSES = {"/odom": 4}
BETWEEN = {"/scan": 2, "/scan_down": 2, **POSES}  # messages in place of one
BEAMS = 3  # in place of one, but for the last one


def messages() -> list[tuple[int, str, bytes]]:
    """The drive in order of time: that [ns], topic and serialized message."""
    with Bag(RAMP) as bag:
        found = []
        rng = np.random.default_rng(1)
        stop_ns = bag.start_ns + SECONDS * 10**9
        for event in bag.events(list(BETWEEN), None, None, stop_ns):
            period_ns = 20_000_000 if event.topic == "/odom" else round(1e9 / 37.5)
            kind = ODOMETRY if event.topic == "/odom" else LASER_SCAN
            message = event.message if kind == ODOMETRY else _denser(event.message)
            for part in range(BETWEEN[event.topic]):
                later = part * period_ns // BETWEEN[event.topic]
                stamp_ns = _stamp_ns(event.message) + later
                if kind == LASER_SCAN:  # no two scans of a laser are the same
                    message.ranges = (
                        message.ranges + rng.normal(0.0, 0.003, len(message.ranges))
                    ).astype(np.float32)
                data = bytearray(STORE.serialize_cdr(message, kind))
                data[4:12] = np.array([stamp_ns // 10**9, stamp_ns % 10**9], "<u4").tobytes()
                found.append((event.stamp_ns + later, event.topic, bytes(data)))
    return sorted(found, key=lambda message: message[0])


def _stamp_ns(message) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def _denser(scan):
    """Three beams for one, at half of its sweep."""
    count = len(scan.ranges)
    places = np.linspace(0.0, count - 1.0, BEAMS * (count - 1) + 1)
    scan.ranges = scan.ranges[np.rint(places).astype(int)]
    scan.intensities = np.zeros(0, np.float32)
    scan.angle_increment /= BEAMS
    scan.time_increment /= 2 * BEAMS
    scan.scan_time /= 2
    return scan


def measure() -> dict[str, float]:
    """CPU of a second, scans merged of those that came."""
    lasers = {"intake.scan_topics": ["/scan", "/scan_down"]}
    params = with_values(Params(), lasers)
    drive = messages()
    compile_kernels(params)
    mapping = Mapping(params)
    with Bag(RAMP) as bag:
        for event in bag.events(["/tf_static"]):
            mapping.take_transforms(event.message, is_static=True)
    began = time.process_time()
    for _, topic, data in drive:
        if topic in POSES:
            mapping.take_odometry(odometry(data))
        else:
            mapping.take_scan(topic, laser_scan(data))
    mapping.flush()
    seconds = time.process_time() - began
    scans = sum(topic not in POSES for _, topic, _ in drive)
    return {
        "CPU [s per s]": seconds / SECONDS,
        "CPU [ms per scan]": 1e3 * seconds / scans,
        "scans": scans,
        "scans not merged": scans - mapping.merged["scans"],
        "poses": len(drive) - scans,
        **mapping.dropped,
    }


if __name__ == "__main__":
    for figure, value in measure().items():
        print(f"{figure:45} {value:,.4g}")
