# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the nodes tell of themselves, over DDS: the self-check, and /diagnostics."""

from __future__ import annotations

from contextlib import ExitStack
from itertools import count
from time import monotonic_ns

import pytest
from bag_writer import laser_scan, odometry, rclpy_type
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry
from node_client import Client, mapping_node, node_process
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan

MS = 10**6
START_NS = 1_700_000_000 * 10**9
NODES = ("/lonely/mapping", "/wrong/mapping", "/sound/mapping", "/lonely/planning")
MOUNT = ("-p", "intake.mounts:=[0.0, 0.0, 0.5, 0.0, 0.0, 0.0]")

SIMULATED = ("-p", "use_sim_time:=true")
NO_CLOCK = ("-r", "/clock:=/no_clock")


@pytest.fixture(scope="module")
def observed(tmp_path_factory):
    """Newest diagnostics and the log of each node, when all have checked themselves.

    And how many scans a second were published meanwhile: it depends on how busy the machine is.
    """
    statuses: dict[str, DiagnosticStatus] = {}
    first, scans_per_second = 0, 0.0  # of the scans that come when all nodes are active
    client = Client("/tester")

    def keep(message):
        for status in message.status:
            statuses[status.name] = status

    client.node.create_subscription(DiagnosticArray, "/diagnostics", keep, 100)
    with ExitStack() as running:
        directory = tmp_path_factory.mktemp("maps")
        begin = running.enter_context
        processes = [
            begin(mapping_node(directory, *SIMULATED, *NO_CLOCK, namespace="/lonely")),
            begin(mapping_node(directory, namespace="/wrong")),
            begin(mapping_node(directory, *SIMULATED, *MOUNT, namespace="/sound")),
            begin(node_process("planning", namespace="/lonely")),
        ]
        publishers = {
            topic: client.node.create_publisher(kind, topic, profile)
            for topic, kind, profile in (
                ("/lonely/odom", Odometry, qos_profile_sensor_data),
                ("/wrong/odom", Odometry, 100),
                ("/wrong/scan", LaserScan, 100),
                ("/sound/odom", Odometry, 100),
                ("/sound/scan", LaserScan, 100),
                ("/clock", Clock, 10),
            )
        }
        began = monotonic_ns()
        active_at = None
        for step in count():
            now = monotonic_ns()
            if active_at is None and len(statuses) == len(NODES):
                active_at, first = now, step
            if active_at is not None and now > active_at + 6500 * MS:
                scans_per_second = (step - first) / (now - active_at) * 1e9
                break
            stamp = START_NS + now - began  # as a robot's: nodes wait by the stamps
            z = 0.01 * (step % 2) if step else 0.0
            for topic, publisher in publishers.items():
                if topic == "/clock":
                    message = Clock()
                    message.clock.sec, message.clock.nanosec = divmod(stamp, 10**9)
                elif topic.endswith("scan"):
                    message = laser_scan(stamp + 10 * MS, (2.0, 2.0), type_of=rclpy_type)
                else:
                    place = (0.0, 0.0, z if "sound" in topic else 0.0)
                    message = odometry(stamp, place, type_of=rclpy_type)
                publisher.publish(message)
            client.spin(0.03)
    client.close()
    logs = {name: process.log for name, process in zip(NODES, processes, strict=True)}
    told = {name: (status, logs[name]) for name, status in statuses.items()}
    return told, scans_per_second


@pytest.fixture(scope="module")
def told(observed):
    return observed[0]


def figures(status):
    return {entry.key: entry.value for entry in status.values}


def test_who_hears_nobody_says_so(told):
    (mapping, _), (planning, _) = told["/lonely/mapping"], told["/lonely/planning"]
    assert "the clock does not run" in mapping.message
    assert "nobody publishes: /lonely/scan" in mapping.message
    for status in (mapping, planning):  # whose odometry is offered best effort, and heard
        assert "/lonely/odom" not in status.message
        assert float(figures(status)["/lonely/odom [Hz]"]) > 0.0
    assert "nothing comes: /lonely/height_grid" in planning.message
    assert figures(planning)["last plan"] == "none"


def test_what_comes_and_cannot_be_used_is_told(observed):
    told, scans_per_second = observed
    status, _ = told["/wrong/mapping"]
    assert "unknown mount: scan: without its mount (" in status.message
    assert "the last one: frame 'laser')" in status.message
    assert "the odometry is flat" in status.message
    assert float(figures(status)["dropped: scan: without its mount"].split()[0]) > scans_per_second


def test_a_node_that_lacks_nothing_says_so(observed):
    told, scans_per_second = observed
    status, log = told["/sound/mapping"]
    assert (status.level, status.message) == (DiagnosticStatus.OK, "active")
    values = figures(status)
    assert float(values["scans merged"]) > 3.0 * scans_per_second
    assert float(values["/sound/scan [Hz]"]) > 0.3 * scans_per_second
    assert values["map [cells]"] == "16 x 16"  # one tile, of 2 m
    # By /clock, as the stamps are: by the machine's own it would be years.
    assert float(values["scan to map, at most [ms]"]) < 1e6
    assert values["map saved"] == "False"
    assert "self-check: nothing is missing" in log


def test_each_node_says_it_once_in_one_line(told):
    for status, log in told.values():
        lines, later = [], []
        for line in log.splitlines():
            if "self-check:" in line:
                # At the end of the test nobody publishes any more.
                has_ended = "/clock stands at 1700000" in line or "nothing comes" in line
                (later if lines and has_ended else lines).append(line)
        assert len(lines) == 1
        assert len(later) <= 2
        for finding in status.message.split("; ")[1:]:
            # Counts go on after the line was written.
            assert finding.partition(" (")[0].partition(" of ")[0] in lines[0]


def test_a_problem_that_begins_later_is_told_once_and_once_when_it_is_over(tmp_path):
    """Ranges in metres, in millimetres, and in metres again."""
    client = Client("/later")
    statuses = []
    client.node.create_subscription(
        DiagnosticArray, "/diagnostics", lambda m: statuses.append(m.status[0]), 100
    )
    with mapping_node(tmp_path, *MOUNT, namespace="/later") as process:
        client.wait_for_node()
        began = monotonic_ns()
        for step in count():
            passed = (monotonic_ns() - began) * 1e-9
            if passed > 24.0:
                break
            stamp = START_NS + monotonic_ns() - began
            place = (0.0, 0.0, 0.01 * (step % 2))
            client.publish("odom", odometry(stamp, place, type_of=rclpy_type))
            ranges = (4200.0, 4200.0) if 7.0 < passed < 14.0 else (2.0, 2.0)
            client.publish("scan", laser_scan(stamp - 5 * MS, ranges, type_of=rclpy_type))
            client.spin(0.03)
    client.close()
    lines = [line for line in process.log.splitlines() if "self-check:" in line]
    assert len(lines) == 3
    assert "nothing is missing" in lines[0]
    assert "returns out of range" in lines[1]
    assert "the median is 4200 m against a range_max of 30 m" in lines[1]
    assert "self-check: over: returns out of range" in lines[2]
    levels = [status.level for status in statuses]
    assert DiagnosticStatus.WARN in levels
    assert levels[-1] == DiagnosticStatus.OK
