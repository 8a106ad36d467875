# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d plan``: a path over a map directory."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from heightmap25d_ros import se3
from heightmap25d_ros.commands.common import (
    Figures,
    add_command,
    check_output,
    read_params,
    require_map,
)
from heightmap25d_ros.errors import InputError, NegativeResultError
from heightmap25d_ros.evaluation.path_drivability import evaluate_path
from heightmap25d_ros.evaluation.truth import read_ground
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import atomic_directory, map_directory, trajectory
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.planning import Planning
from heightmap25d_ros.planning.plan import Plan, Pose2D
from heightmap25d_ros.planning.planner import compile_kernels
from heightmap25d_ros.terrain.slices import SurfaceStack
from heightmap25d_ros.viz import plan_figure

PLAN_TUM, PLAN_PNG = "plan.tum", "plan.png"
EXIT_NO_PATH = 3


def add_to(commands: Any) -> None:
    """Add ``plan``."""
    command = add_command(commands, "plan", _plan)
    command.add_argument("map", type=Path, metavar="DIR", help="map directory")
    for name in ("start", "goal"):
        command.add_argument(f"--{name}", type=_place, required=True, metavar="X,Y[,YAW]",
                             help=f"{name} in the map [m], [rad]")  # fmt: skip
        command.add_argument(f"--{name}-z", type=_height, metavar="Z",
                             help=f"z of the {name} [m]: its level, in a map with several "
                             "(default: the lowest)")  # fmt: skip
    command.add_argument("-o", "--output", type=Path, required=True, metavar="OUT",
                         help=f"directory for {PLAN_TUM} and {PLAN_PNG}")  # fmt: skip
    command.add_argument("--truth", type=Path, metavar="FILE",
                         help="the world's surface.npz, to drive on")  # fmt: skip


def _place(text: str) -> Pose2D:
    try:
        numbers = [float(number) for number in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not all(math.isfinite(number) for number in numbers):
        raise argparse.ArgumentTypeError(f"{text!r} is not X,Y or X,Y,YAW")
    return Pose2D(*numbers)


def _height(text: str) -> float:
    z = float(text)
    if not math.isfinite(z):
        raise ValueError
    return z


def _plan(options: argparse.Namespace) -> Figures:
    """Plan a path: the exit status is 3 where there is none, and the figures say why.

    The path is written as TUM text, with the distance along it [m] in place of the time, and
    drawn over heights and obstacles, with a profile of height and slope.
    """
    settings = read_params(options, "planning")
    require_map(options.map)
    check_output(options.output)
    height_map = map_directory.load(options.map, settings.mapper.probability_threshold).height_map
    if height_map.is_level:
        raise InputError(f"{options.map}: was made by level lasers, its ground is unknown")
    compile_kernels()  # not what is timed
    planning = Planning(settings)
    planning.set_map(height_map)
    start, goal = replace(options.start, z=options.start_z), replace(options.goal, z=options.goal_z)
    plan = planning.plan_between(start, goal)
    paths = [options.output / name for name in (PLAN_TUM, PLAN_PNG)]
    if not plan.found or plan.graph is None:
        for path in paths:
            path.unlink(missing_ok=True)  # of an earlier plan
        raise NegativeResultError(_figures(plan), EXIT_NO_PATH)
    distance = plan_figure.distances(plan.poses)
    with atomic_directory.adding(options.output) as new:
        trajectory.write_tum(
            new / PLAN_TUM,
            [(round(d * 1e9), T) for d, T in zip(distance, plan.poses, strict=True)],
        )
        level = _level_of(height_map, start, settings)
        plan_figure.draw(new / PLAN_PNG, level, plan.graph, plan, settings.planner)
    figures = {**_figures(plan), "path": str(paths[0]), "picture": str(paths[1])}
    if options.truth:
        xyz_rpy = se3.to_xyz_rpy(plan.poses)
        figures["on_true_surface"] = evaluate_path(
            read_ground(options.truth),
            xyz_rpy[:, [0, 1, 5]],
            settings.planner.robot_length,
            settings.planner.robot_width,
        ).as_dict()
    return figures


def _level_of(height_map: HeightMap, place: Pose2D, settings: Params) -> HeightMap:
    """The level of a place, which is the whole map where there is no other."""
    if not len(height_map.upper):
        return height_map
    stack = SurfaceStack(height_map, settings.levels, settings.traversability)
    surface = stack.surface_at(place.x, place.y, place.z)
    return (stack.lowest() if surface is None else stack.followed(surface)).height_map


def _figures(plan: Plan) -> Figures:
    figures: Figures = {
        "status": _status(plan), "error_code": int(plan.status), "reason": plan.reason,
    }  # fmt: skip
    if plan.found:
        is_clear = math.isinf(plan.least_clearance)
        figures |= {
            "length_m": round(plan.length, 3),
            "climb_m": round(plan.climb, 3),
            "steepest_slope_rad": round(plan.steepest_slope, 4),
            "least_clearance_m": None if is_clear else round(plan.least_clearance, 3),
            "cost_m": round(plan.cost, 3),  # of flat open ground
        }
    return {**figures, "planning_ms": round(1e3 * plan.seconds, 2)}


def _status(plan: Plan) -> str:
    """The status in words; Nav2 has one code for occupied and for unknown ground."""
    if plan.found:
        return "found"
    name = plan.status.name.lower()
    return name.replace("occupied", "unknown") if "unknown ground" in plan.reason else name
