# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d convert``, ``render``, ``evaluate``, ``info``: what can be done with a map."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from heightmap25d_ros import (
    evaluation,
    map_io,
    messages,
    reachability,
    render,
    se3,
    trajectory_error,
)
from heightmap25d_ros.bag import Bag
from heightmap25d_ros.commands.command import Figures, add_command, cell_counts, read_params
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid import HEIGHT_RESOLUTION
from heightmap25d_ros.traversability import convert

GROUND_TRUTH = "/ground_truth"


def add_to(commands: Any) -> None:
    """Add ``convert``, ``render``, ``evaluate`` and ``info``."""
    command = add_command(commands, "convert", _convert, "the obstacle grid of a map anew")
    command.add_argument("map", type=Path, metavar="DIR", help="map directory")
    command.add_argument("-o", "--output", type=Path, metavar="DIR",
                         help="map directory to write (default: the same)")  # fmt: skip

    command = add_command(commands, "render", _render, "pictures of a map directory")
    command.add_argument("map", type=Path, metavar="DIR", help="map directory")
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help="directory for height.png, obstacles.png, blocks.png")  # fmt: skip

    command = add_command(commands, "evaluate", _evaluate, "a map directory against the truth")
    command.add_argument("map", type=Path, metavar="DIR", help="map directory")
    command.add_argument("--truth", type=Path, required=True, metavar="FILE",
                         help="the world's surface, as bags/ramp/truth/surface.npz; goals.npz "
                         "beside it is used as well")  # fmt: skip
    command.add_argument("--bag", type=Path, metavar="BAG",
                         help="its /ground_truth is the truth of trajectory.tum")  # fmt: skip

    command = add_command(commands, "info", _info, "what is in a bag or a map directory")
    command.add_argument("path", type=Path, metavar="BAG|DIR")


def _convert(options: argparse.Namespace) -> Figures:
    """Convert the heights of a map directory again, for instance for another robot."""
    settings = read_params(options)
    output = options.output or options.map
    loaded = map_io.load(options.map, settings.mapper.probability_threshold)
    obstacle_map = convert(loaded.height_map, settings.traversability)
    map_io.save(output, loaded.height_map, obstacle_map, loaded.frame_id)
    return {"map": str(output), **cell_counts(loaded.height_map, obstacle_map)}


def _render(options: argparse.Namespace) -> Figures:
    """Draw a map directory: heights, obstacles, and blocks as in Fig. 2(c) of the paper."""
    settings = read_params(options)
    height_map = map_io.load(options.map, settings.mapper.probability_threshold).height_map
    trajectory = None
    if (options.map / map_io.TRAJECTORY).exists():
        trajectory = map_io.read_tum(options.map / map_io.TRAJECTORY)[:, 1:4]
    options.output.mkdir(parents=True, exist_ok=True)
    pictures = [options.output / f"{name}.png" for name in ("height", "obstacles", "blocks")]
    render.height_map(pictures[0], height_map, trajectory)
    render.obstacle_map(pictures[1], convert(height_map, settings.traversability), trajectory)
    render.blocks(pictures[2], height_map, trajectory)
    return {"pictures": [str(picture) for picture in pictures]}


def _evaluate(options: argparse.Namespace) -> Figures:
    """Hold a map directory against the truth of its world: surface, goals, trajectory."""
    settings = read_params(options)
    height_map = map_io.load(options.map, settings.mapper.probability_threshold).height_map
    truth = evaluation.read_truth(options.truth)
    figures = evaluation.evaluate(height_map, settings.traversability, truth).as_dict()
    goals = options.truth.with_name("goals.npz")
    if goals.exists():
        obstacle_map = convert(height_map, settings.traversability)
        pairs = reachability.read_goals(goals)
        figures["goals"] = reachability.evaluate_goals(obstacle_map, pairs).as_dict()
    if options.bag:
        figures["trajectory"] = _trajectory_error(options.map / map_io.TRAJECTORY, options.bag)
    return figures


def _trajectory_error(trajectory: Path, bag_path: Path) -> dict[str, float]:
    with Bag(bag_path) as bag:
        true = [messages.odometry(event.message) for event in bag.events([GROUND_TRUTH])]
    rows = map_io.read_tum(trajectory)
    error = trajectory_error.evaluate_trajectory(
        np.rint(rows[:, 0] * 1e9).astype(np.int64),
        se3.from_quaternion(rows[:, 1:4], rows[:, 4:]),
        np.array([pose.stamp_ns for pose in true], np.int64),
        np.array([pose.T for pose in true]),
    )
    if error is None:
        raise InputError(f"{trajectory}: no pose of it is within the {GROUND_TRUTH} of {bag_path}")
    return error.as_dict()


def _info(options: argparse.Namespace) -> Figures:
    """Tell what is in a bag or a map directory."""
    settings = read_params(options)
    if (options.path / map_io.HEIGHT_GRID).exists():
        loaded = map_io.load(options.path, settings.mapper.probability_threshold)
        geometry, heights = loaded.height_map.geometry, loaded.height_map
        known = heights.height[heights.known] * HEIGHT_RESOLUTION
        return {
            "frame": loaded.frame_id,
            "size [cells]": list(geometry.shape[::-1]),
            "resolution [m]": geometry.resolution,
            "origin [m]": list(geometry.origin),
            "heights [m]": [round(known.min(), 2), round(known.max(), 2)] if known.size else [],
            **cell_counts(heights, convert(heights, settings.traversability)),
        }
    with Bag(options.path) as bag:
        return {
            "bag": str(options.path),
            "duration [s]": round(bag.duration, 3),
            **{f"{name} ({topic.message_type})": topic.count for name, topic in bag.topics.items()},
        }
