# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An mcap read from its start, record by record: for files without a footer, cut off or damaged.

The format: https://mcap.dev/spec. Numbers are little endian; a record is an opcode (1 byte), the
length of its content (8 bytes) and the content.
"""

from __future__ import annotations

import heapq
import mmap
import struct
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

from rosbags.interfaces import Connection, MessageDefinition

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io._compression import LZ4FrameDecompressor, zstd
from heightmap25d_ros.io._connections import NO_DEFINITION, connection, definition_of

_MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _CHUNK_INDEX, _DATA_END = 2, 3, 4, 5, 6, 8, 15
_LAST_OPCODE, _PRIVATE_OPCODES = 15, 128
_RECORD = struct.Struct("<BQ")
_MESSAGE_HEADER = struct.Struct("<HIQQ")
_CHUNK_HEADER = struct.Struct("<QQQI")
_FOOTER_AT_END = struct.Struct("<BQQQI8s")
_PIECE = 65536

Bytes = bytes | mmap.mmap


class _Record(NamedTuple):
    """Where the content of a record lies; ``stop`` may lie beyond what there is."""

    opcode: int
    start: int
    stop: int


class _Chunk(NamedTuple):
    """Where a chunk's record lies, and what its messages are."""

    offset: int
    stop: int
    channels: frozenset[int]
    start_ns: int
    end_ns: int


class _Loose(NamedTuple):
    """A message outside of chunks: when it was recorded, and where its bytes lie."""

    stamp_ns: int
    start: int
    stop: int
    channel: int


class McapScan:
    """The messages of an mcap as far as its records are whole.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    connections : list of Connection
        As rosbags makes them; ids are those of the channels.
    start_time, end_time : int [ns]
        Of the first message, and just after the last one.
    message_count : int
    problems : list of str
        What could not be read, and where it lies in the file.

    Raises
    ------
    InputError
        If the file is no mcap.
    """

    def __init__(self, path: Path) -> None:
        self.problems: list[str] = []
        self._file = path.open("rb")
        try:
            if self._file.read(len(_MAGIC)) != _MAGIC:
                raise InputError(f"{path}: no mcap file")
            self._bytes = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ)
        except BaseException:
            self._file.close()
            raise
        self._schemas: dict[int, tuple[str, MessageDefinition]] = {}
        self._channels: dict[int, Connection] = {}
        self._counts: Counter[int] = Counter()
        self._chunks: list[_Chunk] = []
        self._loose: list[_Loose] = []
        self._scan()
        self._loose.sort()
        self.connections = [
            channel._replace(msgcount=self._counts[key], owner=self)
            for key, channel in self._channels.items()
        ]
        self.message_count = sum(self._counts.values())
        stamps = [ns for chunk in self._chunks for ns in (chunk.start_ns, chunk.end_ns)]
        stamps += [message.stamp_ns for message in self._loose]
        self.start_time = min(stamps, default=2**63 - 1)
        self.end_time = max(stamps, default=-1) + 1

    def close(self) -> None:
        """Close the file."""
        self._bytes.close()
        self._file.close()

    def messages(
        self, connections: Collection[Connection], start: int | None, stop: int | None
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """The messages of some connections in order of time, from start to before stop [ns]."""
        wanted = {connection.id: connection for connection in connections}
        first, last = start or 0, 2**63 - 1 if stop is None else stop
        sources = [
            self._messages_of(chunk, wanted, first, last)
            for chunk in self._chunks
            if first <= chunk.end_ns and chunk.start_ns < last and chunk.channels & wanted.keys()
        ]
        loose = (
            (m.stamp_ns, m.start, 0, m.channel, self._bytes[m.start : m.stop])
            for m in self._loose
            if m.channel in wanted and first <= m.stamp_ns < last
        )
        for stamp_ns, _, number, channel, data in heapq.merge(loose, *sources):
            if number >= 0:
                yield wanted[channel], stamp_ns, data

    def _messages_of(
        self, chunk: _Chunk, wanted: Collection[int], first: int, last: int
    ) -> Iterator[tuple[int, int, int, int, bytes]]:
        # What comes first has the chunk unpacked only when its time has come.
        yield chunk.start_ns, chunk.offset, -1, 0, b""
        data, _ = _unpacked(self._bytes, chunk.offset, chunk.stop)
        found: list[tuple[int, int, int, int, bytes]] = []
        for record in _records(data, 0):
            if record.opcode != _MESSAGE or record.stop > len(data):
                continue
            channel, stamp_ns, start = _message(data, record)
            if channel in wanted and first <= stamp_ns < last:
                found.append(
                    (stamp_ns, chunk.offset, len(found), channel, data[start : record.stop])
                )
        yield from sorted(found)

    def _scan(self) -> None:
        """Find all chunks and messages from the start of the file to its end."""
        size, offset = len(self._bytes), len(_MAGIC)
        resume_at = iter(_indexed_chunks(self._bytes))
        while offset < size:
            record = next(_records(self._bytes, offset), None)
            if record is None or (record.stop > size and record.opcode != _CHUNK):
                before = offset
                offset = next((chunk for chunk in resume_at if chunk > offset), size)
                self.problems.append(f"unreadable from byte {before} to {offset}")
                continue
            if record.opcode in (_DATA_END, _FOOTER):
                return
            offset = min(record.stop, size)
            if record.opcode == _CHUNK:
                self._take_chunk(record.start, record.stop)
            else:
                self._take(self._bytes, record)
        self.problems.append("no footer")

    def _take_chunk(self, start: int, stop: int) -> None:
        data, problem = _unpacked(self._bytes, start, stop)
        counts: Counter[int] = Counter()
        stamps: list[int] = []
        for record in _records(data, 0):
            if not _is_whole(data, record):
                problem = problem or "a damaged chunk"
            elif record.opcode == _MESSAGE:
                channel, stamp_ns, _ = _message(data, record)
                counts[channel] += 1
                stamps.append(stamp_ns)
            else:
                self._take(data, record)
        if problem:
            self.problems.append(f"{problem} from byte {start} to {min(stop, len(self._bytes))}")
        self._counts += counts
        if stamps:
            chunk = _Chunk(start, stop, frozenset(counts), min(stamps), max(stamps))
            self._chunks.append(chunk)

    def _take(self, data: Bytes, record: _Record) -> None:
        """Take in a schema, a channel or a message outside of chunks."""
        try:
            if record.opcode == _MESSAGE and _is_whole(data, record):
                channel, stamp_ns, start = _message(data, record)
                self._loose.append(_Loose(stamp_ns, start, record.stop, channel))
                self._counts[channel] += 1
            elif record.opcode == _SCHEMA:
                self._take_schema(data[record.start : record.stop])
            elif record.opcode == _CHANNEL:
                self._take_channel(data[record.start : record.stop])
        except (struct.error, UnicodeDecodeError):
            self.problems.append(f"a damaged record from byte {record.start} to {record.stop}")

    def _take_schema(self, content: bytes) -> None:
        (key,) = struct.unpack_from("<H", content)
        name, at = _string(content, 2)
        encoding, at = _string(content, at)
        text, _ = _string(content, at)
        self._schemas.setdefault(key, (name, definition_of(encoding, text)))

    def _take_channel(self, content: bytes) -> None:
        key, schema = struct.unpack_from("<HH", content)
        if key in self._channels:
            return
        topic, at = _string(content, 4)
        encoding, at = _string(content, at)
        end = at + 4 + struct.unpack_from("<I", content, at)[0]
        at += 4
        profiles = ""
        while at < end:
            name, at = _string(content, at)
            value, at = _string(content, at)
            if name == "offered_qos_profiles":
                profiles = value
        name, definition = self._schemas.get(schema, ("of a missing schema", NO_DEFINITION))
        self._channels[key] = connection(
            key, topic, name, definition, encoding=encoding, profiles=profiles
        )


def _records(data: Bytes, offset: int) -> Iterator[_Record]:
    """The records from an offset on, up to the first whose opcode does not exist."""
    while offset + _RECORD.size <= len(data):
        opcode, length = _RECORD.unpack_from(data, offset)
        start = offset + _RECORD.size
        if not (0 < opcode <= _LAST_OPCODE or opcode >= _PRIVATE_OPCODES):
            return
        offset = start + length
        yield _Record(opcode, start, offset)


def _is_whole(data: Bytes, record: _Record) -> bool:
    """Whether a record ends in the data, and is not too short for a message if it is one."""
    shortest = _MESSAGE_HEADER.size if record.opcode == _MESSAGE else 0
    return record.stop <= len(data) and record.stop - record.start >= shortest


def _message(data: Bytes, record: _Record) -> tuple[int, int, int]:
    """A message's channel, when it was recorded [ns], and where its bytes begin."""
    channel, _, stamp_ns, _ = _MESSAGE_HEADER.unpack_from(data, record.start)
    return channel, stamp_ns, record.start + _MESSAGE_HEADER.size


def _string(content: bytes, offset: int) -> tuple[str, int]:
    """A string, and the offset behind it."""
    (length,) = struct.unpack_from("<I", content, offset)
    end = offset + 4 + length
    if end > len(content):
        raise struct.error("a string ends beyond its record")
    return content[offset + 4 : end].decode(), end


def _indexed_chunks(data: Bytes) -> list[int]:
    """Where the chunks' records lie, where a footer tells."""
    offsets: list[int] = []
    if len(data) < _FOOTER_AT_END.size:
        return offsets
    tail = _FOOTER_AT_END.unpack_from(data, len(data) - _FOOTER_AT_END.size)
    opcode, _, summary, *_, magic = tail
    if opcode != _FOOTER or magic != _MAGIC or not 0 < summary < len(data):
        return offsets
    for record in _records(data, summary):
        if record.opcode == _CHUNK_INDEX and record.stop <= len(data):
            offsets.append(struct.unpack_from("<Q", data, record.start + 16)[0])
    return sorted(offsets)


def _unpacked(data: Bytes, start: int, stop: int) -> tuple[bytes, str]:
    """The records in a chunk as far as they can be read, and what is wrong with it."""
    try:
        _, _, size, checksum = _CHUNK_HEADER.unpack_from(data, start)
        head = data[start + _CHUNK_HEADER.size : start + _CHUNK_HEADER.size + 64]
        compression, at = _string(head, 0)
        (length,) = struct.unpack_from("<Q", head, at)
    except (struct.error, UnicodeDecodeError):
        return b"", "a damaged chunk"
    begin = start + _CHUNK_HEADER.size + at + 8
    packed = data[begin : min(begin + length, stop)]
    records = _decompressed(packed, compression)
    if records is None:
        return b"", f"a chunk of unknown compression {compression!r}"
    if stop > len(data):
        return records, "a chunk that is cut off"
    if len(records) < size:
        return records, "a damaged chunk"
    if checksum and crc32(records) != checksum:
        return b"", "a damaged chunk (checksum)"
    return records, ""


def _decompressed(packed: bytes, compression: str) -> bytes | None:
    """What can be decompressed from the start on; None where the compression is not known."""
    if not compression:
        return packed
    decompress: Callable[[bytes], bytes]
    if compression == "zstd":
        decompress = zstd.ZstdDecompressor().decompress
    elif compression == "lz4":
        decompress = LZ4FrameDecompressor().decompress
    else:
        return None
    parts = []
    try:
        for offset in range(0, len(packed), _PIECE):
            parts.append(decompress(packed[offset : offset + _PIECE]))
    except (zstd.ZstdError, RuntimeError, EOFError):
        pass
    return b"".join(parts)
