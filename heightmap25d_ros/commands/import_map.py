# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d import``: a map directory from an occupancy grid of others."""

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
from heightmap25d_ros.io import map_directory, occupancy_map
from heightmap25d_ros.terrain.traversability import to_obstacle_map

_WALL = 1.0


def add_to(commands: Any) -> None:
    """Add ``import``."""
    command = add_command(commands, "import", _import)
    command.add_argument("map", type=Path, metavar="MAP.YAML",
                         help="of nav2_map_server, slam_toolbox, ...: trinary, scale or raw, also "
                         "with a turned origin")  # fmt: skip
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help="map directory to write")  # fmt: skip
    command.add_argument("--wall-height", type=float, default=_WALL, metavar="H",
                         help=f"of what is occupied [m] (default: {_WALL:g})")  # fmt: skip


def _import(options: argparse.Namespace) -> Figures:
    """Make a flat height map with walls of an occupancy grid: to plan, localize and map on in."""
    settings = read_params(options)
    check_output(options.output)
    source = occupancy_map.read(options.map)
    height_map = replace(
        occupancy_map.to_height_map(source, options.wall_height),
        probability_threshold=settings.mapper.probability_threshold,
    )
    obstacle_map = to_obstacle_map(height_map, settings.traversability)
    map_directory.save(options.output, height_map, obstacle_map, settings.mapping.map_frame)
    return {
        "map": str(options.output),
        "size_cells": list(height_map.geometry.shape[::-1]),
        "resolution_m": height_map.geometry.resolution,
        "yaw_rad": source.origin[2],
        **cell_counts(height_map, obstacle_map),
    }
