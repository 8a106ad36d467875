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
from heightmap25d_ros.io._untrusted import as_input_error, require_only
from heightmap25d_ros.localization.layers import NAMES, LayerMap

LAYERS = "localization_layers.npz"
FORMAT_VERSION = 1
"""Of the layers; ``height_grid.npz`` has its own."""

WITH_LEVELS = 2
"""The version of layers with some of surfaces above the lowest ones: ``above``, their number."""

MOST_LEVELS = 15
"""Above the lowest one."""
_MOST_RETURNS = 1e9  # of a cell: a century of them
_HIGHEST = 1000.0  # [m] above ground zero: a map stores a third of it
_ROUNDING = 1e-4  # of single precision, over many returns
_DIGEST = 64  # hexadecimal digits of SHA-256


def write(path: Path, layers: LayerMap, height_grid: Path) -> None:
    """Write layers, with the SHA-256 of the height grid that they belong to."""
    arrays: dict[str, Any] = {
        _name(name, level): getattr(of_level, name)
        for level, of_level in enumerate((layers, *layers.above))
        for name in NAMES
    }
    if layers.above:
        arrays["above"] = np.int64(len(layers.above))
    np.savez_compressed(
        path,
        height_grid_sha256=np.array(_sha256(height_grid)),
        format_version=np.int64(WITH_LEVELS if layers.above else FORMAT_VERSION),
        **arrays,
    )


def _names(version: int, above: int) -> list[str]:
    """Of all arrays of a file."""
    arrays = [_name(name, level) for level in range(1 + above) for name in NAMES]
    levels = ["above"] if version == WITH_LEVELS else []
    return ["format_version", "height_grid_sha256", *levels, *arrays]


def _name(name: str, level: int) -> str:
    """Of an array of the file."""
    return f"{name}_{level}" if level else name


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
        if version not in (FORMAT_VERSION, WITH_LEVELS):
            raise InputError(
                f"{path}: format_version is {version}, not {FORMAT_VERSION} or {WITH_LEVELS}"
            )
        digest = str(_read(archive, path, "height_grid_sha256", "U", ()))
        if digest != _sha256(directory / "height_grid.npz"):
            return None
        above = int(_read(archive, path, "above", "iu", ())) if version == WITH_LEVELS else 0
        if not 0 <= above <= MOST_LEVELS:
            raise InputError(f"{path}: above is {above}, not 0 .. {MOST_LEVELS}")
        require_only(archive, path, _names(version, above))
        lowest, *upper = (
            _checked(
                path,
                height_map.geometry,
                {name: _read(archive, path, _name(name, level), "f", shape) for name in NAMES},
                level,
            )
            for level in range(1 + above)
        )
    return dataclasses.replace(lowest, above=tuple(upper))


def _checked(
    path: Path, geometry: Geometry, dense: dict[str, NDArray[Any]], level: int
) -> LayerMap:
    try:
        return checked(geometry, dense)
    except InputError as error:
        name, _, problem = str(error).partition(": ")
        raise InputError(f"{path}: {_name(name, level)} {problem}") from None


def checked(geometry: Geometry, dense: dict[str, NDArray[Any]]) -> LayerMap:
    """Layers (rows, columns) of one level that are from elsewhere.

    Raises
    ------
    InputError
        If one holds what no layer does; it begins with the name of that layer.
    """
    for name, values in dense.items():
        if not np.isfinite(values).all():
            raise InputError(f"{name}: holds values that are not finite")
        if name.endswith(("_count", "_scatter", "_xx", "_yy")) and values.min(initial=0.0) < 0.0:
            raise InputError(f"{name}: holds negative values")
    for name, limit in _limits(geometry, dense).items():
        if (np.abs(dense[name]) > limit * (1.0 + _ROUNDING)).any():
            raise InputError(f"{name}: holds values that no returns of a cell have")
    return LayerMap(
        geometry=geometry,
        above=(),
        **{name: values.astype(np.float32) for name, values in dense.items()},
    )


def _limits(geometry: Geometry, dense: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """The largest magnitudes of layers: places lie in their cells, heights in those of a map."""
    side, height = geometry.resolution, abs(geometry.ground_zero) + _HIGHEST
    grounds, places = (
        np.maximum(count.astype(np.float64), 1.0)
        for count in (dense["ground_count"], dense["ground_count"] + dense["elevated_count"])
    )
    return {
        **dict.fromkeys(("ground_count", "level_count", "elevated_count"), _MOST_RETURNS),
        "ground_height": height,
        "ground_scatter": grounds * (2.0 * height) ** 2,
        **dict.fromkeys(("ground_x", "ground_y", "elevated_x", "elevated_y"), 0.5 * side),
        **dict.fromkeys(("spread_xx", "spread_xy", "spread_yy"), places * side**2),
    }


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
