# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One file of a bag, whatever its format and its state, as messages in order of time."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, Protocol

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag1,
    ConnectionExtRosbag2,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import Reader as Rosbag1Reader
from rosbags.rosbag2 import Reader as Rosbag2Reader
from rosbags.typesys import TypesysError, get_types_from_msg
from rosbags.typesys.store import Typestore

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io._compression import zstd
from heightmap25d_ros.io._mcap_scan import McapScan
from heightmap25d_ros.io._sqlite_scan import SqliteScan, missing_bytes

Messages = Iterator[tuple[Connection, int, bytes]]
Warn = Callable[[str], None]

ROSBAG1 = ".bag"
SCANS: dict[str, Callable[[Path], McapScan | SqliteScan]] = {".mcap": McapScan, ".db3": SqliteScan}
"""How an unfinished or damaged file is read, by its suffix."""

_REPAIR = {
    ".mcap": "`mcap recover` repairs what can be repaired",
    ".db3": "`sqlite3 FILE .recover` and `ros2 bag reindex` repair what can be repaired",
    ROSBAG1: "`rosbag reindex` of ROS 1 repairs what can be repaired",
}
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
_FOREVER = QosTime(2147483647, 4294967295)
_LATCHED = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    _FOREVER,
    _FOREVER,
    QosLiveliness.AUTOMATIC,
    _FOREVER,
    False,
)


class Storage(Protocol):
    """A file of messages, open."""

    @property
    def connections(self) -> list[Connection]:
        """What it has messages of; their ids are unique in the file."""

    @property
    def start_time(self) -> int:
        """When the first message was recorded [ns]."""

    @property
    def end_time(self) -> int:
        """Just after the last message was recorded [ns]."""

    @property
    def message_count(self) -> int:
        """How many messages it has."""

    def messages(
        self, connections: Collection[Connection], start: int | None, stop: int | None
    ) -> Messages:
        """The messages of some connections in order of time, from start to before stop [ns].

        No bytes stand for a message that cannot be read.
        """

    def close(self) -> None:
        """Close the file."""


def one_line(error: BaseException) -> str:
    """What an exception of a reader says."""
    return " ".join(str(error).split()) or type(error).__name__


class Rosbag2File:
    """An mcap or sqlite3 file; read as far as it goes where it is unfinished or damaged.

    Parameters
    ----------
    path : Path
    name : Path
        How it is called in messages: ``path`` may be a copy.
    warn : callable
        Told what cannot be read.
    is_compressed : bool or None
        Whether each message is compressed; None where only the messages can tell.

    Raises
    ------
    InputError
        If nothing can be read.
    """

    def __init__(
        self, path: Path, name: Path, warn: Warn, *, is_compressed: bool | None = None
    ) -> None:
        self._path, self._name, self._warn = path, name, warn
        self._scan: McapScan | SqliteScan | None = None
        self._source: Storage
        try:
            if not path.stat().st_size:
                raise InputError("empty")
            if path.suffix == ".db3" and missing_bytes(path):
                raise InputError("cut off")
            reader = Rosbag2Reader(path)
            reader.open()
        except Exception as error:
            self._source = self._scanned(error)
        else:
            self._source = reader
            if not _is_indexed(reader):
                reader.close()
                self._source = self._scan = McapScan(path)
        self.connections = list(self._source.connections)
        self.start_time, self.end_time = self._source.start_time, self._source.end_time
        self.message_count = self._source.message_count
        if is_compressed is None:
            first = next(self._whole(self.connections, None, None), (None, 0, b""))
            is_compressed = first[2][:4] == _ZSTD_MAGIC  # CDR begins with a zero
        self._is_compressed = is_compressed

    def close(self) -> None:
        """Close the file."""
        self._source.close()

    def messages(
        self, connections: Collection[Connection], start: int | None, stop: int | None
    ) -> Messages:
        """The messages of some connections in order of time, from start to before stop [ns]."""
        messages = self._whole(connections, start, stop)
        return map(_decompressed, messages) if self._is_compressed else messages

    def _whole(
        self, connections: Collection[Connection], start: int | None, stop: int | None
    ) -> Messages:
        """All that can be read: behind what is damaged, the scan goes on where rosbags ended."""
        count = 0
        try:
            for connection, stamp_ns, data in self._source.messages(connections, start, stop):
                yield _with_types(connection, stamp_ns, data)
                count += 1
        except Exception as error:
            if self._scan is not None:
                raise
            source = self._scanned(error)
            self._source.close()
            self._source = source
            yield from islice(source.messages(connections, start, stop), count, None)

    def _scanned(self, error: Exception) -> Storage:
        suffix = self._path.suffix
        reason = one_line(error).replace(str(self._path), str(self._name)).rstrip(".")
        repair = _REPAIR.get(suffix, "")
        if suffix not in SCANS:
            raise InputError(f"{self._name}: {reason}") from None
        try:
            scan = SCANS[suffix](self._path)
        except Exception:  # whatever the reader of a damaged file raises
            raise InputError(f"{self._name}: {reason}; {repair}") from None
        problems = _listed(scan.problems) or "its index cannot be used"
        if not scan.message_count:
            scan.close()
            raise InputError(f"{self._name}: no message can be read ({problems}); {repair}")
        self._scan = scan
        self._warn(
            f"{self._name}: unfinished or damaged ({problems}); "
            f"{scan.message_count} messages are read; {repair}"
        )
        return scan


class Rosbag1File:
    """A .bag file of ROS 1, its messages converted to CDR.

    A connection whose type is defined otherwise in ROS 2 has "of ROS 1" behind its type.

    Parameters
    ----------
    path : Path
    store : Typestore
        Of ROS 2; learns the types that only the bag knows.
    warn : callable
        Told what cannot be read.

    Raises
    ------
    InputError
        If it cannot be read.
    """

    def __init__(self, path: Path, store: Typestore, warn: Warn) -> None:
        self._path, self._store, self._warn = path, store, warn
        self._reader = Rosbag1Reader(path)
        try:
            self._reader.open()
        except Exception as error:
            raise InputError(f"{path}: {one_line(error)}; {_REPAIR[ROSBAG1]}") from None
        self.connections = [self._converted(connection) for connection in self._reader.connections]
        self.start_time, self.end_time = self._reader.start_time, self._reader.end_time
        self.message_count = self._reader.message_count

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    def messages(
        self, connections: Collection[Connection], start: int | None, stop: int | None
    ) -> Messages:
        """The messages of some connections in order of time, from start to before stop [ns]."""
        wanted = {connection.id: connection for connection in connections}
        own = [connection for connection in self._reader.connections if connection.id in wanted]
        stamp_ns = self.start_time
        try:
            for connection, stamp_ns, data in self._reader.messages(own, start, stop):
                converted = wanted[connection.id]
                yield converted, stamp_ns, self._cdr(data, converted.msgtype)
        except Exception as error:
            seconds = (stamp_ns - self.start_time) * 1e-9
            self._warn(
                f"{self._path}: damaged, nothing behind {seconds:.3f} s is read "
                f"({one_line(error)}); {_REPAIR[ROSBAG1]}"
            )

    def _cdr(self, data: bytes, message_type: str) -> bytes:
        try:
            return bytes(self._store.ros1_to_cdr(data, message_type))
        except Exception:  # whatever the converter raises on a damaged message
            return b""

    def _converted(self, connection: Connection) -> Connection:
        name = connection.msgtype
        if name in _RENAMED:
            name = _RENAMED[name]
        else:
            try:
                types = get_types_from_msg(connection.msgdef.data, name)
                types.pop("std_msgs/msg/Header", None)  # its seq is left out
                self._store.register(types)
            except TypesysError:
                name = f"{name} of ROS 1"
        is_latching = isinstance(connection.ext, ConnectionExtRosbag1) and connection.ext.latching
        extension = ConnectionExtRosbag2("cdr", [_LATCHED] if is_latching else [])
        return connection._replace(msgtype=name, ext=extension)


def _listed(problems: Sequence[str]) -> str:
    """The first few problems in a line."""
    more = [f"{len(problems) - 3} more"] if len(problems) > 3 else []
    return "; ".join([*problems[:3], *more])


def _is_indexed(reader: Rosbag2Reader) -> bool:
    """Whether rosbags finds all messages of an mcap, in order of time, by its index."""
    chunks: list[Any] | None = getattr(reader.storage, "chunks", None)
    if chunks is None:
        return True
    return sum(sum(chunk.channel_count.values()) for chunk in chunks) == reader.message_count


def _with_types(connection: Connection, stamp_ns: Any, data: Any) -> tuple[Connection, int, bytes]:
    """A message whose stamp is a number; of bytes or, where a database has text, of none."""
    if not isinstance(stamp_ns, int):
        raise InputError("a stamp is not a number")
    return connection, stamp_ns, data if isinstance(data, bytes) else b""


def _decompressed(message: tuple[Connection, int, bytes]) -> tuple[Connection, int, bytes]:
    connection, stamp_ns, data = message
    try:
        return connection, stamp_ns, zstd.decompress(data)
    except zstd.ZstdError:
        return connection, stamp_ns, b""
