# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files that somebody else wrote: what they are is checked before they are read."""

from __future__ import annotations

import stat
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

from heightmap25d_ros.errors import InputError

LARGEST_YAML = 2**20
"""Bytes of a YAML file: the metadata.yaml of a bag with thousands of topics has fewer."""

MOST_YAML = 40_000
"""Values in a YAML file, which take half a second."""

DEEPEST_YAML = 20
"""Mappings and lists within one another."""

_LONGEST_NUMBER = 400  # characters of what may be a number, or a date
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def require_file(path: Path) -> None:
    """Refuse what has no end or never begins, where a file is read: a FIFO, a device, a socket.

    Raises
    ------
    InputError
        If it is one of them. What does not exist is left to who opens it.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise InputError(f"{path}: is neither a file nor a directory")


def read_yaml(path: Path) -> Any:
    """The content of a YAML file, in which each key is there once.

    Raises
    ------
    InputError
        If it cannot be read, is no YAML, or is larger or deeper than any file of ROS is.
    """
    require_file(path)
    try:
        if path.stat().st_size > LARGEST_YAML:
            raise InputError(f"{path}: has more than {LARGEST_YAML >> 20} MiB")
        text = path.read_text(encoding="utf-8")
        _check(yaml.parse(text, Loader=_LOADER))
        return yaml.load(text, Loader=_LOADER)  # the safe one
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except InputError as error:
        raise InputError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    except Exception as error:  # the loader raises also what int() and date() do
        raise InputError(f"{path}: {' '.join(str(error).split())}") from None


def _check(events: Iterable[Any]) -> None:
    """Refuse depth, recursion, keys that come twice, and what is too much or too long.

    What an alias stands for counts each time, so that a few lines do not become billions.
    """
    count = 0
    open_nodes: list[_Node] = []
    sizes: dict[str | None, int] = {}
    for event in events:
        line = f"line {event.start_mark.line + 1}"
        if isinstance(event, yaml.CollectionEndEvent):
            closed = open_nodes.pop()
            sizes[closed.anchor] = count - closed.begin
        elif isinstance(event, yaml.NodeEvent):
            if open_nodes:
                open_nodes[-1].add(event, line)
            if isinstance(event, yaml.AliasEvent) and event.anchor not in sizes:
                raise InputError(f"{line}: *{event.anchor} is within what it stands for")
            count += sizes[event.anchor] if isinstance(event, yaml.AliasEvent) else 1
            if isinstance(event, yaml.ScalarEvent):
                _check_length(event, line)
                sizes[event.anchor] = 1
            elif isinstance(event, yaml.CollectionStartEvent):
                is_mapping = isinstance(event, yaml.MappingStartEvent)
                open_nodes.append(_Node(event.anchor, count, is_mapping=is_mapping))
                sizes.pop(event.anchor, None)
        if count > MOST_YAML:
            raise InputError(f"{line}: more than {MOST_YAML} values")
        if len(open_nodes) > DEEPEST_YAML:
            raise InputError(f"{line}: nested more than {DEEPEST_YAML} deep")


def _check_length(event: Any, line: str) -> None:
    is_quoted = event.implicit[1] and not event.implicit[0]
    is_text = is_quoted or event.value[:1].isalpha()
    if not is_text and len(event.value) > _LONGEST_NUMBER:
        raise InputError(f"{line}: more than {_LONGEST_NUMBER} characters without quotes")


class _Node:
    """A mapping or a list that is being read, and the keys of a mapping."""

    def __init__(self, anchor: str | None, begin: int, *, is_mapping: bool) -> None:
        self.anchor = anchor
        self.begin = begin
        self._is_mapping = self._is_key = is_mapping
        self._keys: set[str] = set()

    def add(self, event: Any, line: str) -> None:
        """Take the next key or value."""
        if self._is_key:
            if not isinstance(event, yaml.ScalarEvent):
                raise InputError(f"{line}: a key is not a word")
            if event.value in self._keys:
                raise InputError(f"{line}: {event.value} is there twice")
            self._keys.add(event.value)
        self._is_key = self._is_mapping and not self._is_key
