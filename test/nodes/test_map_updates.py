# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps that are followed by their updates: what goes out, and what listeners make of it."""

from types import SimpleNamespace

import numpy as np
import pytest
from bag_writer import laser_scan, odometry, rclpy_type
from nav_msgs.msg import OccupancyGrid
from node_client import LATCHED, Client, mapping_node
from rclpy.qos import QoSProfile

from heightmap25d_msgs.msg import HeightGrid
from heightmap25d_ros.grid.height_map import Area, Geometry
from heightmap25d_ros.grid.map_changes import changed_blocks
from heightmap25d_ros.nodes import map_updates
from heightmap25d_ros.nodes.map_messages import UPDATE
from heightmap25d_ros.nodes.map_updates import UpdatedTopic
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.level_map import LevelMap

MS = 10**6
AREA = Area(64, 32, 32, 48)
PLACE = Geometry(resolution=0.125, origin=(4.0, 8.0), shape=AREA.shape)


class Graph:
    """A node that knows who subscribes: (name, id) by topic."""

    def __init__(self):
        self.listeners = {"map": [("rviz", 1)], "map_updates": [("rviz", 2)]}

    def get_subscriptions_info_by_topic(self, topic):
        return [
            SimpleNamespace(node_namespace="/", node_name=name, endpoint_gid=[number])
            for name, number in self.listeners[topic]
        ]


@pytest.fixture
def clock(monkeypatch):
    seconds = [1000.0]
    monkeypatch.setattr(map_updates.time, "monotonic", lambda: seconds[0])
    return seconds


@pytest.fixture
def graph(clock):
    return Graph()


@pytest.fixture
def settled(graph, clock):
    """A topic whose whole map went out long ago."""
    topic = UpdatedTopic(graph, "map", "map_updates")
    assert topic.next(AREA, PLACE) is None
    clock[0] += 2 * map_updates.SETTLING
    return topic


def test_the_first_map_is_whole_and_then_what_has_changed(settled):
    settled.note(Area(70, 40, 3, 4))
    settled.note(Area(80, 36, 2, 2))
    assert settled.next(AREA, PLACE) == Area(70, 36, 12, 8)
    settled.note(Area(0, 0, 80, 40))  # also beside the map
    assert settled.next(AREA, PLACE) == Area(64, 32, 16, 8)
    assert not settled.next(AREA, PLACE).rows


def test_a_map_that_grew_or_lies_elsewhere_is_whole(settled):
    grown = Geometry(resolution=0.125, origin=(4.0, 8.0), shape=(48, 48))
    assert settled.next(Area(64, 32, 48, 48), grown) is None
    elsewhere = Geometry(resolution=0.125, origin=(0.0, 0.0), shape=(48, 48))
    assert settled.next(Area(64, 32, 48, 48), elsewhere) is None
    settled.forget()
    assert settled.next(Area(64, 32, 48, 48), elsewhere) is None


def test_who_comes_late_gets_a_whole_map(settled, graph):
    assert not settled.is_due(1)
    graph.listeners["map"].append(("nav2", 3))
    graph.listeners["map_updates"].append(("nav2", 4))
    assert settled.is_due(2)
    assert settled.next(AREA, PLACE) is None
    assert not settled.is_due(2)
    assert settled.next(AREA, PLACE) is not None
    graph.listeners["map"][1] = ("nav2", 5)  # the same node, started again
    assert settled.next(AREA, PLACE) is None
    del graph.listeners["map"][1]
    assert settled.is_due(1)
    assert settled.next(AREA, PLACE) is not None
    assert not settled.is_due(1)


def test_who_does_not_follow_the_updates_gets_whole_maps_always(settled, graph):
    graph.listeners["map"].append(("echo", 3))
    for _ in range(3):
        settled.note(Area(70, 40, 3, 4))
        assert settled.next(AREA, PLACE) is None


def test_updates_soon_after_a_whole_map_are_repeated(settled, clock):
    """Nav2 forgets those that come before it has used the whole map."""
    settled.forget()
    assert settled.next(AREA, PLACE) is None
    settled.note(Area(70, 40, 1, 1))
    assert settled.next(AREA, PLACE) == Area(70, 40, 1, 1)
    settled.note(Area(72, 40, 1, 1))
    assert settled.next(AREA, PLACE) == Area(70, 40, 3, 1)
    assert not settled.is_due(1)
    clock[0] += 1.1 * map_updates.SETTLING
    assert settled.is_due(1)
    assert settled.next(AREA, PLACE) == Area(70, 40, 3, 1)
    assert not settled.is_due(1)


def test_a_map_is_refreshed_now_and_then(graph, clock):
    topic = UpdatedTopic(graph, "map", "map_updates", refreshed=60.0)
    assert topic.next(AREA, PLACE) is None
    first = topic.whole_ns
    clock[0] += 59.0
    assert topic.next(AREA, PLACE) is not None
    clock[0] += 2.0
    assert topic.next(AREA, PLACE) is None
    assert topic.whole_ns > first


class Follower(Client):
    """Keeps the whole maps and the updates of the topics, and what they say together."""

    def __init__(self, namespace, name, *, with_updates=True):
        super().__init__(namespace, name)
        self.whole = {"map": [], "cost_map": []}
        self.updates = {"map": [], "cost_map": []}
        self.cells = {}
        self.levels, self.heights, self.grids = LevelMap("map", Drops()), None, []
        self.node.create_subscription(HeightGrid, "height_grid", self._take_grid, LATCHED)
        if with_updates:
            self.node.create_subscription(
                HeightGrid, "height_grid_updates", self._take_grid_update, QoSProfile(depth=10)
            )
        for topic in self.whole:
            self.node.create_subscription(
                OccupancyGrid, topic, lambda m, t=topic: self._replace(t, m), LATCHED
            )
            if with_updates:
                self.node.create_subscription(
                    UPDATE, f"{topic}_updates",
                    lambda m, t=topic: self._update(t, m), QoSProfile(depth=10),
                )  # fmt: skip

    def _take_grid(self, message):
        self.grids.append(message)
        self.heights = self.levels.take_lowest(message)

    def _take_grid_update(self, message):
        heights = self.levels.take_update(message)
        self.heights = self.heights if heights is None else heights

    def _replace(self, topic, message):
        self.whole[topic].append(message)
        self.cells[topic] = np.array(message.data, np.int8).reshape(
            message.info.height, message.info.width
        )

    def _update(self, topic, message):
        self.updates[topic].append(message)
        rows = slice(message.y, message.y + message.height)
        columns = slice(message.x, message.x + message.width)
        self.cells[topic][rows, columns] = np.reshape(message.data, (message.height, message.width))


class Robot:
    """Stands, and sees a wall [m] through gaps: each scan is between two poses."""

    def __init__(self, client):
        self._client, self._ms = client, 1_700_000_000_000

    def scan(self, *nearer):
        ranges = np.full(100, 9.0)
        for beam, metres in nearer:
            ranges[beam : beam + 20] = metres
        for _ in range(3):  # a higher reading must be confirmed
            self._ms += 100
            for milliseconds in (0, 20):
                pose = odometry((self._ms + milliseconds) * MS, (0, 0, 0), type_of=rclpy_type)
                self._client.publish("odom", pose)
            scan = laser_scan(
                (self._ms + 10) * MS,
                ranges,
                type_of=rclpy_type,
                angle_increment=0.01,
                angle_max=0.49,
            )
            self._client.publish("scan", scan)


@pytest.mark.skipif(UPDATE is None, reason="map_msgs is not installed")
def test_a_listener_that_follows_the_updates_has_the_map_of_one_that_does_not(tmp_path):
    mount = "-p", "intake.mounts:=[0.0, 0.0, 0.5, 0.0, 0.05, 0.0]"
    rate = "-p", "mapping.publish_rate:=10.0"
    follower = Follower("/followed", "follower")
    robot = Robot(follower)
    with mapping_node(tmp_path, *mount, *rate, namespace="/followed") as process:
        robot.scan((0, 2.5))
        follower.wait(lambda: follower.whole["map"] and follower.whole["cost_map"])
        follower.wait(lambda: follower.grids)
        follower.spin(1.0)
        count = {topic: len(messages) for topic, messages in follower.whole.items()}
        grids = len(follower.grids)
        assert follower.updates["map"] == []
        before = follower.cells["map"].copy()
        robot.scan((0, 2.5), (40, 3.0))
        follower.wait(lambda: follower.updates["map"] and follower.updates["cost_map"])
        follower.spin(1.0)
        assert {topic: len(m) for topic, m in follower.whole.items()} == count
        assert len(follower.grids) == grids
        update, whole = follower.updates["map"][0], follower.whole["map"][-1]
        assert update.header.frame_id == "map"
        assert update.width * update.height < 0.7 * whole.info.width * whole.info.height
        assert (follower.cells["map"] != before).any()
        late = Follower("/followed", "late", with_updates=False)
        late.wait(lambda: late.whole["map"] and late.whole["cost_map"] and late.heights)

        def agree():
            late.spin(0.05)
            follower.spin(0.05)
            return not changed_blocks(late.heights, follower.heights).any() and all(
                np.array_equal(late.cells[t], follower.cells[t]) for t in follower.cells
            )

        late.wait(agree)
        robot.scan((0, 2.5), (60, 5.0))
        seen = len(late.whole["map"])
        late.wait(lambda: len(late.whole["map"]) > seen)
        late.wait(agree)
        late.close()
        assert process.poll() is None
    follower.close()
