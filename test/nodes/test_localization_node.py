# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The localization node in its own process, with mapping beside it, over DDS."""

from __future__ import annotations

import copy
import re
import subprocess

import numpy as np
import pytest
from bag_writer import laser_scan, odometry, rclpy_type
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from localization_bags import events_of, heights, map_of_another_drive, truth_of
from node_client import LATCHED, PATIENCE, Client, mapping_node, node_process, replay, start
from repository import BAGS
from scipy.ndimage import binary_dilation
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from heightmap25d_msgs.msg import HeightGrid, LocalizationStatus
from heightmap25d_ros.io import decode, encode
from heightmap25d_ros.pose_interpolation import interpolate

SECONDS = 12.0
CELL = 0.125
SCANS = ("-p", "intake.scan_topics:=[scan, scan_down]")
MOUNT = ("-p", "intake.mounts:=[0.0, 0.0, 0.5, 0.0, 0.0, 0.0]")
TRACKING, DEGRADED, LOST = (
    LocalizationStatus.TRACKING, LocalizationStatus.DEGRADED, LocalizationStatus.LOST,
)  # fmt: skip


@pytest.fixture(scope="module")
def room_map(tmp_path_factory):
    return map_of_another_drive("room", tmp_path_factory.mktemp("room"))


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


class Recorder(Client):
    """A client that keeps all messages of some topics."""

    def __init__(self, name):
        super().__init__(name=name)
        self.all = {}

    def record(self, topic, kind, qos=100):
        self.all[topic] = []
        self.node.create_subscription(kind, topic, self.all[topic].append, qos)


@pytest.fixture(scope="module")
def driven(room_map, tmp_path_factory):
    """What localization and mapping said of the first seconds of a lap."""
    client = Recorder("recorder")
    client.record("pose", PoseWithCovarianceStamped)
    client.record("pose_correction", PoseWithCovarianceStamped)
    client.record("/tf", TFMessage)
    client.record("localization/status", LocalizationStatus, LATCHED)
    client.subscribe("short_term_grid", HeightGrid)
    client.subscribe("height_grid", HeightGrid)
    localization = start(
        "nodes.localization", "--ros-args", *SCANS,
        "-p", f"localization.map_directory:={room_map}",
        "-p", "intake.timeout:=30.0",  # the status is that of the drive
        stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        with mapping_node(tmp_path_factory.mktemp("maps"), *SCANS):
            client.wait(lambda: bool(client.all["localization/status"]))
            client.wait_for_node()
            played = replay(BAGS / "room_1", "--rate", "1.5", "--duration", str(SECONDS))
            client.wait(lambda: played.poll() is not None, 2 * PATIENCE)
            client.spin(1.5)
    finally:
        localization.send_signal(2)
        _, client.log = localization.communicate(timeout=PATIENCE)
    assert localization.returncode == 0, client.log
    yield client
    client.close()


def test_the_pose_is_held_to_the_map(driven):
    stamps, truth = truth_of(events_of(BAGS / "room_1", SECONDS))
    poses = driven.all["pose"]
    assert len(poses) > 0.9 * SECONDS * 20
    errors = []
    for message in poses:
        assert message.header.frame_id == "map"
        T = decode.pose(message.pose.pose, "pose")
        true = interpolate(stamps, truth, [np.clip(stamp_of(message), stamps[0], stamps[-1])])
        errors.append(np.linalg.norm((T - true[0])[:3, 3]))
        covariance = np.array(message.pose.covariance).reshape(6, 6)
        assert np.isfinite(covariance).all()
        assert (np.diag(covariance) > 0.0).all()
    assert max(errors) <= 0.10
    assert np.sqrt(np.mean(np.square(errors))) <= 0.05
    assert errors[-1] <= 0.04
    # Discovery may lose the first odometry, and with it the scans before the second.
    drops = re.findall(r"dropped so far: (.*)", driven.log)
    assert all(re.fullmatch(r"scan: before the odometry \(\d\)", line) for line in drops), drops


def test_the_transform_is_the_correction_dated_ahead(driven):
    corrections = {stamp_of(m): m.pose.pose for m in driven.all["pose_correction"]}
    told = [
        transform
        for message in driven.all["/tf"]
        for transform in message.transforms
        if transform.header.frame_id == "map"
    ]
    assert len(told) == len(corrections)
    for transform in told:
        assert transform.child_frame_id == "odom"
        correction = corrections[stamp_of(transform) - 10**8]
        assert transform.transform.translation.x == correction.position.x
        assert transform.transform.rotation == correction.orientation


def test_the_status_says_tracking_and_why(driven):
    states = [message.state for message in driven.all["localization/status"]]
    assert DEGRADED in states[:3]
    last = driven.all["localization/status"][-1]
    assert last.state == TRACKING
    assert last.reason == "tracking: accepted"
    assert 0.001 < last.position_deviation < 0.1
    assert 0.5 < last.overlap <= 1.0 + 1e-6


def test_the_short_term_grid_is_a_map_in_odom(driven):
    grid = driven.newest["short_term_grid"]
    assert grid.header.frame_id == "odom"
    assert decode.height_map(grid).known.sum() > 150


def test_mapping_takes_the_corrections(driven, room_map):
    """Its map, made on drifting odometry: what stands, stands where it does in the long-term map.

    Measured: all of it; of a map made without corrections two thirds.
    """
    built, reference = decode.height_map(driven.newest["height_grid"]), heights(room_map)
    dx, dy = np.rint((np.array(built.geometry.origin) - reference.geometry.origin) / CELL).astype(
        int
    )
    stands = binary_dilation(reference.known & (reference.height > 25), np.ones((3, 3)))
    cells = np.argwhere(built.known & (built.height > 25)) + (dy, dx)
    rows, columns = cells[reference.geometry.contains(cells)].T
    assert len(rows) > 400
    assert stands[rows, columns].mean() > 0.97


def test_mapping_does_not_write_while_localization_is_lost(tmp_path):
    client = Client()
    client.subscribe("height_grid", HeightGrid)

    def feed(second):
        for step in range(10):
            stamp = second * 10**9 + step * 10**8
            client.publish("odom", odometry(stamp, type_of=rclpy_type))
            client.publish("scan", laser_scan(stamp, type_of=rclpy_type))
        client.spin(1.2)

    with mapping_node(tmp_path, *MOUNT) as process:
        client.wait_for_node()
        feed(1)
        before = stamp_of(client.newest["height_grid"])
        status = client.node.create_publisher(LocalizationStatus, "localization/status", LATCHED)
        status.publish(LocalizationStatus(state=LOST))
        client.spin(1.0)
        feed(2)
        assert stamp_of(client.newest["height_grid"]) == before
        status.publish(LocalizationStatus(state=TRACKING))
        client.spin(0.5)
        feed(3)
        assert stamp_of(client.newest["height_grid"]) >= 3 * 10**9
        client.spin(4.0)
    client.close()
    assert "localization is lost" in process.log


def test_a_map_from_a_topic_an_initial_pose_and_a_search(room_map):
    """And messages that are none of it: the node goes on."""
    client = Recorder("from_topic")
    client.record("pose", PoseWithCovarianceStamped)
    client.subscribe("localization/status", LocalizationStatus)
    process = start("nodes.localization", "--ros-args", *MOUNT, stderr=subprocess.PIPE)
    try:
        client.wait(lambda: "localization/status" in client.newest)
        assert not client.call("localization/relocalize", Trigger).success
        grid = HeightGrid()
        encode.fill_height_grid(grid, heights(room_map), 0, "map")
        broken = copy.deepcopy(grid)
        broken.info.width += 1
        outlet = client.node.create_publisher(HeightGrid, "long_term_grid", LATCHED)
        outlet.publish(broken)
        client.spin(0.5)
        assert not client.call("localization/relocalize", Trigger).success
        outlet.publish(grid)
        client.wait(lambda: client.call("localization/relocalize", Trigger).success, 20.0)
        client.publish("odom", odometry(10**9, type_of=rclpy_type))
        pose = PoseWithCovarianceStamped()
        pose.header.frame_id = "map"
        pose.pose.pose.position.x, pose.pose.pose.orientation.w = 3.0, 1.0
        client.publish("initialpose", pose)
        broken_pose = copy.deepcopy(pose)
        broken_pose.pose.pose.position.x = float("nan")
        client.publish("initialpose", broken_pose)
        client.publish("odom", odometry(2 * 10**9, type_of=rclpy_type))
        client.wait(lambda: len(client.all["pose"]) == 2)
        assert client.all["pose"][-1].pose.pose.position.x == pytest.approx(3.0)
        assert client.newest["localization/status"].state == DEGRADED
    finally:
        process.send_signal(2)
        _, log = process.communicate(timeout=PATIENCE)
        client.close()
    assert process.returncode == 0, log


def test_the_status_goes_on_and_names_silent_sources():
    client = Client("/deaf")
    client.subscribe("/deaf/localization/status", LocalizationStatus)

    def reason():
        return client.newest["/deaf/localization/status"].reason

    with node_process("localization", "-p", "intake.timeout:=0.5", namespace="/deaf"):
        client.wait(lambda: "/deaf/localization/status" in client.newest)
        client.wait(lambda: "nothing from odometry" in reason() and "from scan" in reason())
        for step in range(12):
            client.publish("odom", odometry(10**9 + step * 10**8, type_of=rclpy_type))
            client.spin(0.1)
        assert "nothing from scan" in reason()
        assert "odometry" not in reason()
        client.wait(lambda: "nothing from odometry" in reason())
    client.close()


def test_a_lost_robot_is_an_error_on_diagnostics(room_map):
    client = Client("/astray")
    seen = []
    client.node.create_subscription(
        DiagnosticArray, "/diagnostics",
        lambda message: seen.extend(s for s in message.status if s.name == "/astray/localization"),
        100,
    )  # fmt: skip
    client.subscribe("/astray/localization/status", LocalizationStatus)
    process = start(
        "nodes.localization", "--ros-args", "-r", "__ns:=/astray", *SCANS,
        "-p", f"localization.map_directory:={room_map}",
        "-p", "localization.relocalize_when_lost:=false", "-p", "localization.lost_refusals:=1",
    )  # fmt: skip
    try:
        client.wait(lambda: "/astray/localization/status" in client.newest and seen)
        assert seen[-1].level == DiagnosticStatus.OK
        far = PoseWithCovarianceStamped()
        far.header.frame_id = "map"
        far.pose.pose.position.x, far.pose.pose.orientation.w = 90.0, 1.0
        client.publish("initialpose", far)
        rules = [f"/{name}:=/astray/{name}" for name in ("scan", "scan_down", "odom")]
        played = replay(BAGS / "room_1", "--rate", "2", "--duration", "5", "--remap", *rules)
        client.wait(
            lambda: client.newest["/astray/localization/status"].state == LOST, 2 * PATIENCE
        )
        count = len(seen)
        client.wait(lambda: len(seen) > count + 1)
        assert seen[-1].level == DiagnosticStatus.ERROR
        assert seen[-1].message.startswith("active; the robot is lost")
        played.wait(PATIENCE)
    finally:
        process.send_signal(2)
        process.wait(PATIENCE)
        client.close()


@pytest.mark.parametrize("what", ["missing", "other frame"])
def test_a_bad_map_ends_the_node_with_one_line(what, room_map, tmp_path):
    frame = () if what == "missing" else ("-p", "mapping.map_frame:=world")
    directory = tmp_path if what == "missing" else room_map
    process = start(
        "nodes.localization", "--ros-args", *frame,
        "-p", f"localization.map_directory:={directory}", stderr=subprocess.PIPE,
    )  # fmt: skip
    _, log = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert log.count("error:") == 1
    assert str(directory) in log
