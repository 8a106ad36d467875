# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the commands say of bags that are not as they should be."""

import json

import pytest
from bag_writer import laser_scan, odometry, qos, rosbags_type, tf_message, write_bag
from rosbags.rosbag2 import StoragePlugin

from heightmap25d_ros import cli

START = 1_700_000_000 * 10**9
STEP = 10_000_000


def drive(static_at=0, scan_frame="laser"):
    """20 scans of a standing robot, its poses, a mount that is told at a step of 20."""
    pitch = (0.0, 0.3826834, 0.0, 0.9238795)
    mount = tf_message((START, "base_link", scan_frame, (0.0, 0.0, 1.0), pitch))
    events = [("/tf_static", START + static_at * STEP, mount)]
    for index in range(21):
        stamp = START + index * STEP
        events.append(("/odom", stamp, odometry(stamp, (0.0, 0.0, 0.001))))  # 3-D
        if index < 20:
            events.append(("/scan", stamp + 1, laser_scan(stamp + 1, [1.4] * 11)))
    return events


def run(capsys, *arguments):
    status = cli.main([*map(str, arguments), "--json"])
    out, error = capsys.readouterr()
    return status, json.loads(out) if out else {}, error


def mapped(capsys, tmp_path, events, **options):
    path = write_bag(tmp_path / "bag", events, **options)
    return run(capsys, "map", path, "-o", tmp_path / "map")


@pytest.mark.parametrize("static_at", [0, 19, 21])
@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_mount_that_is_told_late_holds_for_all_scans(capsys, tmp_path, static_at, storage):
    volatile = {"/tf_static": qos(depth=10)}
    status, figures, _ = mapped(
        capsys, tmp_path, drive(static_at), storage=storage, profiles=volatile
    )
    assert status == 0
    assert figures["merged"]["scans"] == 20
    assert figures["dropped"] == figures["damaged"] == figures["other_types"] == {}
    assert figures["warnings"] == []


def test_a_mount_that_changes_holds_from_its_time_on(capsys, tmp_path):
    first = mapped(capsys, tmp_path / "first", drive())[1]
    later = tf_message((START, "base_link", "laser", (9.0, 9.0, 1.0), (0.0, 0.0, 0.0, 1.0)))
    changing = [*drive(), ("/tf_static", START + 21 * STEP, later)]
    assert mapped(capsys, tmp_path / "changing", changing)[1]["sha256"] == first["sha256"]


def test_messages_of_another_type_are_counted(capsys, tmp_path):
    text = rosbags_type("std_msgs/msg/String")(data="")
    others = [(topic, START, text) for topic in ("/scan", "/odom", "/tf_static", "/tf")]
    status, figures, _ = mapped(capsys, tmp_path, others + drive())
    assert status == 0
    assert figures["merged"]["scans"] == 20
    assert figures["other_types"] == {
        f"{topic} (std_msgs/msg/String)": 1 for topic in ("/odom", "/scan", "/tf", "/tf_static")
    }
    assert len(figures["warnings"]) == 4
    _, figures, _ = run(capsys, "info", tmp_path / "bag")
    assert figures["/scan (sensor_msgs/msg/LaserScan)"] == 20
    assert figures["/scan (std_msgs/msg/String)"] == 1


def test_what_was_not_read_is_in_the_figures(capsys, tmp_path, caplog):
    events = drive()
    events[4] = ("/scan", events[4][1], ("sensor_msgs/msg/LaserScan", b"damaged"))
    path = write_bag(tmp_path / "bag", events, storage=StoragePlugin.MCAP)
    (file,) = path.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-30])
    (path / "metadata.yaml").unlink()
    status, figures, _ = run(capsys, "map", path, "-o", tmp_path / "map")
    assert status == 0
    assert figures["merged"]["scans"] == 19
    assert figures["damaged"] == {"/scan": 1}
    missing, unfinished, damaged = figures["warnings"]
    assert f"{path}: no metadata.yaml" in missing
    assert f"{file}: unfinished or damaged" in unfinished
    assert f"{path}: /scan: 1 damaged messages are skipped" in damaged
    assert caplog.messages == figures["warnings"]
    _, figures, _ = run(capsys, "info", path)
    assert figures["warnings"] == [missing, unfinished]


def test_a_topic_without_messages_is_named(capsys, tmp_path, caplog):
    events = [event for event in drive() if event[0] != "/odom"]
    path = write_bag(tmp_path / "bag", events, silent={"/odom": "nav_msgs/msg/Odometry"})
    status, _, error = run(capsys, "map", path, "-o", tmp_path / "map")
    assert status == 2
    assert error == f"heightmap25d: {path}: /odom (nav_msgs/msg/Odometry) holds no messages\n"
    assert not caplog.messages
