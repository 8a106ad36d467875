# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A search that is done in slices, between which messages are handled."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Generic, TypeVar

_Result = TypeVar("_Result")


class SlicedSearch(ABC, Generic[_Result]):
    """What is searched, and how, is that of the subclasses."""

    def __init__(self) -> None:
        self._result: _Result | None = None
        self._work = self._run()

    @abstractmethod
    def _run(self) -> Iterator[_Result | None]:
        """The search, in pieces of some milliseconds; the last one is its result."""

    @property
    def result(self) -> _Result:
        """What was found.

        Raises
        ------
        ValueError
            Before `step` has returned true.
        """
        if self._result is None:
            raise ValueError("the search is not done")
        return self._result

    def step(self, seconds: float) -> bool:
        """Go on for about this time [s]; whether the search is done."""
        end = time.monotonic() + seconds
        while self._result is None:
            self._result = next(self._work)
            if time.monotonic() >= end:
                break
        return self._result is not None

    def finish(self) -> _Result:
        """Go on to the end; what was found."""
        self.step(math.inf)
        return self.result
