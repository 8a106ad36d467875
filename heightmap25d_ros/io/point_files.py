# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The known cells of a map as points in a PLY or PCD file, for CloudCompare, PCL and others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import PROBABILITY_SCALE, HeightMap

SUFFIXES = (".ply", ".pcd")

_POINT = np.dtype([("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("intensity", "<f4")])


def points(height_map: HeightMap) -> NDArray[np.void]:
    """(N,) x, y, z [m], map, float64, and intensity, the probability: of each known cell."""
    iy, ix = np.nonzero(height_map.known)
    made = np.zeros(len(iy), _POINT)
    centres = height_map.geometry.cell_center(np.stack([iy, ix], axis=1))
    made["x"], made["y"] = centres[:, 0], centres[:, 1]
    made["z"] = height_map.metres[iy, ix]
    made["intensity"] = height_map.probability[iy, ix] / np.float32(PROBABILITY_SCALE)
    return made


def write(path: Path | str, height_map: HeightMap) -> int:
    """Write a binary file of the format that its name ends in; the number of points.

    Raises
    ------
    InputError
        If the name ends in neither .ply nor .pcd.
    """
    path = Path(path)
    if path.suffix not in SUFFIXES:
        raise InputError(f"{path}: ends in none of {', '.join(SUFFIXES)}, .tif")
    made = points(height_map)
    header = _ply_header(len(made)) if path.suffix == ".ply" else _pcd_header(len(made))
    path.write_bytes(header.encode("ascii") + made.tobytes())
    return len(made)


def _fields() -> dict[str, np.dtype[Any]]:
    return {name: _POINT[name] for name in _POINT.names or ()}


def _ply_header(count: int) -> str:
    fields = _fields()
    names = {"<f8": "double", "<f4": "float"}
    properties = (f"property {names[kind.str]} {name}\n" for name, kind in fields.items())
    return (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
        f"{''.join(properties)}end_header\n"
    )


def _pcd_header(count: int) -> str:
    fields = _fields()
    sizes = " ".join(str(kind.itemsize) for kind in fields.values())
    return (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {' '.join(fields)}\nSIZE {sizes}\n"
        f"TYPE {' '.join('F' for _ in fields)}\nCOUNT {' '.join('1' for _ in fields)}\n"
        f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n"
    )
