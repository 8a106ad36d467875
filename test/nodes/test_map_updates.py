# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps that are followed by their updates: what goes out, and what listeners make of it."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from bag_writer import laser_scan, odometry, rclpy_type
from node_client import LATCHED, Client, mapping_node
from rclpy.qos import QoSProfile

from heightmap25d_ros.grid.height_map import Area, Geometry
from heightmap25d_ros.nodes import map_updates
from heightmap25d_ros.nodes.map_messages import TOPICS, UPDATED_TOPICS
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
        self.whole = {topic: [] for topic in UPDATED_TOPICS}
        self.updates = {topic: [] for topic in UPDATED_TOPICS}
        self.cells = {}
        self._levels = LevelMap("map", Drops())
        for topic, kind in UPDATED_TOPICS.items():
            self.node.create_subscription(
                TOPICS[topic], topic, partial(self._replace, topic), LATCHED
            )
            if with_updates:
                self.node.create_subscription(
                    kind, f"{topic}_updates", partial(self._update, topic), QoSProfile(depth=10)
                )

    def has_all(self):
        return len(self.cells) == len(UPDATED_TOPICS)

    def _replace(self, topic, message):
        self.whole[topic].append(message)
        if topic == "height_grid":
            self.cells[topic] = self._levels.take_lowest(message).metres
        else:
            shape = message.info.height, message.info.width
            self.cells[topic] = np.array(message.data, np.int8).reshape(shape)

    def _update(self, topic, message):
        self.updates[topic].append(message)
        if topic == "height_grid":
            shown = self._levels.take_update(message)
            self.cells[topic] = self.cells[topic] if shown is None else shown.metres
            return
        rows = slice(message.y, message.y + message.height)
        columns = slice(message.x, message.x + message.width)
        self.cells[topic][rows, columns] = np.reshape(message.data, (message.height, message.width))


def same(one, other):
    """The topics whose cells are those of another one."""
    return [t for t in one if np.array_equal(one[t], other[t], equal_nan=True)]


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


def test_a_listener_that_follows_the_updates_has_the_map_of_one_that_does_not(tmp_path):
    mount = "-p", "intake.mounts:=[0.0, 0.0, 0.5, 0.0, 0.05, 0.0]"
    rate = "-p", "mapping.publish_rate:=10.0"
    follower = Follower("/followed", "follower")
    robot = Robot(follower)
    with mapping_node(tmp_path, *mount, *rate, namespace="/followed") as process:
        robot.scan((0, 2.5))
        follower.wait(follower.has_all)
        follower.spin(1.0)
        count = {topic: len(messages) for topic, messages in follower.whole.items()}
        before = {topic: cells.copy() for topic, cells in follower.cells.items()}
        robot.scan((0, 2.5), (40, 3.0))
        follower.wait(lambda: not same(follower.cells, before))
        follower.spin(1.0)
        assert {topic: len(m) for topic, m in follower.whole.items()} == count
        whole = follower.whole["height_grid"][-1].info
        for update in follower.updates["height_grid"]:
            assert update.header.frame_id == "map"
            assert update.info.map_load_time == whole.map_load_time
            assert update.info.width * update.info.height < 0.7 * whole.width * whole.height
        late = Follower("/followed", "late", with_updates=False)
        late.wait(late.has_all)

        def agree():
            late.spin(0.05)
            follower.spin(0.05)
            return len(same(late.cells, follower.cells)) == len(UPDATED_TOPICS)

        late.wait(agree)
        robot.scan((0, 2.5), (60, 5.0))
        seen = {topic: len(messages) for topic, messages in late.whole.items()}
        late.wait(lambda: all(len(late.whole[topic]) > n for topic, n in seen.items()))
        late.wait(agree)
        late.close()
        assert process.poll() is None
    follower.close()
