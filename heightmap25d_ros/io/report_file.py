# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reports in a map directory, as JSON: how its map was made.

A report names the height grid that it is about. One of another map, which has taken the place of
the one it was written with, is none.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.input_files import require_file
from heightmap25d_ros.io._untrusted import as_input_error

FORMAT_VERSION = 1

Fields = Mapping[str, type | tuple[type, ...]]
"""Names of what a report must have, and the types of its values."""

_HEIGHT_GRID = "height_grid.npz"


def write(directory: Path, name: str, report: dict[str, Any], into: Path | None = None) -> None:
    """Write a report of JSON types about the map of a directory, into it or into another one."""
    told = {"format_version": FORMAT_VERSION, "height_grid_sha256": _sha256(directory), **report}
    ((into or directory) / name).write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


def load(directory: Path, name: str, fields: Fields) -> dict[str, Any] | None:
    """The report of a map; None where it has none, or that of another one.

    Raises
    ------
    InputError
        If it is damaged or of another version, or lacks one of the fields.
    """
    path = directory / name
    if not path.exists():
        return None
    require_file(path)
    with as_input_error(str(path)):
        report = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(report, dict) or report.get("format_version") != FORMAT_VERSION:
        raise InputError(f"{path}: is not a report of format_version {FORMAT_VERSION}")
    for field, kind in fields.items():
        if not isinstance(report.get(field), kind):
            raise InputError(f"{path}: {field} is missing, or not as in a report")
    return report if report.get("height_grid_sha256") == _sha256(directory) else None


def _sha256(directory: Path) -> str:
    return hashlib.sha256((directory / _HEIGHT_GRID).read_bytes()).hexdigest()
