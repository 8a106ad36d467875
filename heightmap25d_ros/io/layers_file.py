# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``localization_layers.npz`` of a map directory, beside ``height_grid.npz``."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.input_files import require_file
from heightmap25d_ros.io._untrusted import as_input_error
from heightmap25d_ros.localization.layers import LayerMap

LAYERS = "localization_layers.npz"
FORMAT_VERSION = 1
"""Of the layers; ``height_grid.npz`` has its own."""

_ARRAYS = tuple(f.name for f in dataclasses.fields(LayerMap) if f.name != "geometry")
_DIGEST = 64  # hexadecimal digits of SHA-256


def write(path: Path, layers: LayerMap, height_grid: Path) -> None:
    """Write layers, with the SHA-256 of the height grid that they belong to."""
    np.savez_compressed(
        path,
        height_grid_sha256=np.array(_sha256(height_grid)),
        format_version=np.int64(FORMAT_VERSION),
        **{name: getattr(layers, name) for name in _ARRAYS},
    )


def load(directory: Path, height_map: HeightMap) -> LayerMap | None:
    """The layers of a map directory; None where it has none, or those of another height grid.

    Parameters
    ----------
    directory : Path
    height_map : HeightMap
        As loaded from the same directory.

    Raises
    ------
    InputError
        If the file is damaged, foreign or of another version.
    """
    path = directory / LAYERS
    if not path.exists():
        return None
    require_file(path)
    shape = height_map.geometry.shape
    with as_input_error(str(path)), zipfile.ZipFile(path) as archive:
        version = int(_read(archive, path, "format_version", "iu", ()))
        if version != FORMAT_VERSION:
            raise InputError(f"{path}: format_version is {version}, not {FORMAT_VERSION}")
        digest = str(_read(archive, path, "height_grid_sha256", "U", ()))
        if digest != _sha256(directory / "height_grid.npz"):
            return None
        dense = {name: _read(archive, path, name, "f", shape) for name in _ARRAYS}
    return _checked(path, height_map.geometry, dense)


def _checked(path: Path, geometry: Geometry, dense: dict[str, NDArray[Any]]) -> LayerMap:
    limit = 0.5 * geometry.resolution * (1.0 + 1e-5)
    for name, values in dense.items():
        if not np.isfinite(values).all():
            raise InputError(f"{path}: {name} holds values that are not finite")
        if name.endswith(("_count", "_scatter", "_xx", "_yy")) and values.min() < 0.0:
            raise InputError(f"{path}: {name} holds negative values")
        if name.endswith(("_x", "_y")) and np.abs(values).max() > limit:
            raise InputError(f"{path}: {name} holds places outside of their cells")
    return LayerMap(
        geometry=geometry, **{name: values.astype(np.float32) for name, values in dense.items()}
    )


def _read(
    archive: zipfile.ZipFile, path: Path, name: str, kinds: str, shape: tuple[int, ...]
) -> NDArray[Any]:
    """One array of the archive; type and size are checked before its data are read."""
    if f"{name}.npy" not in archive.namelist():
        raise InputError(f"{path}: {name} is missing")
    with as_input_error(f"{path}: {name}"), archive.open(f"{name}.npy") as file:
        version = np.lib.format.read_magic(file)
        reader = np.lib.format
        header = (
            reader.read_array_header_1_0 if version == (1, 0) else reader.read_array_header_2_0
        )(file)
        if header[2].kind not in kinds or header[0] != shape or header[2].itemsize > 4 * _DIGEST:
            raise InputError(f"{path}: {name} is an array {header[0]} of {header[2]}")
        with archive.open(f"{name}.npy") as again:
            values = np.asarray(np.lib.format.read_array(again, allow_pickle=False))
    assert values.nbytes == math.prod(shape) * values.itemsize
    return values


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
