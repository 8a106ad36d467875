# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""mcap files record by record, as recorders leave them that are not rosbags' writer."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import Any
from zlib import crc32

import lz4.frame
from bag_writer import STORE

MAGIC = b"\x89MCAP0\r\n"
MESSAGE, CHUNK = 5, 6


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def string(text: str) -> bytes:
    return struct.pack("<I", len(text.encode())) + text.encode()


def header(profile: str = "ros2") -> bytes:
    return MAGIC + record(1, string(profile) + string("test"))


def channel(key: int, topic: str, message_type: str, encoding: str = "cdr") -> bytes:
    """A schema and a channel of the same number."""
    definition, _ = STORE.generate_msgdef(message_type, ros_version=2)
    schema = struct.pack("<H", key) + string(message_type) + string("ros2msg") + string(definition)
    content = struct.pack("<HH", key, key) + string(topic) + string(encoding) + string("")
    return record(3, schema) + record(4, content)


def message(key: int, stamp_ns: int, content: Any) -> bytes:
    data = bytes(STORE.serialize_cdr(content, content.__msgtype__))
    return record(MESSAGE, struct.pack("<HIQQ", key, 0, stamp_ns, stamp_ns) + data)


def chunk(records: bytes, stamps: Iterable[int], compression: str = "") -> bytes:
    stamps = list(stamps)
    packed = lz4.frame.compress(records) if compression == "lz4" else records
    return record(
        CHUNK,
        struct.pack("<QQQI", min(stamps), max(stamps), len(records), crc32(records))
        + string(compression)
        + struct.pack("<Q", len(packed))
        + packed,
    )


def end() -> bytes:
    """The end of a file without a summary."""
    return record(15, bytes(4)) + record(2, bytes(20)) + MAGIC
