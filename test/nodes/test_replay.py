# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Replay and a listener, two processes over DDS: what arrives is what was recorded."""

import json
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from bag_writer import STORE, laser_scan, odometry, qos, tf_message, write_bag
from rclpy.qos import DurabilityPolicy, HistoryPolicy, ReliabilityPolicy
from repository import ROOT
from rosbags.interfaces import QosHistory
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer

from heightmap25d_ros.nodes.player import SETTLED, profile_of

START = 1_700_000_000 * 10**9
MS = 10**6
TYPES = {
    "/scan": "sensor_msgs/msg/LaserScan",
    "/odom": "nav_msgs/msg/Odometry",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/sensor": "sensor_msgs/msg/LaserScan",
    "/clock": "rosgraph_msgs/msg/Clock",
}


def static_transform(stamp, child):
    return tf_message((stamp, "base_link", child, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))


def events():
    """A second: two latched messages, poses every 10 ms, scans every 20 ms; and a pause."""
    recorded = [("/tf_static", START, static_transform(START, name)) for name in ("a", "b")]
    for index in range(100):
        stamp = START + 10 * index * MS
        if 30 < index < 50:
            continue
        recorded.append(("/odom", stamp, odometry(stamp, (0.1 * index, 0.0, 0.0))))
        ranges = np.sin(index + np.arange(361.0)) + 2.0
        if index % 2 == 0:
            recorded.append(("/scan", stamp, laser_scan(stamp, ranges)))
        if index % 10 == 0:
            recorded.append(("/sensor", stamp, laser_scan(stamp, ranges[:7])))
    return recorded


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A bag of a second, and per topic its messages (stamp, hex) in order."""
    recorded = events()
    path = write_bag(
        tmp_path_factory.mktemp("bags") / "recording",
        recorded,
        storage=StoragePlugin.MCAP,
        compression=CompressionMode.MESSAGE,
        profiles={"/sensor": qos(depth=5, is_reliable=False)},
    )
    return path, by_topic(recorded)


def by_topic(recorded):
    expected = {}
    for topic, stamp, message in recorded:
        data = bytes(STORE.serialize_cdr(message, message.__msgtype__))
        expected.setdefault(topic, []).append((stamp, data.hex()))
    return expected


class Listener:
    def __init__(self, path: Path, topics) -> None:
        self._file = path / "heard.json"
        script = ROOT / "test" / "helpers" / "listen.py"
        types = {topic: TYPES.get(topic, TYPES["/scan"]) for topic in topics}
        self._process = subprocess.Popen(
            [sys.executable, str(script), str(self._file), json.dumps(types)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self._process.stdout.readline() == "ready\n"

    def stop(self):
        """What it heard: (topic, message) in order of arrival, and the publishers' profiles."""
        time.sleep(0.3)  # for what is not acknowledged
        self._process.communicate(timeout=60)
        heard = json.loads(self._file.read_text())
        self._file.unlink()
        return heard["arrivals"], heard["offers"]

    def kill(self):
        if self._process.poll() is None:
            self._process.kill()
            self._process.communicate()


@contextmanager
def listening(path, topics=TYPES):
    listener = Listener(path, topics)
    try:
        yield listener
    finally:
        listener.kill()


def command(*arguments):
    return [sys.executable, "-m", "heightmap25d_ros.nodes.replay", *map(str, arguments)]


def replay(*arguments):
    waiting = "--wait", 60  # a busy machine takes its time
    return subprocess.run(
        command(*waiting, *arguments), capture_output=True, text=True, timeout=120, check=False
    )


def heard_of(arrivals, topic):
    return [message for name, message in arrivals if name == topic]


def test_every_message_arrives_as_it_was_recorded(recording, tmp_path):
    path, expected = recording
    with listening(tmp_path) as listener:
        result = replay(path, "--rate", 2)
        arrivals, offers = listener.stop()
    assert result.returncode == 0, result.stderr
    for topic, messages in expected.items():
        assert heard_of(arrivals, topic) == [data for _, data in messages]
    assert "133 messages" in result.stdout
    assert "nobody" not in result.stdout
    assert offers == {
        "/scan": [["RELIABLE", "VOLATILE"]],
        "/odom": [["RELIABLE", "VOLATILE"]],
        "/tf_static": [["RELIABLE", "TRANSIENT_LOCAL"]],
        "/sensor": [["BEST_EFFORT", "VOLATILE"]],
        "/clock": [["RELIABLE", "VOLATILE"]],
    }
    clock = np.array(heard_of(arrivals, "/clock"))
    assert (clock[0], clock[-1]) == (START, START + 990 * MS)
    assert (np.diff(clock) > 0).all()
    assert np.diff(clock).max() <= 25 * MS
    assert set(clock) >= {stamp for messages in expected.values() for stamp, _ in messages}


def test_a_stretch_of_a_bag_and_what_was_latched_before(recording, tmp_path):
    path, expected = recording
    with listening(tmp_path) as listener:
        assert replay(path, "--start", 0.5, "--duration", 0.25).returncode == 0
        arrivals, _ = listener.stop()
    first, stop = START + 500 * MS, START + 750 * MS
    for topic in ("/odom", "/scan"):
        inside = [data for stamp, data in expected[topic] if first <= stamp < stop]
        assert heard_of(arrivals, topic) == inside
    assert heard_of(arrivals, "/tf_static") == [data for _, data in expected["/tf_static"]]
    clock = heard_of(arrivals, "/clock")
    assert (clock[0], clock[-1]) == (first, START + 740 * MS)


def test_all_static_transforms_come_first_whenever_and_however_recorded(tmp_path):
    recorded = [("/odom", START, odometry(START))]
    for index, name in enumerate("abc"):
        stamp = START + 100 * index * MS
        recorded.append(("/tf_static", stamp, static_transform(stamp, name)))
        recorded.append(("/odom", stamp + MS, odometry(stamp + MS)))
    profiles = {"/tf_static": qos(depth=1, is_reliable=False)}
    path = write_bag(tmp_path / "bag", recorded, profiles=profiles)
    expected = [data for _, data in by_topic(recorded)["/tf_static"]]
    with listening(tmp_path, ["/odom", "/tf_static", "/clock"]) as listener:
        result = replay(path, "--start", 0.05)
        arrivals, offers = listener.stop()
    assert result.returncode == 0, result.stderr
    assert offers["/tf_static"] == [["RELIABLE", "TRANSIENT_LOCAL"]]
    messages = [topic for topic, _ in arrivals if topic != "/clock"]
    assert messages == 3 * ["/tf_static"] + 2 * ["/odom"]
    assert heard_of(arrivals, "/tf_static") == expected


def test_a_mount_that_changes_begins_with_its_first_pose(tmp_path):
    pose = (2.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
    later = START + 100 * MS
    recorded = [
        ("/tf_static", START, static_transform(START, "a")),
        ("/odom", START + MS, odometry(START)),
        ("/tf_static", later, tf_message((later, "base_link", "a", *pose))),
        ("/odom", later + MS, odometry(later)),
    ]
    path = write_bag(tmp_path / "bag", recorded)
    first, second = (data for _, data in by_topic(recorded)["/tf_static"])
    with listening(tmp_path, ["/odom", "/tf_static"]) as listener:
        assert replay(path).returncode == 0
        arrivals, _ = listener.stop()
    assert heard_of(arrivals, "/tf_static") == [second, first, first, second]


def test_messages_of_another_type_are_told(tmp_path):
    text = STORE.types["std_msgs/msg/String"](data="")
    recorded = [("/odom", START, text), ("/odom", START, odometry(START))]
    with listening(tmp_path, ["/odom"]) as listener:
        result = replay(write_bag(tmp_path / "bag", recorded))
        arrivals, _ = listener.stop()
    assert result.returncode == 0
    assert "/odom: 1 messages of type std_msgs/msg/String are not read" in result.stderr
    assert len(heard_of(arrivals, "/odom")) == 1


def test_the_pace_is_that_of_the_bag(recording):
    path, _ = recording
    for rate in (1.0, 5.0):
        took = replay(path, "--wait", 0, "--rate", rate).stdout
        seconds = float(took.partition(" messages in ")[2].split()[0])
        assert seconds * rate / 0.99 > 0.9  # a busy machine may be slower, none is faster


def test_it_loops_until_it_is_told_to_end(recording, tmp_path):
    path, expected = recording
    with listening(tmp_path, ["/odom", "/clock"]) as listener:
        with subprocess.Popen(
            command(path, "--loop", "--rate", 4), stdout=subprocess.PIPE, text=True
        ) as process:
            process.stdout.readline()
            while "nobody" not in process.stdout.readline():
                assert process.poll() is None
            time.sleep(0.9)
            process.send_signal(signal.SIGINT)
            rest = process.stdout.read()
        arrivals, _ = listener.stop()
    assert process.returncode == 0
    assert "messages in" in rest
    heard = heard_of(arrivals, "/odom")
    once = [data for _, data in expected["/odom"]]
    assert len(heard) > 2 * len(once)
    assert heard == [once[index % len(once)] for index in range(len(heard))]
    clock = np.array(heard_of(arrivals, "/clock"))
    assert (np.diff(clock) < 0).sum() == (clock == START).sum() - 1 >= 2


def test_sigterm_ends_it_as_well(recording):
    path, _ = recording
    with subprocess.Popen(
        command(path, "--wait", 30), stdout=subprocess.PIPE, text=True
    ) as process:
        assert "waiting" in process.stdout.readline()
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=60) == 0


@pytest.mark.parametrize(
    "how", [["--remap", "/scan:=/front/scan", "/odom:=/o"],
            ["--ros-args", "-r", "/scan:=/front/scan", "-r", "/odom:=/o"]],
    ids=["remap", "ros-args"],
)  # fmt: skip
def test_topics_can_be_chosen_and_renamed(recording, tmp_path, how):
    path, expected = recording
    with listening(tmp_path, ["/front/scan", "/scan", "/sensor"]) as listener:
        assert replay(path, "--topics", "/scan", "--rate", 4, *how).returncode == 0
        arrivals, _ = listener.stop()
    assert {topic for topic, _ in arrivals} == {"/front/scan"}
    assert heard_of(arrivals, "/front/scan") == [data for _, data in expected["/scan"]]


def test_topics_that_are_chosen_must_all_be_listened_to(recording, tmp_path):
    path, expected = recording
    (tmp_path / "late").mkdir()
    with listening(tmp_path, ["/odom"]), subprocess.Popen(
        command(path, "--topics", "/odom", "/scan", "--wait", 60), stdout=subprocess.PIPE, text=True
    ) as process:  # fmt: skip
        assert "waiting" in process.stdout.readline()
        time.sleep(SETTLED + 2.0)
        assert process.poll() is None
        with listening(tmp_path / "late", ["/scan"]) as late:
            rest = process.stdout.read()
            arrivals, _ = late.stop()
    assert "nobody" not in rest
    assert heard_of(arrivals, "/scan") == [data for _, data in expected["/scan"]]


def test_types_that_are_not_installed_are_skipped_and_named(tmp_path):
    with Writer(tmp_path / "bag", version=9) as writer:
        for topic, name in (("/a", "un_known/msg/Thing"), ("/b", "nav_msgs/msg/NoSuch")):
            connection = writer.add_connection(topic, name, msgdef="int32 x", rihs01="RIHS01_0")
            writer.write(connection, START, b"\x00\x01\x00\x00\x05\x00\x00\x00")
        connection = writer.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=STORE)
        message = odometry(START)
        writer.write(connection, START, STORE.serialize_cdr(message, message.__msgtype__))
    result = replay(tmp_path / "bag", "--wait", 0)
    assert result.returncode == 0
    assert "skipped: /a (un_known/msg/Thing), /b (nav_msgs/msg/NoSuch)" in result.stdout
    assert "1 messages" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--start", "5"], "lasts 1.0 s"),
        (["--topics", "/nothing"], "/nothing"),
        (["--rate", "0"], "--rate"),
        (["--rate", "nan"], "--rate"),
        (["--duration", "-1"], "--duration"),
        (["--remap", "/scan"], "/a:=/b"),
        (["--remap", "/sc an:=/b"], "/a:=/b"),
    ],
)
def test_unusable_arguments_end_with_two_and_a_line(recording, arguments, message):
    path, _ = recording
    result = replay(path, *arguments)
    assert result.returncode == 2
    assert message in result.stderr
    assert "Traceback" not in result.stderr


def test_a_bag_that_is_not_there_ends_with_two_and_a_line(tmp_path):
    result = replay(tmp_path / "nothing")
    assert (result.returncode, len(result.stderr.splitlines())) == (2, 1)
    assert str(tmp_path / "nothing") in result.stderr


def test_the_help_has_an_example():
    result = replay("--help")
    assert result.returncode == 0
    assert "Example: replay bags/ramp" in result.stdout


# Profiles.


def policies(profile):
    return profile.reliability, profile.durability, profile.history, profile.depth


RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
LATCHED, VOLATILE = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE
LAST, ALL = HistoryPolicy.KEEP_LAST, HistoryPolicy.KEEP_ALL
UNTOLD = qos(depth=0)._replace(history=QosHistory.UNKNOWN)


@pytest.mark.parametrize(
    ("topic", "recorded", "expected"),
    [
        ("/scan", [], (RELIABLE, VOLATILE, LAST, 10)),
        ("/tf_static", [], (RELIABLE, LATCHED, LAST, 100)),
        ("/scan", [qos(depth=5, is_reliable=False)], (BEST_EFFORT, VOLATILE, LAST, 5)),
        ("/map", [qos(depth=1, is_transient_local=True)], (RELIABLE, LATCHED, LAST, 1)),
        # Whatever was recorded: nobody subscribes to it otherwise.
        ("/tf_static", [qos(depth=5, is_reliable=False)], (RELIABLE, LATCHED, LAST, 5)),
        ("/robot/tf_static", [], (RELIABLE, LATCHED, LAST, 100)),
        # Several publishers become one that serves the subscribers of all.
        ("/tf_static", 3 * [qos(depth=1, is_transient_local=True)], (RELIABLE, LATCHED, LAST, 3)),
        ("/x", [qos(is_reliable=False), qos(depth=5)], (RELIABLE, VOLATILE, LAST, 15)),
        # The recorder was not told history and depth.
        ("/tf", [UNTOLD], (RELIABLE, VOLATILE, LAST, 10)),
        ("/x", [qos(depth=0)._replace(history=QosHistory.KEEP_ALL)], (RELIABLE, VOLATILE, ALL, 10)),
    ],
)
def test_profiles_are_as_recorded(topic, recorded, expected):
    assert policies(profile_of(topic, recorded)) == expected
