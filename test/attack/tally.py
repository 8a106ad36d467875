# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What becomes of an attack: how much was used, refused, and what failed."""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from heightmap25d_ros.errors import InputError

LONGEST = 1000
"""Characters of the line that refuses something."""


@dataclass
class Tally:
    """Cases of an attack by outcome; each case has a number, which repeats it.

    Attributes
    ----------
    attack : str
    outcomes : Counter of str
        "used", "refused", and what else an attack can end in that is right.
    failures : list of str
        With the number of the case.
    """

    attack: str
    outcomes: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)

    @contextmanager
    def case(self, number: int) -> Iterator[None]:
        """A case that is used unless `InputError` refuses it in one line; all else is a failure."""
        try:
            yield
        except InputError as refusal:
            self.outcomes["refused"] += 1
            line = str(refusal)
            if not line or "\n" in line or len(line) > LONGEST:
                self.failures.append(f"case {number}: refused by {line[:LONGEST]!r}")
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            self.failures.append(
                f"case {number}: {type(error).__name__}: {str(error)[:200]} "
                f"({place.filename}:{place.lineno})"
            )
        else:
            self.outcomes["used"] += 1

    @property
    def row(self) -> str:
        """A row of the table of docs/reliability.md."""
        told = ", ".join(f"{count:,} {name}" for name, count in self.outcomes.most_common())
        return f"| {self.attack} | {told} | {len(self.failures)} |"


def random_of(seed: int, number: int) -> np.random.Generator:
    """The source of all that is random in a case."""
    return np.random.default_rng([seed, number])
