# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""bags/ramp is what test/helpers/record_ramp.py records, and its drive is a drive."""

from __future__ import annotations

import hashlib
from math import radians
from pathlib import Path

import numpy as np
import pytest
import ramp_drive
import record_ramp
from repository import BAGS
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability

BAG = BAGS / "ramp"


@pytest.fixture
def committed():
    with AnyReader([BAG]) as reader:
        yield reader


def sha256(directory: Path) -> dict[str, str]:
    files = (path for path in sorted(directory.rglob("*")) if path.is_file())
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.mark.slow
def test_recording_twice_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("first", "second"):
        record_ramp.record(tmp_path / name / "ramp", duration=0.5)
    assert sha256(tmp_path / "first") == sha256(tmp_path / "second")


@pytest.mark.slow
def test_committed_bag_is_what_is_recorded(tmp_path: Path, committed: AnyReader) -> None:
    """The first second of it; content, since a compressor's bytes depend on its version."""
    record_ramp.record(tmp_path / "ramp", duration=1.0)
    count = 0
    with AnyReader([tmp_path / "ramp"]) as reader:
        assert {c.topic: c.digest for c in reader.connections} == {
            c.topic: c.digest for c in committed.connections
        }
        stop = reader.end_time
        pairs = zip(reader.messages(), committed.messages(stop=stop), strict=True)
        for (connection, stamp, data), (expected, expected_stamp, expected_data) in pairs:
            assert (connection.topic, stamp) == (expected.topic, expected_stamp)
            message = reader.deserialize(data, connection.msgtype)
            expected_message = committed.deserialize(expected_data, expected.msgtype)
            if hasattr(message, "ranges"):  # a rounding of 1 mm may fall otherwise elsewhere
                np.testing.assert_allclose(message.ranges, expected_message.ranges, atol=0.0015)
            else:
                assert str(message) == str(expected_message)
            count += 1
    assert count > 150


def test_truth_is_that_of_the_world() -> None:
    with np.load(BAG / "truth" / "surface.npz", allow_pickle=False) as truth:
        world_top = ramp_drive.WORLD.cell_top(
            float(truth["resolution"]), tuple(truth["origin"]), truth["top"].shape
        )
        np.testing.assert_array_equal(truth["top"], world_top.astype(np.float32))
        is_seen = np.isfinite(truth["seen"])
        assert (truth["seen"] <= truth["top"] + 1e-5)[is_seen].all()
        assert truth["top"].shape == (64, 256)  # the paper's
        assert 0.5 < is_seen.mean() < 0.6


def test_topics_and_frames(committed: AnyReader) -> None:
    topics = {connection.topic: connection for connection in committed.connections}
    assert topics["/scan"].ext.offered_qos_profiles[0].reliability == QosReliability.BEST_EFFORT
    latched = topics["/tf_static"].ext.offered_qos_profiles[0]
    assert latched.durability == QosDurability.TRANSIENT_LOCAL
    frames = {"/scan": "laser", "/scan_down": "laser_down", "/odom": "odom", "/ground_truth": "map"}
    for topic, frame_id in frames.items():
        _, _, data = next(committed.messages([topics[topic]]))
        message = committed.deserialize(data, topics[topic].msgtype)
        assert message.header.frame_id == frame_id
    assert sum(path.stat().st_size for path in BAG.rglob("*") if path.is_file()) < 5e6


def test_odometry_brackets_every_scan(committed: AnyReader) -> None:
    first, last = np.inf, -np.inf
    scans = []
    for connection, logged, data in committed.messages():
        message = committed.deserialize(data, connection.msgtype)
        if connection.topic == "/odom":
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            assert stamp == logged
            first, last = min(first, stamp), max(last, stamp)
        elif connection.topic.startswith("/scan"):
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            end = stamp + len(message.ranges) * message.time_increment * 1e9
            assert logged == pytest.approx(end, abs=1e5)
            assert len(message.ranges) == 361
            assert message.angle_min + 360 * message.angle_increment == pytest.approx(
                message.angle_max
            )
            scans.append((stamp, end))
    assert first <= min(stamp for stamp, _ in scans)
    assert max(end for _, end in scans) <= last


def test_robot_stands_on_its_wheels() -> None:
    seconds = np.arange(0.0, ramp_drive.DURATION, 0.05)
    poses = ramp_drive.poses(seconds)
    np.testing.assert_allclose(poses[0, :3, 3], 0.0, atol=1e-12)
    identity = np.broadcast_to(np.eye(3), (len(poses), 3, 3))
    np.testing.assert_allclose(
        poses[:, :3, :3].transpose(0, 2, 1) @ poses[:, :3, :3], identity, atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(poses[:, :3, :3]), 1.0)
    wheels = np.concatenate([ramp_drive.WHEELS, np.zeros((4, 1))], axis=1)
    contacts = np.einsum("nij,wj->nwi", poses[:, :3, :3], wheels) + poses[:, None, :3, 3]
    ground = ramp_drive.WORLD.top(contacts[..., 0], contacts[..., 1])
    assert np.abs(contacts[..., 2] - ground).max() < 0.03  # four wheels, a plane has three
    on_ramp = (contacts[..., 0] > 4.2).all(axis=1) & (contacts[..., 0] < 15.8).all(axis=1)
    pitch = -np.arcsin(poses[on_ramp, 2, 0])
    assert radians(6.8) < pitch.min()
    assert pitch.max() < radians(7.2)
    assert np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).max() < 1.1 * 0.05
