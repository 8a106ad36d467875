# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``map.yaml`` of nav2_map_server, slam_toolbox and others, as a flat height map with walls.

The image is read as nav2_map_server reads it: modes trinary, scale and raw, any origin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import image
from numpy.typing import NDArray

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import (
    HEIGHT_LIMIT,
    HEIGHT_RESOLUTION,
    PROBABILITY_SCALE,
    Geometry,
    HeightMap,
    require_plausible,
)
from heightmap25d_ros.input_files import read_yaml, require_file
from heightmap25d_ros.io._untrusted import as_input_error

MODES = ("trinary", "scale", "raw")

MOST_PIXELS = 2**28
"""A larger image is refused."""

_SAMPLES = 4  # of a cell along each axis, where a map is turned
_KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")


@dataclass(frozen=True, slots=True, kw_only=True)
class OccupancyMap:
    """An occupancy grid as its file has it.

    Attributes
    ----------
    occupancy : (rows, columns) int8
        -1: unknown, 0 .. 100; the first row is that of the least y.
    resolution : float [m]
    origin : (x, y, yaw) [m, rad], map
        Pose of the outer corner of cell (0, 0).
    """

    occupancy: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float, float]


def read(path: Path | str) -> OccupancyMap:
    """Read a ``map.yaml`` and its image.

    Raises
    ------
    InputError
        If one of them cannot be read, or a key is missing or has no meaning.
    """
    path = Path(path)
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise InputError(f"{path}: is no map.yaml")
    for key in _KEYS:
        if key not in content:
            raise InputError(f"{path}: {key} is missing")
    mode = content.get("mode", "trinary")
    if mode not in MODES:
        raise InputError(f"{path}: mode: {mode!r} is not one of {', '.join(MODES)}")
    origin = [_number(path, "origin", value) for value in _list(path, content["origin"])]
    if len(origin) != 3:
        raise InputError(f"{path}: origin: is not x, y, yaw")
    occupied, free = (
        _number(path, key, content[key]) for key in ("occupied_thresh", "free_thresh")
    )
    if not 0.0 <= free < occupied <= 1.0:
        raise InputError(f"{path}: free_thresh: {free:g} is not below occupied_thresh {occupied:g}")
    shades, is_opaque = _picture(path, str(content["image"]))
    is_negated = bool(_number(path, "negate", content["negate"]))
    occupancy = _occupancy(shades, is_opaque, mode, (free, occupied), is_negated)
    return OccupancyMap(
        occupancy=occupancy[::-1],
        resolution=_number(path, "resolution", content["resolution"]),
        origin=(origin[0], origin[1], origin[2]),
    )


def _list(path: Path, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise InputError(f"{path}: origin: is not x, y, yaw")
    return value


def _number(path: Path, key: str, value: Any) -> float:
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{path}: {key}: {str(value)[:40]!r} is not a number")
    return float(value)


def _picture(path: Path, name: str) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Shades (rows, columns), 0 black to 1 white, and where the picture is opaque."""
    file = path.parent / name
    require_file(file)
    with as_input_error(str(file)):
        pixels = np.asarray(image.imread(file))
        if pixels.ndim not in (2, 3) or not 0 < pixels.shape[0] * pixels.shape[1] <= MOST_PIXELS:
            raise InputError(f"an array {pixels.shape} is no picture of a map")
        largest = 1.0 if pixels.dtype.kind == "f" else float(np.iinfo(pixels.dtype).max)
        scaled = pixels.astype(np.float64) / largest
    if scaled.ndim == 2:
        return scaled, np.ones(scaled.shape, bool)
    has_alpha = scaled.shape[2] in (2, 4)
    colours = scaled[..., :-1] if has_alpha else scaled
    opaque = scaled[..., -1] == 1.0 if has_alpha else np.ones(scaled.shape[:2], bool)
    return colours.mean(axis=2), opaque


def _occupancy(
    shades: NDArray[np.float64],
    is_opaque: NDArray[np.bool_],
    mode: str,
    thresholds: tuple[float, float],
    is_negated: bool,
) -> NDArray[np.int8]:
    """As nav2_map_server's ``loadMapFromFile``, row by row from the top."""
    if mode == "raw":
        percent = np.rint(shades * 255.0)
        return np.where(percent <= 100.0, percent, -1.0).astype(np.int8)
    free, occupied = thresholds
    share = shades if is_negated else 1.0 - shades
    between = -1.0
    if mode == "scale":
        graded = np.rint((share - free) / (occupied - free) * 100.0)
        return np.where(
            is_opaque, np.select([share > occupied, share < free], [100, 0], graded), -1
        ).astype(np.int8)
    return np.select([share > occupied, share < free], [100.0, 0.0], between).astype(np.int8)


def to_height_map(source: OccupancyMap, wall_height: float) -> HeightMap:
    """A flat map at height 0 with walls.

    What is occupied by 50 or more is a wall, with that probability; the rest is ground, with the
    probability that is left. A turned map gets cells along the axes: a wall where one of 4 x 4
    places in a cell is in a wall, unknown where its middle is.

    Parameters
    ----------
    source : OccupancyMap
    wall_height : float [m]

    Raises
    ------
    InputError
        If the map is none of a place on Earth, or the walls are too high.
    """
    if not 0.0 < wall_height <= HEIGHT_LIMIT * HEIGHT_RESOLUTION:
        raise InputError(f"wall height: {wall_height:g} m is not one of a wall")
    occupancy, geometry = _along_axes(source)
    is_wall = occupancy >= 50
    believed = np.where(is_wall, occupancy, 100 - occupancy) / 100.0
    probability = np.where(occupancy < 0, 0.0, believed) * PROBABILITY_SCALE
    return HeightMap(
        geometry=geometry,
        height=np.where(is_wall, round(wall_height / HEIGHT_RESOLUTION), 0).astype(np.int16),
        probability=np.rint(probability).astype(np.uint16),
    )


def _along_axes(source: OccupancyMap) -> tuple[NDArray[np.int8], Geometry]:
    """Occupancy in cells along the axes, and their geometry."""
    x, y, yaw = source.origin
    rows, columns = source.occupancy.shape
    side = source.resolution
    whole = Geometry(resolution=side, origin=(x, y), shape=(rows, columns))
    require_plausible(whole)
    if abs(math.remainder(yaw, 2 * math.pi)) < 1e-6:
        return source.occupancy, whole
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    corners = np.array([(0, 0), (columns, 0), (0, rows), (columns, rows)]) * side @ turn.T
    low = np.floor(corners.min(axis=0) / side + 1e-9)
    size = np.ceil(corners.max(axis=0) / side - 1e-9) - low
    shape = int(size[1]), int(size[0])
    origin = np.array([x, y]) + low * side
    geometry = Geometry(resolution=side, origin=(origin[0], origin[1]), shape=shape)
    require_plausible(geometry)
    result = _sampled(source.occupancy, turn, low, shape, 0.5, 0.5)
    fractions = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    for v in fractions:
        for u in fractions:
            here = _sampled(source.occupancy, turn, low, shape, v, u)
            result = np.where(result < 0, result, np.maximum(result, here))
    return result, geometry


def _sampled(
    occupancy: NDArray[np.int8],
    turn: NDArray[np.float64],
    low: NDArray[np.float64],
    shape: tuple[int, int],
    v: float,
    u: float,
) -> NDArray[np.int8]:
    """Occupancy at one place (v, u) of each new cell; unknown outside of the map."""
    iy, ix = np.indices(shape)
    places = np.stack([ix + u + low[0], iy + v + low[1]], axis=-1) @ turn  # turned back
    column, row = np.floor(places).astype(int).transpose(2, 0, 1)
    rows, columns = occupancy.shape
    is_inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    found = occupancy[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
    return np.asarray(np.where(is_inside, found, np.int8(-1)))
