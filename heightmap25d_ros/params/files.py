# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters as text: ROS parameter files in and out, and the table of docs/interface.md."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.input_files import read_yaml as read_yaml_file
from heightmap25d_ros.params.by_name import flatten, is_live, with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.params.spec import Value


def read_yaml(path: Path, node: str) -> Params:
    """The parameters of a node from a ROS parameter file; defaults for what it does not set.

    Raises
    ------
    InputError
        If the file cannot be read, is not a parameter file, or sets an invalid parameter.
    """
    return params_of(path, values_in(path, node))


def params_of(path: Path, values: Mapping[str, Any]) -> Params:
    """The parameters with the values that a file sets.

    Raises
    ------
    InputError
        If one of them is invalid; it names the file.
    """
    try:
        return with_values(Params(), values)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def values_in(path: Path, node: str) -> dict[str, Any]:
    """What a ROS parameter file sets for a node, by full name and as it is there.

    Blocks for all nodes (``/**``) and for this one (``mapping``, ``/**/mapping``) apply, in any
    namespace, in the order of the file.

    Raises
    ------
    InputError
        If the file cannot be read or is not a parameter file.
    """
    values: dict[str, Any] = {}
    tree = _mapping(path, "the file", read_yaml_file(path))
    for name, body in _blocks(path, tree):
        block_values = dict(_dotted(_mapping(path, f"{name}.ros__parameters", body)))
        if name.rpartition("/")[2] in ("**", "*", node):
            values |= block_values
    return values


def _blocks(path: Path, tree: Mapping[str, Any], namespace: str = "") -> Iterator[tuple[str, Any]]:
    """The name of each node of a parameter file and what is below it; namespaces may be nested."""
    for key, block in tree.items():
        name = f"{namespace}{key}"
        inner = _mapping(path, name, block)
        is_namespace = inner and all(isinstance(value, dict) for value in inner.values())
        if is_namespace and "ros__parameters" not in inner:
            yield from _blocks(path, inner, f"{name}/")
        else:
            yield name, inner.get("ros__parameters")


def _mapping(path: Path, name: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{path}: {name} is not a mapping, as in a ROS parameter file")
    return value


def _dotted(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from _dotted(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _yaml_value(value: Value) -> str:
    plain = list(value) if isinstance(value, tuple) else value
    text: str = yaml.safe_dump(plain, default_flow_style=True)
    return text.removesuffix("...\n").strip()


def as_yaml(params: Params) -> str:
    """The parameters as a ROS parameter file with units, ranges and meanings as comments."""
    lines = [
        "# Generated from heightmap25d_ros/params/sections.py by scripts/write_parameters.py.",
        "/**:",
        "  ros__parameters:",
    ]
    sections: set[str] = set()
    for full_name, (spec, value) in flatten(params).items():
        section, _, name = full_name.rpartition(".")
        indent = "      " if section else "    "
        if section and section not in sections:
            sections.add(section)
            lines.append(f"    {section}:")
        facts = ", ".join(filter(None, [spec.unit, spec.range_text]))
        comment = spec.meaning + (f" [{facts}]" if facts else "")
        # An empty list has no type in a ROS parameter file, which is an error there.
        hidden = "# " if value == () else ""
        lines += [f"{indent}# {comment}", f"{indent}{hidden}{name}: {_yaml_value(value)}"]
    return "\n".join(lines) + "\n"


def as_markdown(params: Params) -> str:
    """The parameters as a table for docs/interface.md."""
    lines = ["| parameter | default | unit | range | live | meaning |", "|---|---|---|---|---|---|"]
    for name, (spec, value) in flatten(params).items():
        range_text = spec.range_text.replace("|", "\\|")
        meaning = spec.meaning.replace("|", "\\|")
        live = "yes" if is_live(name) else ""
        lines.append(
            f"| `{name}` | {_yaml_value(value)} | {spec.unit} | {range_text} | {live} | {meaning} |"
        )
    return "\n".join(lines) + "\n"
