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
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import atomic_directory, map_directory, slam_file
from heightmap25d_ros.io.trajectory import read_tum
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.terrain.slices import SurfaceStack
from heightmap25d_ros.terrain.traversability import to_obstacle_map
from heightmap25d_ros.viz import map_figures, slam_figures


def add_to(commands: Any) -> None:
    """Add ``render``."""
    command = add_command(commands, "render", _render)
    command.add_argument("map", type=Path, metavar="DIR", help="map directory")
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help="directory for height.png, obstacles.png, blocks.png")  # fmt: skip


def _levels(height_map: HeightMap, settings: Params) -> list[HeightMap]:
    """The slices of a map of several levels; none of a map of one level.

    A level is one that the robot could stand on: tops of walls are none.
    """
    if not len(height_map.upper):
        return []
    stack = SurfaceStack(height_map, settings.levels, settings.traversability)
    levels: list[HeightMap] = []
    for found in stack.slices(stack.footprint_cells):
        shown = found.height_map
        free = to_obstacle_map(shown, settings.traversability).occupancy == 0
        for other in levels:
            free &= ~other.known | (shown.height != other.height)
        if not levels or free.sum() >= stack.footprint_cells:
            levels.append(shown)
    return levels if len(levels) > 1 else []


def _render(options: argparse.Namespace) -> Figures:
    """Draw a map directory: heights, obstacles, and blocks as in Fig. 2(c) of the paper.

    A map of several levels also gets heights and obstacles of each level, one without known poses
    the drive, how well it is known, and the closed loops.
    """
    settings = read_params(options)
    require_map(options.map)
    check_output(options.output)
    height_map = map_directory.load(options.map, settings.mapper.probability_threshold).height_map
    trajectory = None
    if (options.map / map_directory.TRAJECTORY).exists():
        trajectory = read_tum(options.map / map_directory.TRAJECTORY)[:, 1:4]
    obstacles = to_obstacle_map(height_map, settings.traversability)
    names = [f"{name}.png" for name in ("height", "obstacles", "blocks")]
    report = slam_file.load(options.map)
    with atomic_directory.adding(options.output) as new:
        map_figures.height_map(new / names[0], height_map, trajectory)
        map_figures.obstacle_map(new / names[1], obstacles, trajectory, height_map)
        map_figures.blocks(new / names[2], height_map, trajectory)
        for number, level in enumerate(_levels(height_map, settings), 1):
            converted = to_obstacle_map(level, settings.traversability)
            names += [f"{name}_level_{number}.png" for name in ("height", "obstacles")]
            map_figures.height_map(new / names[-2], level, trajectory)
            map_figures.obstacle_map(new / names[-1], converted, trajectory, level)
        if report is not None and trajectory is not None:
            names.append("drive.png")
            covariances = slam_file.read_covariances(options.map, len(trajectory))
            loops = slam_file.closed_loops(report)
            slam_figures.drive(new / names[-1], height_map, trajectory, covariances, loops)
    return {"pictures": [str(options.output / name) for name in names]}
