# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recorded bags: rosbag2 directories, or one of their files, as events in order of time.

Nothing is lost in silence: what cannot be read is counted, logged as a warning, or an error.
"""

from __future__ import annotations

import heapq
import logging
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from itertools import chain, pairwise
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from rosbags.interfaces import Connection
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io._bag_files import open_files
from heightmap25d_ros.io._definitions import learn
from heightmap25d_ros.io._topics import (
    CLOUD_TYPES,
    LASER_SCAN,
    ODOMETRY,
    POINT_CLOUD,
    POSE,
    POSE_WITH_COVARIANCE,
    TF_MESSAGE,
    Topic,
    topic_of,
    type_of,
)

__all__ = [
    "LASER_SCAN",
    "ODOMETRY",
    "POINT_CLOUD",
    "POSE",
    "POSE_WITH_COVARIANCE",
    "TF_MESSAGE",
    "Bag",
    "Event",
    "RawEvent",
    "Topic",
]

_log = logging.getLogger(__name__)


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


class Bag:
    """A rosbag2, sqlite3 or mcap, compressed or not, or a ROS 1 bag; a context manager.

    An unfinished or damaged bag is read as far as it goes, with a warning.

    Parameters
    ----------
    path : Path or str
        Its directory, or a single .db3, .mcap or .bag file.

    Attributes
    ----------
    topics : dict of topic name to Topic, sorted
    start_ns, end_ns : int [ns]
        When the first and the last message were recorded.
    damaged : Counter of topic name
        Messages skipped when it was last read, since their bytes do not make a message.
    other_types : Counter of "topic (type)"
        Messages that were not read since their topic was read as another type.
    warnings : list of str
        What could not be read as recorded, a line each; logged as well.

    Raises
    ------
    InputError
        If it does not exist, nothing in it can be read, or it holds no message.

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
        self.other_types: Counter[str] = Counter()
        self.warnings: list[str] = []
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._stack = ExitStack()
        try:
            with self._naming_the_path():
                self._open()
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        self._storages, listed = open_files(self.path, self._store, self._stack, self._warn)
        self._connections: dict[str, list[Connection]] = {}
        stored = [of for storage in self._storages for of in storage.connections]
        known = {(of.topic, type_of(of)) for of in stored}
        # Of topics without messages only metadata.yaml tells.
        stored += [of._replace(msgcount=0) for of in listed if (of.topic, type_of(of)) not in known]
        for connection in sorted(stored, key=lambda of: of.topic):
            self._connections.setdefault(connection.topic, []).append(connection)
        self.topics = {name: topic_of(same) for name, same in self._connections.items()}
        if not any(storage.message_count for storage in self._storages):
            raise InputError(f"{self.path}: holds no messages")
        self.start_ns = min(storage.start_time for storage in self._storages)
        self.end_ns = max(storage.end_time for storage in self._storages) - 1

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

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
            for name, same in self._connections.items()
            if any(of.msgcount for of in same if type_of(of) == message_type)
        ]

    def require(self, topic: str, message_type: str) -> None:
        """Refuse a topic that is not there or is of another type.

        Warns if it has no messages of the type, or messages of other types.

        Raises
        ------
        InputError
            With the topics that there are.
        """
        types = list(dict.fromkeys(map(type_of, self._of_topic(topic))))
        if message_type not in types:
            raise InputError(
                f"{self.path}: {topic} is a {' and a '.join(types)}, not a {message_type}"
            )
        for connection in self._of_topic(topic):
            if type_of(connection) != message_type:
                self._note_other(connection, message_type)
        if topic not in self.topics_of(message_type):
            self._warn(f"{self.path}: {topic} ({message_type}) holds no messages")

    def cloud_topics(self) -> list[str]:
        """All topics of clouds, of each of `CLOUD_TYPES`, sorted."""
        return sorted({topic for kind in CLOUD_TYPES for topic in self.topics_of(kind)})

    def cloud_type(self, topic: str) -> str:
        """The type of the clouds of a topic; PointCloud2 where it has none."""
        types = set(map(type_of, self._connections.get(topic, ())))
        return next((kind for kind in CLOUD_TYPES if kind in types), POINT_CLOUD)

    def scan_topics(self) -> list[str]:
        """All LaserScan topics.

        Raises
        ------
        InputError
            If there is none.
        """
        found = self.topics_of(LASER_SCAN)
        if not found:
            raise self._without(LASER_SCAN)
        return found

    def odometry_topic(self, message_type: str = ODOMETRY) -> str:
        """/odom, or the only topic of a type, or the only one whose name ends in /odom.

        Raises
        ------
        InputError
            If there is none, or it is not clear which one is meant.
        """
        found = self.topics_of(message_type)
        for candidates in (
            [name for name in found if name == "/odom"],
            found,
            [name for name in found if name.endswith("/odom")],
        ):
            if len(candidates) == 1:
                return candidates[0]
        if found:
            raise InputError(f"{self.path}: name the odometry's topic, one of {', '.join(found)}")
        raise self._without(message_type)

    def events(
        self,
        topics: Collection[str],
        types: Mapping[str, str] | None = None,
        start_ns: int | None = None,
        stop_ns: int | None = None,
        readers: Mapping[str, Callable[[bytes], Any]] | None = None,
    ) -> Iterator[Event]:
        """The messages of some topics, decoded, in order of time, from start to before stop.

        A message whose bytes are damaged is skipped and counted in ``damaged``.

        Parameters
        ----------
        topics : collection of str
        types : dict of topic name to message type, optional
            What to read a topic as, if not as its ``Topic.message_type``. Messages of other types
            on a topic are counted in ``other_types``.
        start_ns, stop_ns : int [ns], optional
            When they were recorded; all by default.
        readers : dict of message type to callable, optional
            What decodes the bytes of some types in place of rosbags, as `message_bytes` does; where
            it raises `InputError`, rosbags does.

        Raises
        ------
        InputError
            If the bag lacks a topic, a type is not known, or the file is damaged.
        """
        read_as = self._read_as(topics, types)
        with self._naming_the_path():
            for name, message_type in read_as.items():
                learn(self._store, message_type, self._of_topic(name))
        for topic, stamp_ns, data in self._raw_events(read_as, start_ns, stop_ns):
            try:
                message = self._message(data, read_as[topic], (readers or {}).get(read_as[topic]))
            except SerdeError:
                self.damaged[topic] += 1
                continue
            yield Event(topic, read_as[topic], stamp_ns, message)
        for topic in read_as:
            if self.damaged[topic]:
                count = self.damaged[topic]
                self._warn(f"{self.path}: {topic}: {count} damaged messages are skipped")

    def _message(self, data: bytes, message_type: str, read: Callable[[bytes], Any] | None) -> Any:
        if read is not None:
            with suppress(InputError):
                return read(data)
        return self._store.deserialize_cdr(data, message_type)

    def raw_events(
        self, topics: Collection[str], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[RawEvent]:
        """The messages of some topics as bytes, in order of time, from start to before stop.

        Each topic as its ``Topic.message_type``; what is not read is counted as by `events`.
        """
        return self._raw_events(self._read_as(topics), start_ns, stop_ns)

    def _raw_events(
        self, read_as: Mapping[str, str], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[RawEvent]:
        for name in read_as:
            self.damaged.pop(name, None)
        wanted = {
            id(of)
            for name, message_type in read_as.items()
            for of in self._of_topic(name)
            if type_of(of) == message_type or self._note_other(of, message_type)
        }
        parts = [
            storage.messages(connections, start_ns, stop_ns)
            for storage in self._storages
            if (connections := [of for of in storage.connections if id(of) in wanted])
        ]
        in_turn = all(one.end_time <= other.start_time for one, other in pairwise(self._storages))
        merged = chain.from_iterable(parts) if in_turn else heapq.merge(*parts, key=_stamp)
        with self._naming_the_path():
            for connection, stamp_ns, data in merged:
                if not data:
                    self.damaged[connection.topic] += 1
                    continue
                yield RawEvent(connection.topic, stamp_ns, data)

    def _read_as(
        self, topics: Collection[str], types: Mapping[str, str] | None = None
    ) -> dict[str, str]:
        """The type that each topic is read as."""
        for name in topics:
            self._of_topic(name)
        return {name: (types or {}).get(name, self.topics[name].message_type) for name in topics}

    def _note_other(self, connection: Connection, message_type: str) -> bool:
        """Count the messages of a type that is not read; always false."""
        if connection.msgcount:
            other = type_of(connection)
            count = sum(
                of.msgcount for of in self._of_topic(connection.topic) if type_of(of) == other
            )
            self.other_types[f"{connection.topic} ({other})"] = count
            self._warn(
                f"{self.path}: {connection.topic}: {count} messages of type {other} are not read, "
                f"only those of type {message_type}"
            )
        return False

    def _of_topic(self, name: str) -> list[Connection]:
        if name not in self._connections:
            raise InputError(f"{self.path}: no topic {name}; it has {', '.join(self.topics)}")
        return self._connections[name]

    def _without(self, message_type: str) -> InputError:
        """What to say where no topic has messages of a type."""
        silent = [
            name for name, same in self._connections.items() if message_type in map(type_of, same)
        ]
        if silent:
            return InputError(
                f"{self.path}: {', '.join(silent)} ({message_type}) holds no messages"
            )
        return InputError(f"{self.path}: no topic of type {message_type}")

    def _warn(self, line: str) -> None:
        """Log a line, once."""
        if line not in self.warnings:
            self.warnings.append(line)
            _log.warning(line)

    @contextmanager
    def _naming_the_path(self) -> Iterator[None]:
        """Whatever the readers of damaged files raise is bad input, told in one line."""
        try:
            yield
        except InputError as error:
            if str(self.path) in str(error):
                raise
            raise InputError(f"{self.path}: {error}") from None
        except Exception as error:
            reason = " ".join(str(error).split())
            raise InputError(f"{self.path}: {reason} ({type(error).__name__})") from None


def _stamp(message: tuple[Connection, int, bytes]) -> int:
    return message[1]
