# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The map directory: ``map.yaml`` and ``map.pgm`` for map_server, ``height_grid.npz`` for us.

And trajectories as TUM text.
"""

from __future__ import annotations

import hashlib
import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import memory, se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import (
    HEIGHT_LIMIT,
    HEIGHT_RESOLUTION,
    PROBABILITY_SCALE,
    PROBABILITY_THRESHOLD,
    SUSPECTED,
    Geometry,
    HeightMap,
    require_plausible,
)
from heightmap25d_ros.grid.levels import NO_UPPER, UpperSurfaces
from heightmap25d_ros.input_files import require_file
from heightmap25d_ros.io import atomic_directory, layers_file
from heightmap25d_ros.io._untrusted import as_input_error, require_only
from heightmap25d_ros.io.decode import frame_name
from heightmap25d_ros.io.trajectory import write_tum
from heightmap25d_ros.localization.layers import LayerMap
from heightmap25d_ros.params.sections import MappingParams
from heightmap25d_ros.terrain.traversability import ObstacleMap, to_obstacle_map

FORMAT_VERSION = 1

FORMAT_VERSION_OFFSET = 2
"""Of a map with a ``z_offset``, whose heights a reader of version 1 would take for z."""

FORMAT_VERSION_LEVELS = 3
"""Of a map with surfaces above the lowest ones, and a ``z_offset``: ``upper_...``."""

MAX_CELLS = 2**30
"""A larger map is refused unread; so is one for which the memory is not available."""

_BYTES_OF_CELL = 16

MAP_YAML, MAP_PGM, HEIGHT_GRID = "map.yaml", "map.pgm", "height_grid.npz"
TRAJECTORY = "trajectory.tum"

MAP_FRAME = MappingParams().map_frame
"""Frame of a map, by default."""

LONGEST_NAME = 200
"""Bytes of the name of a map: file systems take 255, of which a save needs some."""

_MAX_SMALL_FIELD = 1024
"""Bytes of a field that is not a grid."""

_PIXEL_UNKNOWN, _PIXEL_FREE, _PIXEL_OCCUPIED = 205, 254, 0

# What map_server calls unknown lies between the thresholds. The usual free_thresh of 0.25 turns
# pixel 205, (255 - 205) / 255 = 0.19608, into free space when the map is loaded again.
_OCCUPIED_THRESH, _FREE_THRESH = 0.65, 0.196


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedMap:
    """What a map directory holds."""

    height_map: HeightMap
    frame_id: str


def check_name(name: str) -> None:
    """Refuse a name of a map that no directory can have.

    Raises
    ------
    InputError
        If it is empty, longer than `LONGEST_NAME`, holds what cannot be printed (a NUL, a line
        break), is absolute, or has a part that begins with a dot.
    """
    parts = Path(name).parts
    is_plain = name.isprintable() and len(name.encode()) <= LONGEST_NAME
    if not (is_plain and parts) or Path(name).is_absolute():
        raise InputError(f"map name {name[:LONGEST_NAME]!r}: does not name a map")
    if any(part.startswith(".") for part in parts):
        raise InputError(f"map name {name!r}: does not name a map, a part of it begins with a dot")


def map_path(map_directory: Path, name: str) -> Path:
    """Where a map of this name lies inside of the directory of maps.

    Raises
    ------
    InputError
        For a name that `check_name` refuses, and one that leads out of the directory through a
        symbolic link, or into another map.
    """
    check_name(name)
    with as_input_error(f"map name {name!r}"):
        root = map_directory.resolve()
        path = (root / name).resolve()
        if root not in path.parents:
            raise InputError(f"map name {name!r}: does not name a map inside of {map_directory}")
        for parent in path.parents:
            if root in parent.parents and (parent / HEIGHT_GRID).exists():
                raise InputError(f"map name {name!r}: {parent.name} is a map itself")
    return path


def save(
    directory: Path | str,
    height_map: HeightMap,
    obstacle_map: ObstacleMap | None = None,
    frame_id: str = MAP_FRAME,
    trajectory: Sequence[tuple[int, se3.Matrix]] = (),
    layers: LayerMap | None = None,
) -> None:
    """Write a map directory, in one step and in place of the one that is there.

    Other files in the directory stay. `atomic_directory.replacing` tells what a crash leaves.

    Parameters
    ----------
    directory : Path or str
    height_map : HeightMap
    obstacle_map : ObstacleMap, optional
        What `to_obstacle_map` makes of the height map, by default.
    frame_id : str, optional
    trajectory : sequence of (int, (4, 4) float64), optional
        Stamps [ns] and poses, for ``trajectory.tum``.
    layers : LayerMap, optional
        Layers for localization, of the same cells, for ``localization_layers.npz``.

    Raises
    ------
    InputError
        If no cell of the map is known (an empty map never replaces one), or the directory cannot
        be written.
    ValueError
        If the two maps do not cover the same cells.

    Examples
    --------
    >>> save("out/step", HeightMap.from_metres([[0.0, 0.0, 0.5]]))
    >>> load("out/step").height_map.height
    array([[ 0,  0, 50]], dtype=int16)
    """
    directory = Path(directory)
    if obstacle_map is not None and obstacle_map.geometry != height_map.geometry:
        raise ValueError("height map and obstacle map do not cover the same cells")
    if not height_map.known.any():
        observed = int(np.count_nonzero(height_map.probability))
        raise InputError(
            f"{directory}: nothing has been mapped, so there is nothing to save ({observed} cells "
            f"were observed, none with a probability of {height_map.probability_threshold:g})"
        )
    obstacle_map = to_obstacle_map(height_map) if obstacle_map is None else obstacle_map
    offset = height_map.geometry.ground_zero
    upper = height_map.upper
    optional: dict[str, Any] = {"z_offset": np.float64(offset)} if offset or len(upper) else {}
    version = FORMAT_VERSION_OFFSET if optional else FORMAT_VERSION
    if len(upper):
        version = FORMAT_VERSION_LEVELS
        optional |= {
            "upper_cell": upper.cell.astype(np.int32),
            "upper_top": upper.top,
            "upper_bottom": upper.bottom,
            "upper_probability": upper.probability / np.float32(PROBABILITY_SCALE),
        }
    if height_map.suspected.any():
        optional["suspected"] = height_map.suspected
    if height_map.is_level:
        optional["level_lasers"] = np.bool_(True)
    with atomic_directory.replacing(directory) as temporary:
        (temporary / MAP_YAML).write_text(map_yaml(height_map.geometry), encoding="utf-8")
        (temporary / MAP_PGM).write_bytes(map_pgm(obstacle_map.occupancy))
        np.savez_compressed(
            temporary / HEIGHT_GRID,
            height=np.where(height_map.height < -HEIGHT_LIMIT, np.int16(0), height_map.height),
            probability=height_map.probability / np.float32(PROBABILITY_SCALE),
            probability_scale=np.float64(1.0),
            height_resolution=np.float64(HEIGHT_RESOLUTION),
            resolution=np.float64(height_map.geometry.resolution),
            origin=np.array(height_map.geometry.origin, np.float64),
            frame_id=np.array(frame_id),
            format_version=np.int64(version),
            **optional,
        )
        if trajectory:
            write_tum(temporary / TRAJECTORY, trajectory)
        if layers is not None:
            layers_file.write(temporary / layers_file.LAYERS, layers, temporary / HEIGHT_GRID)


def load(directory: Path | str, probability_threshold: float = PROBABILITY_THRESHOLD) -> LoadedMap:
    """Read ``height_grid.npz`` of a map directory, all of it or nothing.

    Parameters
    ----------
    directory : Path or str
    probability_threshold : float, optional
        Below it a cell is unknown; the reader's own, the file does not hold it.

    Raises
    ------
    InputError
        If the file is missing, damaged, foreign, of another version, or too large.
    """
    path = Path(directory) / HEIGHT_GRID
    require_file(path)
    with as_input_error(str(path)), zipfile.ZipFile(path) as archive:
        version = int(_read_field(archive, path, "format_version"))
        if not FORMAT_VERSION <= version <= FORMAT_VERSION_LEVELS:
            raise InputError(
                f"{path}: format_version is {version}, not within {FORMAT_VERSION} .. "
                f"{FORMAT_VERSION_LEVELS}"
            )
        names = [name for name in _FIELDS if _SINCE.get(name, FORMAT_VERSION) <= version]
        require_only(archive, path, names)
        for name in ("suspected", "level_lasers"):
            if f"{name}.npy" not in archive.namelist():
                names.remove(name)
        fields = {name: _read_field(archive, path, name) for name in names}
    return _checked(path, fields, probability_threshold)


def load_in(directory: Path, probability_threshold: float, frame_id: str) -> HeightMap:
    """The height map of a map directory that must be in a frame.

    Raises
    ------
    InputError
        If it is in another one; and for what `load` refuses.
    """
    loaded = load(directory, probability_threshold)
    if loaded.frame_id != frame_id:
        raise InputError(f"{directory}: frame_id is {loaded.frame_id!r}, not {frame_id!r}")
    return loaded.height_map


def digest(directory: Path) -> str:
    """SHA-256 of ``height_grid.npz``: the same map gives the same."""
    return hashlib.sha256((directory / HEIGHT_GRID).read_bytes()).hexdigest()


def map_yaml(geometry: Geometry) -> str:
    """The text of ``map.yaml``."""
    x, y, resolution = (
        # Not as 1e-05: YAML takes that for a string.
        np.format_float_positional(number, trim="0")
        for number in (*geometry.origin, geometry.resolution)
    )
    return (
        f"image: {MAP_PGM}\n"
        "mode: trinary\n"
        f"resolution: {resolution}\n"
        f"origin: [{x}, {y}, 0.0]\n"
        "negate: 0\n"
        f"occupied_thresh: {_OCCUPIED_THRESH}\n"
        f"free_thresh: {_FREE_THRESH}\n"
    )


def map_pgm(occupancy: NDArray[np.int8]) -> bytes:
    """The content of ``map.pgm``; its first row is the map's last one, the largest y."""
    pixels = np.full(occupancy.shape, _PIXEL_UNKNOWN, np.uint8)
    pixels[occupancy == 0] = _PIXEL_FREE
    pixels[occupancy == 100] = _PIXEL_OCCUPIED
    rows, columns = occupancy.shape
    return f"P5\n{columns} {rows}\n255\n".encode() + pixels[::-1].tobytes()


# What a field may be: the beginnings of numpy's names of its types, and its rank.
_FIELDS: Mapping[str, tuple[tuple[str, ...], int]] = {
    "format_version": (("i", "u"), 0),
    "height": (("i2",), 2),
    "probability": (("f4", "u2"), 2),
    "probability_scale": (("f",), 0),
    "height_resolution": (("f",), 0),
    "resolution": (("f",), 0),
    "origin": (("f",), 1),
    "frame_id": (("U",), 0),
    "z_offset": (("f",), 0),
    "suspected": (("b",), 2),
    "level_lasers": (("b",), 0),
    "upper_cell": (("i4",), 2),
    "upper_top": (("i2",), 1),
    "upper_bottom": (("i2",), 1),
    "upper_probability": (("f4",), 1),
}

_UPPER = ("upper_cell", "upper_top", "upper_bottom", "upper_probability")

_SINCE = {"z_offset": FORMAT_VERSION_OFFSET, **dict.fromkeys(_UPPER, FORMAT_VERSION_LEVELS)}
"""The version with which a field came."""


def _read_field(archive: zipfile.ZipFile, path: Path, name: str) -> NDArray[Any]:
    """One array of the archive; its type and size are checked before its data are read."""
    if f"{name}.npy" not in archive.namelist():
        raise InputError(f"{path}: {name} is missing")
    with as_input_error(f"{path}: {name}"):
        info = archive.getinfo(f"{name}.npy")
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise InputError(f"{path}: {name} is compressed in an unknown way")
        with archive.open(info) as file:
            _check_header(file, path, name)
        with archive.open(info) as file:
            return np.asarray(np.lib.format.read_array(file, allow_pickle=False))


def _check_header(file: IO[bytes], path: Path, name: str) -> None:
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0
    shape, _, dtype = (read if version == (1, 0) else np.lib.format.read_array_header_2_0)(file)
    types, rank = _FIELDS[name]
    if not dtype.str[1:].startswith(types) or len(shape) != rank:
        raise InputError(f"{path}: {name} is an array {shape} of {dtype}, not as in a map")
    if rank < 2 and name not in _UPPER and dtype.itemsize * math.prod(shape) > _MAX_SMALL_FIELD:
        raise InputError(f"{path}: {name} is too long")
    if math.prod(shape) > MAX_CELLS:
        raise InputError(f"{path}: {name} has {shape[0]} x {shape[1]} cells, which is too large")
    memory.require(math.prod(shape) * _BYTES_OF_CELL, f"{path}: {name}")


def _checked(path: Path, fields: dict[str, NDArray[Any]], threshold: float) -> LoadedMap:
    """The map made of its fields, once all of them are found right."""
    height, probability = fields["height"], fields["probability"]
    resolution, scale = float(fields["resolution"]), float(fields["probability_scale"])
    offset = float(fields.get("z_offset", np.array(0.0)))
    with as_input_error(f"{path}: frame_id"):  # may hold what is no character
        frame_id = str(fields["frame_id"])
    believed = probability if probability.dtype.kind == "f" else probability * np.float32(scale)
    suspected = fields.get("suspected", np.zeros(height.shape, bool))
    for fault, found in {
        "height is empty": height.size == 0,
        "height and probability differ in shape": height.shape != probability.shape,
        "height_resolution is not 0.01": not math.isclose(
            fields["height_resolution"], HEIGHT_RESOLUTION, rel_tol=1e-6
        ),
        "origin is not two finite coordinates": fields["origin"].shape != (2,)
        or not np.isfinite(fields["origin"]).all(),
        "frame_id is empty": not frame_id,
        "height holds values beyond the limit": height.size > 0
        and max(int(height.max()), -int(height.min())) > HEIGHT_LIMIT,
        "probability holds values outside of 0 .. 1": not (
            (believed >= 0.0) & (believed <= 1.0)
        ).all(),
        "suspected is not of unobserved cells": suspected.shape != believed.shape
        or bool(believed[suspected].any()),
    }.items():
        if found:
            raise InputError(f"{path}: {fault}")
    x, y = fields["origin"]
    geometry = Geometry(
        resolution=resolution,
        origin=(float(x), float(y)),
        shape=(height.shape[0], height.shape[1]),
        ground_zero=offset,
    )
    try:
        frame_name(frame_id, "frame_id")
        require_plausible(geometry)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    height_map = HeightMap(
        geometry=geometry,
        height=np.where(suspected, np.int16(SUSPECTED), height.astype(np.int16)),
        probability=_stored(believed),
        probability_threshold=threshold,
        upper=_upper_of(path, fields, height.shape) if "upper_cell" in fields else NO_UPPER,
        is_level=bool(fields.get("level_lasers", False)),
    )
    return LoadedMap(height_map=height_map, frame_id=frame_id)


def _stored(believed: NDArray[np.float32]) -> NDArray[np.uint16]:
    return np.asarray(np.floor(believed * np.float32(PROBABILITY_SCALE) + 0.5), np.uint16)


def _upper_of(path: Path, fields: dict[str, NDArray[Any]], shape: tuple[int, ...]) -> UpperSurfaces:
    """The surfaces above the lowest ones, once all of their fields are found right."""
    cell, top, bottom, believed = (fields[name] for name in _UPPER)
    count = len(top)
    if not (cell.shape == (count, 2) and bottom.shape == believed.shape == (count,)):
        raise InputError(f"{path}: {', '.join(_UPPER)} differ in length")
    for fault, found in {
        "upper_cell holds cells outside of the map": not ((cell >= 0) & (cell < shape)).all(),
        "upper_top holds values beyond the limit": (np.abs(top.astype(int)) > HEIGHT_LIMIT).any(),
        "upper_bottom holds values beyond the limit, or above upper_top": (
            (bottom.astype(int) < -HEIGHT_LIMIT) | (bottom > top)
        ).any(),
        "upper_probability holds values outside of 0 .. 1": not (
            (believed >= 0.0) & (believed <= 1.0)
        ).all(),
    }.items():
        if found:
            raise InputError(f"{path}: {fault}")
    return UpperSurfaces.of(cell, top, bottom, _stored(believed))
