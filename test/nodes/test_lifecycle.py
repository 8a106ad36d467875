# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes as managed nodes, over DDS: as Nav2's lifecycle manager drives them."""

from __future__ import annotations

import os
import signal
import subprocess

import pytest
from bag_writer import laser_scan, odometry, rclpy_type
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from node_client import MAPS, PATIENCE, Client, mapping_node, node_process, start
from std_srvs.srv import Trigger

from heightmap25d_msgs.srv import SaveMap
from heightmap25d_ros.io import map_directory

MS = 10**6
START_NS = 1_700_000_000 * 10**9
MOUNT = ("-p", "intake.mounts:=[0.0, 0.0, 0.5, 0.0, 0.0, 0.0]")
MANUAL = ("-p", "autostart:=false")


class Manager(Client):
    """A client that changes the state of one node, as a lifecycle manager does."""

    def __init__(self, node, namespace):
        super().__init__(namespace)
        self._managed = node

    def change(self, transition):
        request = Transition(id=transition)
        return self.call(f"{self._managed}/change_state", ChangeState, transition=request).success

    @property
    def state(self):
        return self.call(f"{self._managed}/get_state", GetState).current_state.id

    def drive(self, milliseconds):
        """A pose before and after a scan."""
        for kind, at in (("odom", 0), ("odom", 20), ("scan", 10)):
            stamp = START_NS + (milliseconds + at) * MS
            if kind == "odom":
                message = odometry(stamp, (0.0, 0.0, 0.0), type_of=rclpy_type)
            else:
                message = laser_scan(stamp, (2.0, 2.0), type_of=rclpy_type)
            self.publish(kind, message)

    def is_heard(self, topic):
        return self.node.count_subscribers(f"{self.node.get_namespace()}/{topic}") > 0


def test_the_mapping_node_lives_as_it_is_told_and_again(tmp_path):
    manager = Manager("mapping", "/managed")
    manager.subscribe("map", MAPS["map"])
    with mapping_node(tmp_path, *MOUNT, *MANUAL, namespace="/managed") as process:
        assert manager.state == State.PRIMARY_STATE_UNCONFIGURED
        assert not manager.change(Transition.TRANSITION_ACTIVATE)  # not possible, and not deadly
        for turn in range(2):
            assert manager.change(Transition.TRANSITION_CONFIGURE)
            assert manager.state == State.PRIMARY_STATE_INACTIVE
            assert not manager.is_heard("scan")
            assert manager.change(Transition.TRANSITION_ACTIVATE)
            manager.drive(1000 * turn)
            manager.wait(lambda: "map" in manager.newest)
            assert manager.change(Transition.TRANSITION_DEACTIVATE)
            manager.wait(lambda: not manager.is_heard("scan"))
            manager.newest.clear()
            manager.spin(0.7)  # more than the period of publishing
            assert manager.newest == {}
            assert manager.change(Transition.TRANSITION_ACTIVATE)  # the map has stayed
            manager.wait(lambda: manager.is_heard("scan"))
            saved = manager.call("mapping/save_map", SaveMap, name=f"turn{turn}")
            assert map_directory.load(tmp_path / f"turn{turn}", 0.5).height_map.known.any(), (
                saved.message
            )
            assert manager.change(Transition.TRANSITION_DEACTIVATE)
            assert manager.change(Transition.TRANSITION_CLEANUP)
            assert manager.state == State.PRIMARY_STATE_UNCONFIGURED
        assert manager.change(Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
        assert manager.state == State.PRIMARY_STATE_FINALIZED
        assert process.poll() is None
    manager.close()


def test_transitions_while_messages_stream_in_do_no_harm(tmp_path):
    manager = Manager("mapping", "/stream")
    with mapping_node(tmp_path, *MOUNT, namespace="/stream") as process:
        manager.drive(0)
        for turn in range(1, 7):
            for step in range(50):
                stamp = START_NS + (1000 * turn + 10 * step) * MS
                pose = odometry(stamp, (0.0, 0.0, 0.0), type_of=rclpy_type)
                manager.publish("odom", pose)
                manager.publish("scan", laser_scan(stamp, (2.0, 2.0), type_of=rclpy_type))
            assert manager.change(
                Transition.TRANSITION_DEACTIVATE if turn % 2 else Transition.TRANSITION_ACTIVATE
            )
        assert process.poll() is None
        assert manager.state == State.PRIMARY_STATE_ACTIVE
    manager.close()


@pytest.mark.parametrize(
    ("node", "topic"), [("planning", "goal_pose"), ("localization", "initialpose")]
)
def test_other_nodes_live_as_they_are_told_and_again(node, topic):
    manager = Manager(node, "/others")
    with node_process(node, *MANUAL, namespace="/others") as process:
        for _ in range(2):
            assert manager.change(Transition.TRANSITION_CONFIGURE)
            assert not manager.is_heard(topic)
            assert manager.change(Transition.TRANSITION_ACTIVATE)
            manager.wait(lambda: manager.is_heard(topic))
            assert manager.change(Transition.TRANSITION_DEACTIVATE)
            manager.wait(lambda: not manager.is_heard(topic))
            assert manager.change(Transition.TRANSITION_CLEANUP)
        assert process.poll() is None
    manager.close()


def test_a_signal_saves_the_map_and_ends_the_node_with_status_0(tmp_path):
    client = Manager("mapping", "/saved")
    client.subscribe("map", MAPS["map"])
    saving = ("-p", "mapping.autosave:=last")
    with mapping_node(tmp_path, *MOUNT, *saving, namespace="/saved") as process:
        client.drive(0)
        client.wait(lambda: "map" in client.newest)
        while process.poll() is None:  # the impatient press again and again
            process.send_signal(signal.SIGINT)
            client.spin(0.02)
    client.close()
    assert map_directory.load(tmp_path / "last", 0.5).height_map.known.any()


def test_a_node_that_has_seen_nothing_saves_nothing(tmp_path):
    """Neither when asked nor when it ends, whether it never saw anything or was cleared."""
    client = Manager("mapping", "/unseen")
    client.subscribe("map", MAPS["map"])
    saving = ("-p", "mapping.autosave:=last")
    with mapping_node(tmp_path, *MOUNT, *saving, namespace="/unseen") as process:
        refused = client.call("mapping/save_map", SaveMap, name="last")
        assert (refused.success, "nothing has been mapped" in refused.message) == (False, True)
        client.drive(0)
        client.wait(lambda: "map" in client.newest)
        assert client.call("mapping/save_map", SaveMap, name="last").success
        assert client.call("mapping/clear_map", Trigger).success
        assert not client.call("mapping/save_map", SaveMap, name="last").success
        process.send_signal(signal.SIGINT)
        process.wait(timeout=PATIENCE)
    client.close()
    assert process.returncode == 0
    assert map_directory.load(tmp_path / "last", 0.5).height_map.known.any()


def test_a_map_to_begin_with_is_published_and_not_saved_again(tmp_path):
    client = Manager("mapping", "/loaded")
    client.subscribe("map", MAPS["map"])
    with mapping_node(tmp_path, *MOUNT, namespace="/loaded"):
        client.drive(0)
        client.wait(lambda: "map" in client.newest)
        assert client.call("mapping/save_map", SaveMap, name="first").success
        drawn = client.newest.pop("map")
    both = ("-p", "mapping.initial_map:=first", "-p", "mapping.autosave:=again")
    with mapping_node(tmp_path, *both, namespace="/loaded"):
        client.wait(lambda: "map" in client.newest)
        assert client.newest["map"].data == drawn.data
    client.close()
    assert not (tmp_path / "again").exists()


@pytest.mark.parametrize("name", ["initial_map:=missing", "autosave:=../outside"])
def test_a_map_that_cannot_be_used_ends_the_node_with_one_line(tmp_path, name):
    process = start(
        "nodes.mapping", "--ros-args", "-p", f"mapping.{name}",
        "-p", f"mapping.map_directory:={tmp_path}", stderr=subprocess.PIPE,
    )  # fmt: skip
    _, log = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert name.partition(":=")[2] in log.splitlines()[-1]


@pytest.mark.parametrize(
    ("node", "kind"),
    [("mapping", signal.SIGINT), ("planning", signal.SIGTERM)],
)
def test_a_signal_ends_a_node_that_is_just_beginning(node, kind):
    client = Client("/early")
    process = start(f"nodes.{node}", "--ros-args", "-r", "__ns:=/early", stderr=subprocess.PIPE)
    client.wait(lambda: node in client.node.get_node_names())
    process.send_signal(kind)
    _, log = process.communicate(timeout=PATIENCE)
    client.close()
    assert process.returncode == 0, log


def test_a_map_that_cannot_be_saved_where_it_should_is_saved_elsewhere_with_status_1(tmp_path):
    (tmp_path / "file").write_text("where a directory should be")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    client = Manager("mapping", "/unsaved")
    client.subscribe("map", MAPS["map"])
    process = start(
        "nodes.mapping", "--ros-args", "-r", "__ns:=/unsaved", *MOUNT,
        "-p", "mapping.autosave:=last", "-p", f"mapping.map_directory:={tmp_path / 'file'}",
        stderr=subprocess.PIPE, env=os.environ | {"TMPDIR": str(elsewhere)},
    )  # fmt: skip
    client.drive(0)
    client.wait(lambda: "map" in client.newest)
    process.send_signal(signal.SIGINT)
    _, log = process.communicate(timeout=PATIENCE)
    client.close()
    assert process.returncode == 1
    (saved,) = elsewhere.glob("heightmap25d_*/map")
    assert f"saved as {saved} instead" in log
    assert map_directory.load(saved).height_map.known.any()
