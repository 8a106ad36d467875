# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d render``: pictures of a map directory."""

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
from heightmap25d_ros.io import atomic_directory, map_directory
from heightmap25d_ros.io.trajectory import read_tum
from heightmap25d_ros.terrain.traversability import to_obstacle_map
from heightmap25d_ros.viz import map_figures


def add_to(commands: Any) -> None:
    """Add ``render``."""
    command = add_command(commands, "render", _render)
    command.add_argument("map", type=Path, metavar="DIR", help="map directory")
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help="directory for height.png, obstacles.png, blocks.png")  # fmt: skip


def _render(options: argparse.Namespace) -> Figures:
    """Draw a map directory: heights, obstacles, and blocks as in Fig. 2(c) of the paper."""
    settings = read_params(options)
    require_map(options.map)
    check_output(options.output)
    height_map = map_directory.load(options.map, settings.mapper.probability_threshold).height_map
    trajectory = None
    if (options.map / map_directory.TRAJECTORY).exists():
        trajectory = read_tum(options.map / map_directory.TRAJECTORY)[:, 1:4]
    obstacles = to_obstacle_map(height_map, settings.traversability)
    names = [f"{name}.png" for name in ("height", "obstacles", "blocks")]
    with atomic_directory.adding(options.output) as new:
        map_figures.height_map(new / names[0], height_map, trajectory)
        map_figures.obstacle_map(new / names[1], obstacles, trajectory, height_map)
        map_figures.blocks(new / names[2], height_map, trajectory)
    return {"pictures": [str(options.output / name) for name in names]}
