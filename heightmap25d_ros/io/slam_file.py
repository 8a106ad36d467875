# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``slam.json`` of a map directory: how its poses were found, where they were not known.

And ``covariance.csv``, how well they are known.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.input_files import require_file
from heightmap25d_ros.io._untrusted import as_input_error

SLAM, COVARIANCE = "slam.json", "covariance.csv"
CLOSED = "closed"
"""Outcome of a search that found a loop, and was confirmed."""

FORMAT_VERSION = 1

_COLUMNS = "t,xx,xy,xyaw,yy,yyaw,yawyaw"
_FIELDS: dict[str, type | tuple[type, ...]] = {
    "poses": str, "distance_m": (int, float), "unobserved_m": (int, float),
    "disagreed_m": (int, float), "submaps_m": list, "loops": list,
}  # fmt: skip
_UPPER = np.triu_indices(3)
_HEIGHT_GRID = "height_grid.npz"


def write(directory: Path, report: dict[str, Any], into: Path | None = None) -> None:
    """Write a report of JSON types about the map of a directory, into it or into another one."""
    told = {"format_version": FORMAT_VERSION, "height_grid_sha256": _sha256(directory), **report}
    ((into or directory) / SLAM).write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


def load(directory: Path) -> dict[str, Any] | None:
    """The report of a map; None where it has none: then it was made with known poses.

    A report of another map, which has taken the place of the one it was written with, is none.

    Raises
    ------
    InputError
        If it is damaged or of another version.
    """
    path = directory / SLAM
    if not path.exists():
        return None
    require_file(path)
    with as_input_error(str(path)):
        report = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(report, dict) or report.get("format_version") != FORMAT_VERSION:
        raise InputError(f"{path}: is not a report of format_version {FORMAT_VERSION}")
    for name, kind in _FIELDS.items():
        if not isinstance(report.get(name), kind):
            raise InputError(f"{path}: {name} is missing, or not as in a report")
    for loop in report["loops"]:
        if not isinstance(loop, dict) or not isinstance(loop.get("outcome"), str):
            raise InputError(f"{path}: loops holds what is no search for a loop")
    return report if report.get("height_grid_sha256") == _sha256(directory) else None


def closed_loops(report: dict[str, Any]) -> list[tuple[Array, Array]]:
    """Where the submaps (2,) [m] begin that were joined by loops.

    Raises
    ------
    InputError
        If the report names submaps that it does not have.
    """
    with as_input_error(SLAM):
        starts = np.asarray(report["submaps_m"], np.float64).reshape(-1, 2)
        closed = [loop for loop in report["loops"] if loop["outcome"] == CLOSED]
        return [(starts[int(loop["first"])], starts[int(loop["second"])]) for loop in closed]


def read_covariances(directory: Path, count: int) -> Array:
    """(N, 3, 3) float64: as of `write_covariances`.

    Raises
    ------
    InputError
        If the file is missing or damaged, or does not hold as many as poses.
    """
    path = directory / COVARIANCE
    require_file(path)
    with as_input_error(str(path)):
        table = np.loadtxt(path, np.float64, delimiter=",", skiprows=1, ndmin=2)
        if table.shape != (count, 1 + len(_UPPER[0])) or not np.isfinite(table).all():
            raise InputError(f"{path}: does not hold {count} covariances")
    found = np.zeros((count, 3, 3))
    found[:, _UPPER[0], _UPPER[1]] = found[:, _UPPER[1], _UPPER[0]] = table[:, 1:]
    return found


def write_covariances(path: Path, stamps_ns: Sequence[int], covariances: Sequence[Array]) -> None:
    """Write covariances (3, 3) of x, y [m], yaw [rad], a line for each stamp [ns]."""
    lines = [_COLUMNS]
    for stamp, covariance in zip(stamps_ns, covariances, strict=True):
        entries = ",".join(f"{number:.9e}" for number in covariance[_UPPER])
        lines.append(f"{stamp // 10**9}.{stamp % 10**9:09d},{entries}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _sha256(directory: Path) -> str:
    return hashlib.sha256((directory / _HEIGHT_GRID).read_bytes()).hexdigest()
