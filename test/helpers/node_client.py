# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node as a process of its own, and a client that talks to it over DDS."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import rclpy
from nav_msgs.msg import OccupancyGrid
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2

from heightmap25d_msgs.msg import HeightGrid, LocalizationLayers, UpperSurfaces

PATIENCE = 240.0
ASKED_AGAIN = 30.0  # [s] after which a service that has not answered is asked again
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MAPS = {
    "height_grid": HeightGrid,
    "localization_layers": LocalizationLayers,
    "upper_surfaces": UpperSurfaces,
    "map": OccupancyGrid,
    "cost_map": OccupancyGrid,
    "height_points": PointCloud2,
}


class Client:
    """Newest message of each subscribed topic, calls of services, messages to publish."""

    def __init__(self, namespace: str = "", name: str = "client") -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node(name, namespace=namespace, context=self.context)
        self.newest: dict[str, Any] = {}
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._publishers: dict[str, Any] = {}

    def close(self) -> None:
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def subscribe(self, topic: str, kind: Any) -> None:
        def keep(message: Any) -> None:
            self.newest[topic] = message

        self.node.create_subscription(kind, topic, keep, LATCHED)

    def publish(self, topic: str, message: Any, profile: QoSProfile | int = 100) -> None:
        if topic not in self._publishers:
            self._publishers[topic] = self.node.create_publisher(type(message), topic, profile)
            self.wait(lambda: self._publishers[topic].get_subscription_count() > 0)
            self.spin(0.5)  # the subscriber, too, must have found the publisher
        self._publishers[topic].publish(message)

    def wait_for_node(self) -> None:
        self.wait(lambda: self.node.count_publishers("map") > 0)

    def wait(self, is_done: Callable[[], bool], seconds: float = PATIENCE) -> None:
        end = time.monotonic() + seconds
        while not is_done():
            assert time.monotonic() < end, "nothing came"
            self._executor.spin_once(timeout_sec=0.05)

    def spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.05)

    def call(self, service: str, kind: Any, **request: Any) -> Any:
        """The answer of a service, which is asked again where one gets lost.

        On a busy machine a node may answer before it has found who asks.
        """
        client = self.node.create_client(kind, service)
        assert client.wait_for_service(timeout_sec=PATIENCE), service
        end, asked_at, asked = time.monotonic() + PATIENCE, -math.inf, []
        while not (answered := [future for future in asked if future.done()]):
            assert time.monotonic() < end, f"{service} does not answer"
            if time.monotonic() > asked_at + ASKED_AGAIN:
                asked_at = time.monotonic()
                asked.append(client.call_async(kind.Request(**request)))
            self._executor.spin_once(timeout_sec=0.05)
        self.node.destroy_client(client)
        return answered[0].result()


def start(module: str, *arguments: str, **options: Any) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", f"heightmap25d_ros.{module}", *arguments]
    return subprocess.Popen(command, text=True, **options)


def replay(bag: Path, *arguments: str) -> subprocess.Popen[str]:
    """The replay node's process, which begins when each of the robot's topics is listened to.

    On a busy machine nodes take their time to find one another.
    """
    topics = "/scan", "/scan_down", "/odom", "/tf_static"
    return start("nodes.replay", str(bag), "--topics", *topics, "--wait", str(PATIENCE), *arguments)


@contextmanager
def node_process(
    name: str, *arguments: str, namespace: str = "/"
) -> Iterator[subprocess.Popen[str]]:
    """A node's process; ends it with Ctrl-C, and it must end well."""
    process = start(
        f"nodes.{name}", "--ros-args", *arguments, "-r", f"__ns:={namespace}",
        stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        _, process.log = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, process.log


def mapping_node(
    directory: Path, *arguments: str, namespace: str = "/"
) -> AbstractContextManager[subprocess.Popen[str]]:
    """The mapping node's process, with its maps in a directory."""
    mine = "-p", f"mapping.map_directory:={directory}"
    return node_process("mapping", *arguments, *mine, namespace=namespace)
