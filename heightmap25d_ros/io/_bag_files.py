# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which files a bag consists of, and what its metadata.yaml says of them."""

from __future__ import annotations

import re
import shutil
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

from rosbags.interfaces import Connection
from rosbags.typesys.store import Typestore

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.input_files import read_yaml, require_file
from heightmap25d_ros.io._compression import zstd
from heightmap25d_ros.io._connections import NO_DEFINITION, connection
from heightmap25d_ros.io._sqlite_scan import journals, with_journal
from heightmap25d_ros.io._storage import (
    ROSBAG1,
    SCANS,
    Rosbag1File,
    Rosbag2File,
    Storage,
    Warn,
    one_line,
)

METADATA = "metadata.yaml"
_COMPRESSED = ".zstd"
_REINDEX = f"`ros2 bag reindex` writes {METADATA} anew"


@dataclass(frozen=True, slots=True)
class Metadata:
    """What a metadata.yaml says.

    Attributes
    ----------
    files : list of str
        Names of the bag's files.
    file_counts : dict of file name to int
        Messages of each file, where it says so.
    connections : list of Connection
        The topics, with how many messages they have.
    compression_mode : str
        Empty, ``file`` or ``message``.
    """

    files: list[str]
    file_counts: dict[str, int]
    connections: list[Connection]
    compression_mode: str


def read_metadata(directory: Path, warn: Warn) -> Metadata | None:
    """Read a bag's metadata.yaml; None, and a warning, where it is missing or unusable.

    Raises
    ------
    InputError
        If the bag is compressed in a way that is not known.
    """
    path = directory / METADATA
    if not path.exists():
        warn(f"{directory}: no {METADATA}; all its files are read; {_REINDEX}")
        return None
    try:
        content = read_yaml(path)["rosbag2_bagfile_information"]
        metadata = _metadata(content)
    except Exception as error:  # whatever the loader or a wrong structure raises
        reason = f"{one_line(error)}, {type(error).__name__}"
        warn(f"{path}: unusable ({reason}); all files beside it are read; {_REINDEX}")
        return None
    compression_format = content.get("compression_format")
    if metadata.compression_mode and compression_format != "zstd":
        raise InputError(f"{path}: compression_format {compression_format!r} is not supported")
    return metadata


def _metadata(content: Any) -> Metadata:
    mode = str(content.get("compression_mode") or "").lower()
    topics = content["topics_with_message_count"] or []
    return Metadata(
        files=[PurePosixPath(name).name for name in content["relative_file_paths"]],
        file_counts={
            PurePosixPath(file["path"]).name: int(file["message_count"])
            for file in content.get("files") or []
        },
        connections=[
            connection(
                -1,
                topic["topic_metadata"]["name"],
                topic["topic_metadata"]["type"],
                NO_DEFINITION,
                encoding=topic["topic_metadata"]["serialization_format"],
                profiles=topic["topic_metadata"].get("offered_qos_profiles", []),
            )._replace(msgcount=int(topic["message_count"]))
            for topic in topics
        ],
        compression_mode="" if mode == "none" else mode,
    )


def open_files(
    path: Path, store: Typestore, stack: ExitStack, warn: Warn
) -> tuple[list[Storage], list[Connection]]:
    """Open the files of a bag.

    Parameters
    ----------
    path : Path
        A rosbag2 directory, with or without metadata.yaml, or a file: .mcap, .db3, .bag.
    store : Typestore
        Of ROS 2; learns the types of a ROS 1 bag.
    stack : ExitStack
        Closes them.
    warn : callable
        Told what cannot be read.

    Returns
    -------
    storages : list of Storage, in order of time
    connections : list of Connection
        What metadata.yaml says of the topics, with how many messages they should have.

    Raises
    ------
    InputError
        If nothing can be read.
    """
    if not path.exists():
        raise InputError(f"{path}: does not exist")
    metadata = read_metadata(path, warn) if path.is_dir() else None
    files = _files(path, metadata, warn) if path.is_dir() else [path]
    opened: dict[Path, Storage] = {}
    failures: list[InputError] = []
    for file in files:
        try:
            opened[file] = _open(file, metadata, store, stack, warn)
            stack.callback(opened[file].close)
        except InputError as error:
            failures.append(error)
    if not opened:
        raise failures[0]
    for failure in failures:
        warn(str(failure))
    if metadata is not None:
        _hold_against(path, metadata, opened, warn)
    storages = sorted(opened.values(), key=lambda storage: storage.start_time)
    return storages, metadata.connections if metadata else []


def _files(directory: Path, metadata: Metadata | None, warn: Warn) -> list[Path]:
    """The files of a bag: those that metadata.yaml names, and what lies beside them."""
    found = {file.name: file for file in sorted(directory.iterdir()) if _is_storage(file)}
    listed = [name for name in metadata.files if (directory / name).exists()] if metadata else []
    if metadata is not None and listed:
        for name in sorted(set(metadata.files).difference(listed)):
            warn(f"{directory / name}: does not exist, though {METADATA} lists it")
        for name in sorted(found.keys() - set(listed)):
            if _continues(name, listed):
                warn(f"{found[name]}: not in {METADATA}, and read as well; {_REINDEX}")
                listed.append(name)
            else:
                warn(f"{found[name]}: not in {METADATA}, and not read; {_REINDEX}")
        return [directory / name for name in listed]
    if metadata is not None:
        names = ", ".join(metadata.files)
        if not found:
            raise InputError(f"{directory}: {names or 'its file'} does not exist")
        warn(f"{directory}: {METADATA} names {names or 'no file'}, but {', '.join(found)} is read")
    if not found:
        raise InputError(f"{directory}: no {METADATA} in it, and no .mcap or .db3 file")
    if len({_suffix(file) for file in found.values()}) > 1:
        raise InputError(
            f"{directory}: no usable {METADATA} in it, and .mcap and .db3 files; name one of them"
        )
    return list(found.values())


def _suffix(file: Path) -> str:
    return file.with_suffix("").suffix if file.suffix == _COMPRESSED else file.suffix


def _is_storage(file: Path) -> bool:
    return _suffix(file) in SCANS and file.is_file()


def _continues(name: str, listed: Sequence[str]) -> bool:
    """Whether a file is a later part of a split bag: NAME_3.mcap after NAME_2.mcap."""
    part = re.fullmatch(r"(.*_)(\d+)(\..*)", name)
    parts = [re.fullmatch(r"(.*_)(\d+)(\..*)", other) for other in listed]
    return part is not None and all(
        other is not None and other.group(1, 3) == part.group(1, 3) and int(other[2]) < int(part[2])
        for other in parts
    )


def _open(
    file: Path, metadata: Metadata | None, store: Typestore, stack: ExitStack, warn: Warn
) -> Storage:
    require_file(file)
    if file.suffix == ROSBAG1:
        return Rosbag1File(file, store, warn)
    is_compressed = metadata.compression_mode == "message" if metadata else None
    path = file
    if file.suffix == _COMPRESSED:
        path = _unpacked(file, Path(stack.enter_context(TemporaryDirectory())), warn)
    elif file.suffix == ".db3" and journals(file):
        path = with_journal(file, Path(stack.enter_context(TemporaryDirectory())), warn)
    return Rosbag2File(path, file, warn, is_compressed=is_compressed)


def _unpacked(file: Path, directory: Path, warn: Warn) -> Path:
    """A compressed file decompressed into a directory, as far as it goes."""
    path = directory / file.stem
    with file.open("rb") as packed, zstd.open(packed, "rb") as source, path.open("wb") as target:
        try:
            shutil.copyfileobj(source, target)
        except (EOFError, zstd.ZstdError) as error:
            problem = f"{file}: cut off or damaged ({one_line(error)})"
            if not target.tell():
                raise InputError(f"{problem}; nothing can be decompressed") from None
            warn(problem)
    return path


def _hold_against(path: Path, metadata: Metadata, opened: dict[Path, Storage], warn: Warn) -> None:
    """Warn where there are more or fewer messages than metadata.yaml counts."""
    found: Counter[str] = Counter()
    expected: Counter[str] = Counter()
    for storage in opened.values():
        for stored in storage.connections:
            found[stored.topic] += stored.msgcount
    for listed in metadata.connections:
        expected[listed.topic] += listed.msgcount
    topics = [
        f"{topic} {found[topic]} of {expected[topic]}"
        for topic in sorted(found | expected)
        if found[topic] != expected[topic]
    ]
    if topics:
        files = [
            f"{file.name} {storage.message_count} of {metadata.file_counts[file.name]}"
            for file, storage in opened.items()
            if metadata.file_counts.get(file.name, storage.message_count) != storage.message_count
        ]
        warn(
            f"{path}: holds {found.total()} messages, {METADATA} counts {expected.total()}: "
            f"{', '.join(files + topics)}"
        )
