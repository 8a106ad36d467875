# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What was not used, and why: the one place where messages are decoded or counted as dropped."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from typing import Any, TypeVar

from heightmap25d_ros.errors import InputError

_Value = TypeVar("_Value")

BEYOND_RANGE_MAX, BELOW_RANGE_MIN = "return: beyond range_max", "return: below range_min"
"""Reasons that are usual with some lasers, and are told only where most returns are so."""

_LONGEST_EXAMPLE = 200
"""Characters of an example, whose text may come from anybody on the network."""


class Drops(Counter[str]):
    """How many messages, scans and returns were not used, by reason.

    The reasons are a closed set, so that foreign text can neither fill the memory nor the log; what
    is particular to one case (frames, numbers) is kept as the newest example of its reason.

    Attributes
    ----------
    examples : dict of reason to str
    notices : list of str
        What was used, but not as it came: each sentence once.
    """

    def __init__(self) -> None:
        super().__init__()
        self.examples: dict[str, str] = {}
        self.notices: list[str] = []
        self._told = 0

    def record(self, reason: str, example: str = "", count: int = 1) -> None:
        """Count what was dropped for a reason; a count of 0 leaves no trace."""
        if not count:
            return
        self[reason] += count
        if example:
            self.examples[reason] = example[:_LONGEST_EXAMPLE]

    def notice(self, sentence: str) -> None:
        """Say once how something was used that is not as it should be."""
        if sentence not in self.notices:
            self.notices.append(sentence)

    def new_notices(self) -> list[str]:
        """The notices since the last call."""
        new, self._told = self.notices[self._told :], len(self.notices)
        return new

    def decoded(self, kind: str, decode: Callable[[Any], _Value], message: Any) -> _Value | None:
        """What is decoded from a message; None, and counted, where the message is malformed.

        Parameters
        ----------
        kind : str
            Of the message, with which the reason begins.
        decode : callable
            Raises `InputError`, which begins with the field.
        message : a message, by duck type
        """
        try:
            return decode(message)
        except InputError as error:
            field = re.sub(r"\[\d+\]", "", str(error).partition(":")[0])
            is_name = re.fullmatch(r"[a-z_.]+", field)
            self.record(f"{kind}: bad {field if is_name else 'content'}", str(error))
            return None

    @property
    def notable(self) -> int:
        """How many drops there are for reasons that are never usual."""
        return self.total() - self[BEYOND_RANGE_MAX] - self[BELOW_RANGE_MIN]

    def __str__(self) -> str:
        """All reasons in one line, the most frequent one first."""
        return "; ".join(self.described(reason) for reason, _ in self.most_common())

    def described(self, reason: str) -> str:
        """A reason with its count and its newest example."""
        example = self.examples.get(reason)
        return f"{reason} ({self[reason]}{f', the last one: {example}' if example else ''})"
