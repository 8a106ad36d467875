# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every tunable number, once: default, unit, range and meaning.

One frozen section per module; the module takes its own section, the nodes declare ROS
parameters from it (``section.name``), and `parameter_file` writes ``config/heightmap25d.yaml``
and the table of docs/interface.md from it.
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping
from typing import Any

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.params.spec import Spec, Value, specs


def flatten(params: Params) -> dict[str, tuple[Spec, Value]]:
    """``section.name`` -> spec and value, in order of definition."""
    found: dict[str, tuple[Spec, Value]] = {}
    for entry in dataclasses.fields(params):
        content = getattr(params, entry.name)
        if "spec" in entry.metadata:
            found[entry.name] = entry.metadata["spec"], content
        else:
            found |= {f"{entry.name}.{name}": (s, value) for name, s, value in specs(content)}
    return found


_LIVE = (
    "sensor.min_range", "sensor.max_range", "sensor.clearing_range", "sensor.min_height",
    "sensor.max_height", "traversability.", "planner.", "planning.", "mapping.publish_rate",
    "mapping.max_cells", "mapping.map_directory", "mapping.autosave", "registration.min_",
    "registration.max_",
)  # fmt: skip


def is_live(name: str) -> bool:
    """Whether a node takes a change of the parameter while it runs."""
    return name.startswith(_LIVE)


def _convert(name: str, given: Any, default: Value) -> Any:
    """The given value as the default's type; integers pass for floats, lists for tuples."""
    if isinstance(default, tuple):
        entry_type = str if default and isinstance(default[0], str) else float
        if not isinstance(given, list | tuple):
            raise InputError(f"parameter {name}: {given!r} is not a list")
        return tuple(_convert(name, entry, entry_type()) for entry in given)
    if isinstance(default, float) and isinstance(given, int) and not isinstance(given, bool):
        return float(given)
    if type(given) is not type(default):
        raise InputError(f"parameter {name}: {given!r} is not a {type(default).__name__}")
    return given


def with_values(params: Params, values: Mapping[str, Any]) -> Params:
    """Copy of the parameters with some values replaced, all of them or none.

    Parameters
    ----------
    params : Params
    values : mapping of ``section.name`` to a value

    Raises
    ------
    InputError
        For an unknown name (the nearest right one is suggested), a wrong type, a value out of
        its range.
    """
    known = flatten(params)
    changes: dict[str, Any] = {}
    for name, given in values.items():
        if name not in known:
            nearest = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
            hint = f"; did you mean {nearest[0]}?" if nearest else ""
            raise InputError(f"parameter {name}: unknown{hint}")
        section, _, key = name.partition(".")
        value = _convert(name, given, known[name][1])
        if key:
            changes.setdefault(section, {})[key] = value
        else:
            changes[name] = value
    return dataclasses.replace(
        params,
        **{
            name: dataclasses.replace(getattr(params, name), **content)
            if isinstance(content, dict)
            else content
            for name, content in changes.items()
        },
    )
