# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d import``: a map directory from a map of others, or a bag from clouds in files."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.commands.common import (
    Figures,
    add_command,
    cell_counts,
    check_output,
    read_params,
)
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import cloud_sequence, map_directory, occupancy_map
from heightmap25d_ros.terrain.traversability import to_obstacle_map

GEOTIFF = (".tif", ".tiff")
_WALL = 1.0


def add_to(commands: Any) -> None:
    """Add ``import``."""
    command = add_command(commands, "import", _import)
    command.add_argument("map", type=Path, metavar="MAP.YAML|DEM.tif|FOLDER",
                         help="of nav2_map_server, slam_toolbox, ...: trinary, scale or raw, also "
                         "with a turned origin; a GeoTIFF of heights (needs rasterio); or a folder "
                         "of clouds, .bin (KITTI), .pcd, .ply or .3d (3DTK), which becomes a bag"
                         )  # fmt: skip
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help="map directory to write; of a folder of clouds: the bag")  # fmt: skip
    command.add_argument("--wall-height", type=float, default=_WALL, metavar="H",
                         help=f"of what is occupied in MAP.YAML [m] (default: {_WALL:g})"
                         )  # fmt: skip

    clouds = command.add_argument_group("a folder of clouds")
    clouds.add_argument("--poses", type=Path, metavar="FILE",
                        help="poses of the sensor, one a cloud: KITTI's 12 numbers a line, or TUM "
                        "text; 3DTK's are beside its scans")  # fmt: skip
    clouds.add_argument("--times", type=Path, metavar="FILE", help="a time [s] a line")
    clouds.add_argument("--calib", type=Path, metavar="FILE",
                        help="KITTI's, where the poses are those of its camera")  # fmt: skip
    clouds.add_argument("--mount", type=_mount, default=np.eye(4), metavar="X,Y,Z,ROLL,PITCH,YAW",
                        help="of the sensor in base_link [m, rad]; the height above the ground at "
                        "least (default: all 0)")  # fmt: skip


def _mount(text: str) -> se3.Matrix:
    numbers = np.array([float(part) for part in text.split(",")])
    if len(numbers) != 6 or not np.isfinite(numbers).all():
        raise argparse.ArgumentTypeError(f"{text} is not x,y,z,roll,pitch,yaw")
    return se3.from_xyz_rpy(numbers)


def _import(options: argparse.Namespace) -> Figures:
    """Make a map of a file of others, to plan, localize and map on in; or a bag of clouds."""
    return _import_clouds(options) if options.map.is_dir() else _import_map(options)


def _import_clouds(options: argparse.Namespace) -> Figures:
    sequence = cloud_sequence.read(options.map, options.poses, options.times, options.calib)
    count = cloud_sequence.write_bag(options.output, sequence, options.mount)
    stamps = sequence.stamps_ns
    return {
        "bag": str(options.output),
        "clouds": len(stamps),
        "points": count,
        "duration_s": round(float(stamps[-1] - stamps[0]) * 1e-9, 3),
    }


def _import_map(options: argparse.Namespace) -> Figures:
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
