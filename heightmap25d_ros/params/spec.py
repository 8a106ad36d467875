# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is declared of one parameter besides its default, and the checks that follow from it.

`parameter` makes a field of a section out of default, meaning, unit and range; a `Section` checks
its own values by them. The parameters themselves are in `sections`.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from heightmap25d_ros.errors import InputError, quoted

Value = bool | int | float | str | tuple[float, ...] | tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Spec:
    """Meaning, unit and admitted values of a parameter; of a list, the type of its entries."""

    meaning: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    entries: type = float

    @property
    def range_text(self) -> str:
        """The admitted values as text; empty where every value of the type is admitted."""
        if self.choices:
            return " | ".join(self.choices)
        if math.isinf(self.low) and math.isinf(self.high):
            return ""
        return f"{self.low:g} .. {self.high:g}"


def parameter(default: Any, meaning: str, unit: str = "", **limits: Any) -> Any:
    """A field of a section, with its `Spec`; an empty list of strings needs ``entries=str``."""
    if isinstance(default, tuple) and default:
        limits["entries"] = type(default[0])
    return field(default=default, metadata={"spec": Spec(meaning=meaning, unit=unit, **limits)})


class Section:
    """Base of the sections; checks its values when it is made, so that every instance is valid."""

    __slots__ = ()

    def __post_init__(self) -> None:
        section = re.sub(r"\B[A-Z]", r"_\g<0>", type(self).__name__.removesuffix("Params")).lower()
        for name, spec, value in specs(self):
            check(f"{section}.{name}", spec, value)


def specs(section: Any) -> Iterator[tuple[str, Spec, Value]]:
    """Name, spec and value of each parameter of a section."""
    for entry in dataclasses.fields(section):
        yield entry.name, entry.metadata["spec"], getattr(section, entry.name)


def check(name: str, spec: Spec, value: Value) -> None:
    """Check a value against the range and the choices of a parameter.

    Raises
    ------
    InputError
        If it is outside of them.
    """
    if spec.choices and value not in spec.choices:
        raise InputError(
            f"parameter {name}: {quoted(value)} is not one of {', '.join(spec.choices)}"
        )
    for number in value if isinstance(value, tuple) else (value,):
        if isinstance(number, int | float) and not (
            math.isfinite(number) and spec.low <= number <= spec.high
        ):
            raise InputError(f"parameter {name}: {number:g} is not within {spec.range_text}")
