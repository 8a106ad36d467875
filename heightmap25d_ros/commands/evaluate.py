# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d evaluate``: a map directory against the truth of its world."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.commands.common import Figures, add_command, read_params, require_map
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.evaluation import trajectory_error
from heightmap25d_ros.evaluation.goal_reachability import evaluate_goals_on_levels
from heightmap25d_ros.evaluation.level_error import evaluate_levels
from heightmap25d_ros.evaluation.map_error import LEAST_OVERLAP, evaluate_map, overlap
from heightmap25d_ros.evaluation.truth import read_goals, read_levels, read_truth
from heightmap25d_ros.io import decode, map_directory
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.io.trajectory import read_tum
from heightmap25d_ros.terrain.slices import SurfaceStack

GROUND_TRUTH = "/ground_truth"


def add_to(commands: Any) -> None:
    """Add ``evaluate``."""
    command = add_command(commands, "evaluate", _evaluate)
    command.add_argument("map", type=Path, metavar="DIR", help="map directory")
    command.add_argument("--truth", type=Path, required=True, metavar="FILE",
                         help="the world's surface, as bags/ramp/truth/surface.npz; goals.npz "
                         "beside it is used as well")  # fmt: skip
    command.add_argument("--bag", type=Path, metavar="BAG",
                         help="its /ground_truth is the truth of trajectory.tum")  # fmt: skip


def _evaluate(options: argparse.Namespace) -> Figures:
    """Hold a map directory against the truth of its world: surface, goals, trajectory."""
    settings = read_params(options)
    require_map(options.map)
    height_map = map_directory.load(options.map, settings.mapper.probability_threshold).height_map
    truth, levels = read_truth(options.truth), read_levels(options.truth)
    stack = SurfaceStack(height_map, settings.levels, settings.traversability)
    # The truth is the highest surface of each cell.
    highest = stack.highest().height_map if len(height_map.upper) else height_map
    share = overlap(highest, truth)
    if share < LEAST_OVERLAP:
        raise InputError(
            f"{options.map}: only {share:.0%} of its {height_map.known.sum()} known cells are "
            f"where {options.truth} has a surface of about their height (a map of the same world: "
            f"{LEAST_OVERLAP:.0%} or more); is this the truth of another world?"
        )
    figures = evaluate_map(highest, settings.traversability, truth).as_dict()
    if levels is not None:
        figures["levels"] = evaluate_levels(
            height_map, settings.levels, settings.traversability, levels
        ).as_dict()
    goals = options.truth.with_name("goals.npz")
    if goals.exists():
        figures["goals"] = evaluate_goals_on_levels(
            height_map, settings.levels, settings.traversability, read_goals(goals)
        ).as_dict()
    if options.bag:
        figures["trajectory"] = _trajectory_error(
            options.map / map_directory.TRAJECTORY, options.bag
        )
    return figures


def _trajectory_error(trajectory: Path, bag_path: Path) -> dict[str, float]:
    with Bag(bag_path) as bag:
        true = [decode.odometry(event.message) for event in bag.events([GROUND_TRUTH])]
    rows = read_tum(trajectory)
    error = trajectory_error.evaluate_trajectory(
        np.rint(rows[:, 0] * 1e9).astype(np.int64),
        se3.from_quaternion(rows[:, 1:4], rows[:, 4:]),
        np.array([pose.stamp_ns for pose in true], np.int64),
        np.array([pose.T for pose in true]),
    )
    if error is None:
        raise InputError(f"{trajectory}: no pose of it is within the {GROUND_TRUTH} of {bag_path}")
    return error.as_dict()
