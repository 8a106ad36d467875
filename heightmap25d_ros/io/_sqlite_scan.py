# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""sqlite3 bags that were not closed: a journal beside them, cut off, or damaged."""

from __future__ import annotations

import shutil
import sqlite3
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from rosbags.interfaces import Connection, MessageDefinition

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io._connections import NO_DEFINITION, connection, definition_of

WRITE_AHEAD_LOG, ROLLBACK_JOURNAL = "-wal", "-journal"

_ROWS = "SELECT timestamp, id, topic_id, data FROM messages WHERE id > ? ORDER BY id"
_LARGEST_STEP, _LARGEST_ROW = 2**20, 2**63 - 1


def journals(path: Path) -> list[Path]:
    """The files beside a database without which it is not whole."""
    beside = [path.with_name(path.name + end) for end in (WRITE_AHEAD_LOG, ROLLBACK_JOURNAL)]
    return [journal for journal in beside if journal.exists() and journal.stat().st_size]


def with_journal(path: Path, directory: Path, warn: Callable[[str], None]) -> Path:
    """A copy of a database with its journals merged into it.

    Parameters
    ----------
    path : Path
        The database; neither it nor its journals are changed.
    directory : Path
        Where to put the copy.
    warn : callable
        Told where nothing of a write-ahead log is used.

    Raises
    ------
    InputError
        If they cannot be merged.
    """
    names = ", ".join(journal.name for journal in journals(path))
    copy = directory / path.name
    try:
        for file in (path, *journals(path)):
            shutil.copyfile(file, directory / file.name)
        with closing(sqlite3.connect(copy)) as database:
            database.execute("SELECT count(*) FROM sqlite_master").fetchone()  # rolls back
            # Closing it as the only one merges the log for good.
            _, frames, _ = database.execute("PRAGMA wal_checkpoint(FULL)").fetchone()
    except (OSError, sqlite3.Error) as error:
        raise InputError(
            f"{path}: {names} beside it cannot be merged in a copy ({error}); "
            f"sqlite3 {path.name} 'PRAGMA wal_checkpoint(TRUNCATE)' merges it"
        ) from None
    if frames <= 0 and any(file.name.endswith(WRITE_AHEAD_LOG) for file in journals(path)):
        warn(f"{path}: {names} does not belong to it or is damaged; it is not read")
    return copy


def missing_bytes(path: Path) -> int:
    """How many bytes a database lacks of what its header says; sqlite reads them as zeros."""
    with path.open("rb") as file:
        header = file.read(100)
    if len(header) < 100:
        return 100 - len(header)
    page_size = int.from_bytes(header[16:18], "big")
    pages = int.from_bytes(header[28:32], "big")
    changes, pages_known_at = header[24:28], header[92:96]
    if changes != pages_known_at:  # of an sqlite that does not write the number of pages
        return 0
    return max(0, pages * (65536 if page_size == 1 else page_size) - path.stat().st_size)


class _Row(NamedTuple):
    """A message's place in the database."""

    stamp_ns: int
    row: int
    topic: int


class SqliteScan:
    """The messages of a damaged sqlite3 bag as far as its pages can be read.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    connections : list of Connection
        As rosbags makes them; ids are those of the topics.
    start_time, end_time : int [ns]
        Of the first message, and just after the last one.
    message_count : int
    problems : list of str
        What could not be read.

    Raises
    ------
    sqlite3.Error
        If not even the topics can be read.
    """

    def __init__(self, path: Path) -> None:
        missing = missing_bytes(path)
        self.problems = [f"its last {missing} bytes are missing"] if missing else []
        self._database = sqlite3.connect(f"file:{quote(str(path))}?mode=ro&immutable=1", uri=True)
        try:
            # A file that is shorter than its header says is read all the same.
            self._database.execute("PRAGMA writable_schema=ON")
            topics = self._topics()
            self._rows = sorted(self._readable_rows())
        except BaseException:
            self._database.close()
            raise
        counts = Counter(row.topic for row in self._rows)
        self.connections = [
            topic._replace(msgcount=counts[topic.id], owner=self) for topic in topics
        ]
        self.message_count = len(self._rows)
        self.start_time = self._rows[0].stamp_ns if self._rows else 2**63 - 1
        self.end_time = self._rows[-1].stamp_ns + 1 if self._rows else 0

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def messages(
        self, connections: Collection[Connection], start: int | None, stop: int | None
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """The messages of some connections in order of time, from start to before stop [ns].

        No bytes stand for a message that cannot be read.
        """
        wanted = {connection.id: connection for connection in connections}
        for stamp_ns, row, topic in self._rows:
            after_start = start is None or stamp_ns >= start
            if topic in wanted and after_start and (stop is None or stamp_ns < stop):
                yield wanted[topic], stamp_ns, self._data(row)

    def _data(self, row: int) -> bytes:
        """A message's bytes; none where damaged pages lead elsewhere."""
        query = "SELECT data FROM messages WHERE id = ?"
        with suppress(sqlite3.Error):
            found = self._database.execute(query, (row,)).fetchone()
            if found is not None and isinstance(found[0], bytes):
                return found[0]
        return b""

    def _topics(self) -> list[Connection]:
        definitions: dict[str, MessageDefinition] = {}
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        # Older bags have none; the types of ROS are known without.
        with suppress(sqlite3.Error):
            for name, encoding, text in self._database.execute(query):
                definitions[name] = definition_of(encoding, text)
        cursor = self._database.execute("SELECT * FROM topics")
        columns = [column[0] for column in cursor.description]
        topics: list[dict[str, Any]] = [dict(zip(columns, row, strict=True)) for row in cursor]
        return [
            connection(
                topic["id"],
                topic["name"],
                topic["type"],
                definitions.get(topic["type"], NO_DEFINITION),
                encoding=topic["serialization_format"],
                profiles=topic.get("offered_qos_profiles", ""),
            )
            for topic in topics
        ]

    def _readable_rows(self) -> Iterator[_Row]:
        """Rows with all of their bytes; what cannot be read is stepped over."""
        after: int | None = 0
        while after is not None:
            try:
                for row in self._rows_after(after):
                    yield row
                    after = row.row
                return
            except sqlite3.Error as error:
                self.problems.append(f"unreadable from row {after + 1} of its messages ({error})")
                after = self._next_readable(after)

    def _next_readable(self, row: int) -> int | None:
        """The first number after a row's from which on something can be read, if there is one."""
        step = 1
        while not self._is_readable(row + step):
            step *= 2
            if step > _LARGEST_STEP:
                return None
        unreadable, readable = step // 2, step
        while readable - unreadable > 1:
            middle = (unreadable + readable) // 2
            if self._is_readable(row + middle):
                readable = middle
            else:
                unreadable = middle
        return row + readable

    def _is_readable(self, after: int) -> bool:
        try:
            next(self._rows_after(after), None)
        except sqlite3.Error:
            return False
        return True

    def _rows_after(self, row: int) -> Iterator[_Row]:
        if row > _LARGEST_ROW:
            return
        for stamp_ns, key, topic, data in self._database.execute(_ROWS, (row,)):
            if not isinstance(key, int) or key <= row:  # damaged pages may lead in circles
                raise sqlite3.DatabaseError("its rows are not in order")
            row = key
            if isinstance(data, bytes) and isinstance(stamp_ns, int) and isinstance(topic, int):
                yield _Row(stamp_ns, key, topic)
