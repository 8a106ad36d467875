# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``slam.json`` of a map directory: how its poses were found, where they were not known.

And ``covariance.csv``, how well they are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.input_files import require_file
from heightmap25d_ros.io import report_file
from heightmap25d_ros.io._untrusted import as_input_error

SLAM, COVARIANCE = "slam.json", "covariance.csv"
CLOSED = "closed"
"""Outcome of a search that found a loop, and was confirmed."""

_COLUMNS = "t,xx,xy,xyaw,yy,yyaw,yawyaw"
_FIELDS: report_file.Fields = {
    "poses": str, "distance_m": (int, float), "unobserved_m": (int, float),
    "disagreed_m": (int, float), "submaps_m": list, "loops": list,
}  # fmt: skip
_UPPER = np.triu_indices(3)


def write(directory: Path, report: dict[str, Any], into: Path | None = None) -> None:
    """Write a report of JSON types about the map of a directory, into it or into another one."""
    report_file.write(directory, SLAM, report, into)


def load(directory: Path) -> dict[str, Any] | None:
    """The report of a map; None where it has none: then it was made with known poses.

    Raises
    ------
    InputError
        If it is damaged or of another version.
    """
    report = report_file.load(directory, SLAM, _FIELDS)
    for loop in report["loops"] if report else ():
        if not isinstance(loop, dict) or not isinstance(loop.get("outcome"), str):
            raise InputError(f"{directory / SLAM}: loops holds what is no search for a loop")
    return report


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
