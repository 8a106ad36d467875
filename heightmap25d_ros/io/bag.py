# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recorded bags: rosbag2 directories, or one of their files, as events in order of time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat, Qos
from rosbags.rosbag2 import Reader
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from heightmap25d_ros.errors import InputError

LASER_SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"


class Event(NamedTuple):
    """A message and when it was recorded."""

    topic: str
    message_type: str
    stamp_ns: int
    message: Any


class RawEvent(NamedTuple):
    """A message as its serialized bytes (CDR) and when it was recorded."""

    topic: str
    stamp_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Topic:
    """What a bag says of one of its topics; no profiles where it says nothing of them."""

    message_type: str
    count: int
    profiles: tuple[Qos, ...]


class Bag:
    """A rosbag2, sqlite3 or mcap, compressed or not; a context manager.

    Parameters
    ----------
    path : Path or str
        Its directory, or a single .db3 or .mcap file.

    Attributes
    ----------
    topics : dict of topic name to Topic, sorted
    start_ns, end_ns : int [ns]
        When the first and the last message were recorded.
    damaged : Counter of topic name
        Messages skipped by `events` since their bytes do not make a message.

    Raises
    ------
    InputError
        If it does not exist, is damaged or holds no message.

    Examples
    --------
    >>> with Bag("bags/ramp") as bag:
    ...     print(bag.scan_topics(), bag.odometry_topic())
    ...     scan = next(bag.events(["/scan"])).message
    ['/scan', '/scan_down'] /odom
    >>> len(scan.ranges)
    361
    """

    def __init__(self, path: Path | str) -> None:
        self.path = path = Path(path)
        self.damaged: Counter[str] = Counter()
        self._store = get_typestore(Stores.ROS2_JAZZY)
        with self._naming_the_path():
            if path.is_dir() and not (path / "metadata.yaml").exists():
                raise InputError(f"{path}: no metadata.yaml in it; give its .mcap or .db3 file")
            self._reader = Reader(path)
            self._reader.open()
        self._connections: dict[str, list[Connection]] = {}
        for connection in sorted(self._reader.connections, key=lambda c: c.topic):
            same_topic = self._connections.setdefault(connection.topic, [])
            if not same_topic or same_topic[0].msgtype == connection.msgtype:
                same_topic.append(connection)
        self.topics = {name: _topic(same) for name, same in self._connections.items()}
        if not self._reader.message_count:
            self.close()
            raise InputError(f"{path}: holds no messages")
        self.start_ns, self.end_ns = self._reader.start_time, self._reader.end_time - 1

    def close(self) -> None:
        """Close the files."""
        self._reader.close()

    def __enter__(self) -> Bag:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def duration(self) -> float:
        """Time [s] from the first to the last message."""
        return (self.end_ns - self.start_ns) * 1e-9

    def topics_of(self, message_type: str) -> list[str]:
        """Topics with at least one message of a type."""
        return [
            name
            for name, topic in self.topics.items()
            if topic.message_type == message_type and topic.count
        ]

    def require(self, topic: str, message_type: str) -> None:
        """Refuse a topic that is not there or is of another type.

        Raises
        ------
        InputError
            With the topics that there are.
        """
        found = self._of_topic(topic)[0].msgtype
        if found != message_type:
            raise InputError(f"{self.path}: {topic} is a {found}, not a {message_type}")

    def scan_topics(self) -> list[str]:
        """All LaserScan topics.

        Raises
        ------
        InputError
            If there is none.
        """
        found = self.topics_of(LASER_SCAN)
        if not found:
            raise InputError(f"{self.path}: no topic of type {LASER_SCAN}")
        return found

    def odometry_topic(self) -> str:
        """/odom, or the only Odometry topic, or the only one whose name ends in /odom.

        Raises
        ------
        InputError
            If there is none, or it is not clear which one is meant.
        """
        found = self.topics_of(ODOMETRY)
        for candidates in (
            [name for name in found if name == "/odom"],
            found,
            [name for name in found if name.endswith("/odom")],
        ):
            if len(candidates) == 1:
                return candidates[0]
        if found:
            raise InputError(f"{self.path}: name the odometry's topic, one of {', '.join(found)}")
        raise InputError(f"{self.path}: no topic of type {ODOMETRY}")

    def events(self, topics: Collection[str]) -> Iterator[Event]:
        """The messages of some topics, decoded, in order of time.

        A message whose bytes are damaged is skipped and counted in ``damaged``.

        Raises
        ------
        InputError
            If the bag lacks a topic, a type is not known, or the file is damaged.
        """
        types = {name: self._known_type(name) for name in topics}
        for topic, stamp_ns, data in self.raw_events(topics):
            try:
                message = self._store.deserialize_cdr(data, types[topic])
            except SerdeError:
                self.damaged[topic] += 1
                continue
            yield Event(topic, types[topic], stamp_ns, message)

    def raw_events(
        self, topics: Collection[str], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[RawEvent]:
        """The messages of some topics as bytes, in order of time, from start to before stop."""
        connections = [c for name in topics for c in self._of_topic(name)]
        if not connections:
            return
        with self._naming_the_path():
            for connection, stamp_ns, data in self._reader.messages(
                connections, start=start_ns, stop=stop_ns
            ):
                yield RawEvent(connection.topic, stamp_ns, data)

    def _of_topic(self, name: str) -> list[Connection]:
        if name not in self._connections:
            raise InputError(f"{self.path}: no topic {name}; it has {', '.join(self.topics)}")
        return self._connections[name]

    def _known_type(self, topic: str) -> str:
        """The topic's type, learnt from the bag's own definition where ROS does not bring it."""
        connection = self._of_topic(topic)[0]
        name, definition = connection.msgtype, connection.msgdef
        known = self._store.fielddefs
        if name not in known:
            if definition.format is not MessageDefinitionFormat.MSG:
                raise InputError(f"{self.path}: {topic}: type {name} is not known")
            with self._naming_the_path():
                types = get_types_from_msg(definition.data, name)
                self._store.register({name: of for name, of in types.items() if name not in known})
        return name

    @contextmanager
    def _naming_the_path(self) -> Iterator[None]:
        """Whatever the readers of damaged files raise is bad input, told in one line."""
        try:
            yield
        except InputError:
            raise
        except Exception as error:
            reason = " ".join(str(error).split())
            raise InputError(f"{self.path}: {reason} ({type(error).__name__})") from None


def _topic(connections: list[Connection]) -> Topic:
    profiles = [
        profile
        for connection in connections
        if isinstance(connection.ext, ConnectionExtRosbag2)
        for profile in connection.ext.offered_qos_profiles
    ]
    count = sum(connection.msgcount for connection in connections)
    return Topic(connections[0].msgtype, count, tuple(profiles))
