# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d import``: a map directory from an occupancy grid or an elevation model."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from heightmap25d_ros.commands.common import (
    Figures,
    add_command,
    cell_counts,
    check_output,
    read_params,
)
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import map_directory, occupancy_map
from heightmap25d_ros.terrain.traversability import to_obstacle_map

GEOTIFF = (".tif", ".tiff")
_WALL = 1.0


def add_to(commands: Any) -> None:
    """Add ``import``."""
    command = add_command(commands, "import", _import)
    command.add_argument("map", type=Path, metavar="MAP.YAML|DEM.tif",
                         help="of nav2_map_server, slam_toolbox, ...: trinary, scale or raw, also "
                         "with a turned origin; or a GeoTIFF of heights (needs rasterio)"
                         )  # fmt: skip
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help="map directory to write")  # fmt: skip
    command.add_argument("--wall-height", type=float, default=_WALL, metavar="H",
                         help=f"of what is occupied in MAP.YAML [m] (default: {_WALL:g})"
                         )  # fmt: skip


def _import(options: argparse.Namespace) -> Figures:
    """Make a map of a file of others: to plan, localize and map on in."""
    settings = read_params(options)
    check_output(options.output)
    height_map, yaw = _read(options.map, options.wall_height)
    height_map = replace(height_map, probability_threshold=settings.mapper.probability_threshold)
    obstacle_map = to_obstacle_map(height_map, settings.traversability)
    map_directory.save(options.output, height_map, obstacle_map, settings.mapping.map_frame)
    return {
        "map": str(options.output),
        "size_cells": list(height_map.geometry.shape[::-1]),
        "resolution_m": height_map.geometry.resolution,
        "yaw_rad": yaw,
        **cell_counts(height_map, obstacle_map),
    }


def _read(path: Path, wall_height: float) -> tuple[HeightMap, float]:
    """The map in a file, and the yaw [rad] of the file's cells: a flat map with walls, or a DEM."""
    if path.suffix.lower() in GEOTIFF:
        from heightmap25d_ros.io import geotiff  # noqa: PLC0415 - needs rasterio

        return geotiff.read(path), 0.0
    source = occupancy_map.read(path)
    return occupancy_map.to_height_map(source, wall_height), source.origin[2]
