# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d export``: a map as points in a PLY or PCD file, or as a GeoTIFF."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from heightmap25d_ros.commands.common import (
    Figures,
    add_command,
    check_output,
    read_params,
    require_map,
)
from heightmap25d_ros.commands.import_map import GEOTIFF
from heightmap25d_ros.io import map_directory, point_files


def add_to(commands: Any) -> None:
    """Add ``export``."""
    command = add_command(commands, "export", _export)
    command.add_argument("map", type=Path, metavar="DIR", help="map directory")
    command.add_argument("-o", "--output", type=Path, required=True, metavar="FILE.ply|.pcd|.tif",
                         help="file to write; .tif: a GeoTIFF (needs rasterio)")  # fmt: skip
    command.add_argument("--crs", default="", metavar="EPSG:N",
                         help="of a .tif: the coordinate reference system of the map's frame, in "
                         "metres (default: none)")  # fmt: skip


def _export(options: argparse.Namespace) -> Figures:
    """Write the known cells of a map with their heights and probabilities."""
    settings = read_params(options)
    require_map(options.map)
    check_output(options.output.parent)
    height_map = map_directory.load(options.map, settings.mapper.probability_threshold).height_map
    if options.output.suffix.lower() in GEOTIFF:
        from heightmap25d_ros.io import geotiff  # noqa: PLC0415 - needs rasterio

        count = geotiff.write(options.output, height_map, options.crs)
    else:
        count = point_files.write(options.output, height_map)
    return {"file": str(options.output), "points": count}
