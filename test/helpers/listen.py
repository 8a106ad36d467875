# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A process that listens: serialized messages of some topics, into a file.

Usage: ``python listen.py FILE '{"/scan": "sensor_msgs/msg/LaserScan", ...}'``. Says "ready",
listens until its standard input is closed, then writes one JSON object: in ``arrivals`` pairs of
topic and message (hex, or nanoseconds for /clock), in ``offers`` the publishers' profiles.
"""

import json
import sys
import threading
from pathlib import Path

import rclpy
from bag_writer import rclpy_type
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message


def listen(file: Path, topics: dict[str, str]) -> None:
    clock = rclpy_type("rosgraph_msgs/msg/Clock")
    arrivals: list[tuple[str, str | int]] = []

    def take(topic: str, data: bytes) -> None:
        if topic == "/clock":
            stamp = deserialize_message(data, clock).clock
            arrivals.append((topic, stamp.sec * 10**9 + stamp.nanosec))
        else:
            arrivals.append((topic, data.hex()))

    rclpy.init()
    node = rclpy.create_node("listener")
    for topic, name in topics.items():
        is_latched = topic == "/tf_static"
        profile = QoSProfile(
            depth=10000,
            reliability=ReliabilityPolicy.BEST_EFFORT
            if topic == "/sensor"
            else ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL
            if is_latched
            else DurabilityPolicy.VOLATILE,
        )
        node.create_subscription(
            rclpy_type(name), topic, lambda data, topic=topic: take(topic, data), profile, raw=True
        )
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    is_over = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), is_over.set()), daemon=True).start()
    print("ready", flush=True)
    offers: dict[str, list[tuple[str, str]]] = {}
    while not is_over.is_set():
        executor.spin_once(timeout_sec=0.05)
        for topic in topics.keys() - offers.keys():
            publishers = node.get_publishers_info_by_topic(topic)
            if publishers:
                offers[topic] = [
                    (p.qos_profile.reliability.name, p.qos_profile.durability.name)
                    for p in publishers
                ]
    file.write_text(json.dumps({"arrivals": arrivals, "offers": offers}))
    rclpy.shutdown()


if __name__ == "__main__":
    listen(Path(sys.argv[1]), json.loads(sys.argv[2]))
