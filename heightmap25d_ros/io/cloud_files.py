# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Point clouds in files of others: KITTI's .bin, .pcd of PCL, .ply, and .3d of 3DTK.

PCD and PLY are read as text and in binary, whatever scalar fields they have besides x, y and z.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.input_files import require_file
from heightmap25d_ros.io._untrusted import as_input_error
from heightmap25d_ros.io.point_cloud import MOST_POINTS

_HEADER = 1 << 16  # bytes within which the header of a file ends
_PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_PLY_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def read(path: Path) -> NDArray[np.float32]:
    """(N, 3) float32 [m]: x, y, z of the points of a file, by what its name ends in.

    Raises
    ------
    InputError
        If it is of another kind, cannot be read, or holds no points.
    """
    if path.suffix not in READERS:
        raise InputError(f"{path}: ends in none of {', '.join(READERS)}")
    require_file(path)
    with as_input_error(str(path)):
        points = READERS[path.suffix](path.read_bytes())
        if not 0 < len(points) <= MOST_POINTS:
            raise InputError(f"{path}: {len(points)} points; a cloud has 1 to {MOST_POINTS}")
        with np.errstate(over="ignore"):  # what becomes infinite is no return
            return points.astype(np.float32)


def _kitti(content: bytes) -> NDArray[np.float64]:
    """Four float32 a point: x, y, z, reflectance."""
    if len(content) % 16:
        raise ValueError(f"{len(content)} bytes are not four float32 a point")
    return np.frombuffer(content, "<f4").reshape(-1, 4)[:, :3].astype(np.float64)


def _three_d(content: bytes) -> NDArray[np.float64]:
    """Text, x y z [cm], and more: x to the right, y up, z ahead."""
    rows = [line.split()[:3] for line in content.decode("ascii").splitlines() if line.strip()]
    right, up, ahead = np.array(rows, np.float64).reshape(-1, 3).T / 100.0
    return np.stack([ahead, -right, up], axis=1)


def _pcd(content: bytes) -> NDArray[np.float64]:
    lines, body = _split(content, "DATA")
    header = {words[0]: words[1:] for words in (line.split() for line in lines) if words}
    names, sizes = header["FIELDS"], map(int, header["SIZE"])
    counts = map(int, header.get("COUNT", ["1"] * len(names)))
    fields = zip(names, header["TYPE"], sizes, counts, strict=True)
    layout = np.dtype(
        [
            (f"_{place}" if name == "_" else name, f"<{kind.lower()}{size}", (count,))
            for place, (name, kind, size, count) in enumerate(fields)
        ]
    )
    kind, count = header["DATA"][0], int(header["POINTS"][0])
    if kind == "binary_compressed":
        raise ValueError("is binary_compressed; pcl_convert_pcd_ascii_binary makes it binary")
    if kind == "ascii":
        columns = np.cumsum([0, *(layout[name].shape[0] for name in layout.names or ())])
        starts = dict(zip(layout.names or (), columns, strict=False))
        return _columns(body, [int(starts[name]) for name in "xyz"], count)
    if kind != "binary":
        raise ValueError(f"DATA {kind} is not known")
    records = np.frombuffer(body, layout, count)
    return np.concatenate([records[name] for name in "xyz"], axis=1).astype(np.float64)


def _ply(content: bytes) -> NDArray[np.float64]:
    lines, body = _split(content, "end_header")
    words = [line.split() for line in lines]
    order = _PLY_ORDER[next(w[1] for w in words if w[:1] == ["format"])]
    elements = [place for place, w in enumerate(words) if w[:1] == ["element"]]
    first = elements[0]
    if words[first][1] != "vertex":
        raise ValueError(f"begins with {words[first][1]}, not with its vertices")
    end = elements[1] if len(elements) > 1 else len(words)
    properties = [w for w in words[first:end] if w[:1] == ["property"]]
    names, count = [w[-1] for w in properties], int(words[first][2])
    if not order:
        return _columns(body, [names.index(name) for name in "xyz"], count)
    layout = np.dtype([(w[2], order + _PLY_TYPES[w[1]]) for w in properties])
    records = np.frombuffer(body, layout, count)
    return np.stack([records[name] for name in "xyz"], axis=1).astype(np.float64)


def _split(content: bytes, last: str) -> tuple[list[str], bytes]:
    """The lines of a header, the last one of which begins with a word, and what follows."""
    end = content.find(f"\n{last}".encode(), 0, _HEADER)
    end = content.find(b"\n", end + 1) if end >= 0 else -1
    if end < 0:
        raise ValueError(f"has no line {last}")
    return content[:end].decode("ascii").splitlines(), content[end + 1 :]


def _columns(body: bytes, places: list[int], count: int) -> NDArray[np.float64]:
    rows = [line.split() for line in body.decode("ascii").splitlines()[:count]]
    if len(rows) < count:
        raise ValueError(f"{len(rows)} lines for {count} points")
    return np.array([[row[place] for place in places] for row in rows], np.float64).reshape(-1, 3)


READERS = {".bin": _kitti, ".pcd": _pcd, ".ply": _ply, ".3d": _three_d}
"""By what the name of a file ends in."""
