# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters by their full names, ``section.name``, as ROS and parameter files have them.

Those of single sources are ``section.source.name``, see `sources`.

`flatten` lists them, `with_values` replaces some of them, `RENAMED` keeps the old names of
parameters working, and `REMOVED` says what took the place of parameters that are gone.
"""

from __future__ import annotations

import dataclasses
import difflib
import warnings
from collections.abc import Collection, Mapping
from typing import Any

from heightmap25d_ros.errors import InputError, quoted
from heightmap25d_ros.params import sources
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.params.spec import Spec, Value, specs

RENAMED = {"short_term.mature_way": "short_term.mature_distance"}
"""Old name -> present name. An old name is still accepted, with a warning that names both."""

REMOVED = {"localization.max_odom_step": "the limits of section odometry take its place"}
"""Name of a parameter that is gone -> what to do instead. Files with one are still accepted."""


def flatten(params: Params) -> dict[str, tuple[Spec, Value]]:
    """Full name -> spec and value, in order of definition; then what is set for single sources."""
    found: dict[str, tuple[Spec, Value]] = {}
    for entry in dataclasses.fields(params):
        content = getattr(params, entry.name)
        if entry.name == "sources":
            continue
        if "spec" in entry.metadata:
            found[entry.name] = entry.metadata["spec"], content
        else:
            found |= {f"{entry.name}.{name}": (s, value) for name, s, value in specs(content)}
    for source, values in params.sources.items():
        for name, value in values.items():
            section, _, key = name.partition(".")
            full_name = f"{section}.{source}.{key}"
            found[full_name] = _of_source(section, source)[full_name][0], value
    return found


def _parts(name: str) -> tuple[str, str, str]:
    """Section, source and key of a full name; what it does not have is empty."""
    section, _, rest = name.partition(".")
    source, _, key = rest.rpartition(".")
    return section, source, key


def _of_source(section: str, source: str) -> dict[str, tuple[Spec, Value]]:
    """Full name -> spec and default of what may be set for one source."""
    own = sources.SECTIONS[section]()
    return {f"{section}.{source}.{name}": (spec, value) for name, spec, value in specs(own)}


_LIVE = (
    "sensor.min_range", "sensor.max_range", "sensor.no_return", "sensor.clearing_range",
    "sensor.min_height", "sensor.max_height", "traversability.", "planner.", "planning.",
    "mapping.publish_rate", "mapping.max_cells", "mapping.autosave", "mapping.slice",
    "registration.min_", "registration.max_",
)  # fmt: skip


def is_live(name: str) -> bool:
    """Whether the parameter can be changed while a node runs."""
    section, source, key = _parts(name)
    return (f"{section}.{key}" if source else name).startswith(_LIVE)


def _convert(name: str, given: Any, default: Value, entries: type = float) -> Any:
    """The given value in the default's type: integers become floats, lists become tuples."""
    if isinstance(default, tuple):
        if not isinstance(given, list | tuple):
            raise InputError(f"parameter {name}: {quoted(given)} is not a list")
        return tuple(_convert(name, entry, entries()) for entry in given)
    if isinstance(given, int) and abs(given) >= 2**63:
        raise InputError(f"parameter {name}: an integer has 64 bits")
    if isinstance(default, float) and isinstance(given, int) and not isinstance(given, bool):
        return float(given)
    if type(given) is not type(default):
        raise InputError(f"parameter {name}: {quoted(given)} is not a {type(default).__name__}")
    return given


def unknown(name: str, known: Collection[str]) -> str:
    """What to say of an unknown parameter; the most similar known one is suggested."""
    nearest = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"parameter {name}: unknown{f'; did you mean {nearest[0]}?' if nearest else ''}"


def with_present_names(values: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Values by the present names of their parameters, and a warning for each old name.

    Those of `REMOVED` are left out, with a warning.

    Parameters
    ----------
    values : mapping of full name to value
        Old names of `RENAMED` among them.

    Raises
    ------
    InputError
        If a parameter is given by both of its names.
    """
    present: dict[str, Any] = {}
    notices: list[str] = []
    for name, value in values.items():
        if name in REMOVED:
            notices.append(f"parameter {name}: has no effect any more, {REMOVED[name]}")
            continue
        new = RENAMED.get(name, name)
        if new != name:
            if new in values:
                raise InputError(f"parameter {name}: is given as {new}, its new name, as well")
            notices.append(f"parameter {name}: is deprecated, its new name is {new}")
        present[new] = value
    return present, notices


def _with_clouds_alone(values: dict[str, Any]) -> dict[str, Any]:
    """Values in which cloud_topics, where no scan_topics are given, are the only sources.

    A ROS parameter file cannot say that there are none: it knows no empty list.
    """
    if values.get("intake.cloud_topics") and "intake.scan_topics" not in values:
        return {**values, "intake.scan_topics": []}
    return values


def with_values(params: Params, values: Mapping[str, Any]) -> Params:
    """Copy of the parameters with some values replaced, all of them or none.

    An old name of `RENAMED` is accepted with a `FutureWarning`.

    Parameters
    ----------
    params : Params
    values : mapping of full name to value

    Raises
    ------
    InputError
        For an unknown name (the most similar known one is suggested), a wrong type, a value out
        of its range.

    Examples
    --------
    >>> with_values(Params(), {"grid.resolution": 0.25}).grid
    GridParams(resolution=0.25, extent=4096.0)
    """
    known = flatten(params)
    present, notices = with_present_names(values)
    for notice in notices:
        warnings.warn(notice, FutureWarning, stacklevel=2)
    changes: dict[str, Any] = {}
    of_sources = {source: dict(values) for source, values in params.sources.items()}
    for name, given in _with_clouds_alone(present).items():
        section, source, key = _parts(name)
        entries = _of_source(section, source) if source and section in sources.SECTIONS else known
        if name not in entries:
            raise InputError(unknown(name, entries))
        spec, before = entries[name]
        value = _convert(name, given, before, spec.entries)
        if source:
            of_sources.setdefault(source, {})[f"{section}.{key}"] = value
        elif key:
            changes.setdefault(section, {})[key] = value
        else:
            changes[name] = value
    changed: Params = dataclasses.replace(
        params,
        sources=of_sources,
        **{
            name: dataclasses.replace(getattr(params, name), **content)
            if isinstance(content, dict)
            else content
            for name, content in changes.items()
        },
    )
    sources.check(changed)
    return changed
