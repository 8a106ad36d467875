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
FORMAT_VERSION = 1

_COLUMNS = "t,xx,xy,xyaw,yy,yyaw,yawyaw"
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
    return report if report.get("height_grid_sha256") == _sha256(directory) else None


def write_covariances(path: Path, stamps_ns: Sequence[int], covariances: Sequence[Array]) -> None:
    """Write covariances (3, 3) of x, y [m], yaw [rad], a line for each stamp [ns]."""
    lines = [_COLUMNS]
    for stamp, covariance in zip(stamps_ns, covariances, strict=True):
        entries = ",".join(f"{number:.9e}" for number in covariance[_UPPER])
        lines.append(f"{stamp // 10**9}.{stamp % 10**9:09d},{entries}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _sha256(directory: Path) -> str:
    return hashlib.sha256((directory / _HEIGHT_GRID).read_bytes()).hexdigest()
