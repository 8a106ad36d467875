# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``merge.json`` of a map directory: which maps it was made of, and how they lie in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import report_file

MERGE = "merge.json"
_FIELDS: report_file.Fields = {"maps": list, "poses": str, "differing_cells": int}


def write(directory: Path, report: dict[str, Any], into: Path | None = None) -> None:
    """Write a report of JSON types about the map of a directory, into it or into another one."""
    report_file.write(directory, MERGE, report, into)


def load(directory: Path) -> dict[str, Any] | None:
    """The report of a map; None where it is not one that was merged.

    Raises
    ------
    InputError
        If it is damaged or of another version.
    """
    report = report_file.load(directory, MERGE, _FIELDS)
    for source in report["maps"] if report else ():
        if not isinstance(source, dict) or not isinstance(source.get("map"), str):
            raise InputError(f"{directory / MERGE}: maps holds what is no map")
    return report
