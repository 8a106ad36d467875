# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d convert``: the obstacle grid of a map directory anew."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from heightmap25d_ros.commands.common import (
    Figures,
    add_command,
    cell_counts,
    check_output,
    read_params,
    require_map,
)
from heightmap25d_ros.io import layers_file, map_directory
from heightmap25d_ros.terrain.traversability import to_obstacle_map


def add_to(commands: Any) -> None:
    """Add ``convert``."""
    command = add_command(commands, "convert", _convert)
    command.add_argument("map", type=Path, metavar="DIR", help="map directory")
    command.add_argument("-o", "--output", type=Path, metavar="DIR",
                         help="map directory to write (default: the same)")  # fmt: skip


def _convert(options: argparse.Namespace) -> Figures:
    """Convert the heights of a map directory again, for instance for another robot."""
    settings = read_params(options)
    require_map(options.map)
    check_output(options.output or options.map)
    output = options.output or options.map
    loaded = map_directory.load(options.map, settings.mapper.probability_threshold)
    obstacle_map = to_obstacle_map(loaded.height_map, settings.traversability)
    layers = layers_file.load(options.map, loaded.height_map)
    map_directory.save(output, loaded.height_map, obstacle_map, loaded.frame_id, layers=layers)
    return {"map": str(output), **cell_counts(loaded.height_map, obstacle_map)}
