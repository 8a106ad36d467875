# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of two levels against the truth, and the goals and places that are planned to on them.

"places" are those that the robot was at both over and under another: right if a path leads over
and another one under them.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from level_drives import WORLDS, mapped, place, print_table, recorded, scans_of

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation.goal_reachability import evaluate_goals_on_levels
from heightmap25d_ros.evaluation.level_error import LevelErrors, evaluate_levels
from heightmap25d_ros.evaluation.path_drivability import evaluate_path
from heightmap25d_ros.evaluation.truth import LevelTruth, TrueGround, read_goals, read_levels
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.sections import LevelsParams, Params
from heightmap25d_ros.planning.level_planner import planner_over
from heightmap25d_ros.planning.plan import Plan
from heightmap25d_ros.simulation.recording import world_of
from heightmap25d_ros.simulation.scene import Scene

_SAME_LEVEL = 0.35  # [m] of a pose from the surface that it is on
_SLACK = 1e-3  # [m] of a step and a clear height at its limit


def contacts(plan: Plan, truth: LevelTruth, scene: Scene, params: Params) -> bool:
    """Whether a path leaves the true surface of its level, or touches something on it.

    Where both levels have the surface of a pose, as on a ramp, one on which it is free is enough.
    The cells of the truth decide where nothing is in reach, and the world itself elsewhere.
    """
    poses = se3.to_xyz_rpy(plan.poses)
    cells = truth.geometry.cell_at(poses[:, :2])
    is_on = np.abs(truth.top[:, cells[:, 0], cells[:, 1]] - poses[:, 2]) < _SAME_LEVEL
    return not all(
        any(
            _is_free_by_cells(pose, truth.ground(level), params)
            or _is_free(pose, scene, params, is_upper=level > 0)
            for level in np.flatnonzero(is_on[:, number])
        )
        for number, pose in enumerate(poses)
    )


def _is_free_by_cells(pose: Any, ground: TrueGround, params: Params) -> bool:
    """Whether a rectangle that is larger than the robot by two cells is free."""
    sides = np.array([params.planner.robot_length, params.planner.robot_width])
    found = evaluate_path(
        ground, pose[None, [0, 1, 5]], *(sides + 4 * ground.geometry.resolution).tolist()
    )
    is_clear = found.lowest_ceiling_m >= params.levels.clear_height - _SLACK
    return is_clear and found.largest_step_m <= params.traversability.max_step + _SLACK


def _is_free(pose: Any, scene: Scene, params: Params, *, is_upper: bool) -> bool:
    """Whether the robot's rectangle is free of steps and low ceilings at points 1 cm apart."""
    axes = [
        np.linspace(-side / 2, side / 2, round(side / 0.01) + 1)
        for side in (params.planner.robot_length, params.planner.robot_width)
    ]
    ahead, aside = np.meshgrid(*axes, indexing="ij")
    sine, cosine = np.sin(pose[5]), np.cos(pose[5])
    points = np.column_stack([
        (pose[0] + ahead * cosine - aside * sine).ravel(),
        (pose[1] + ahead * sine + aside * cosine).ravel(),
    ])  # fmt: skip
    height = scene.heights(points, with_overhead=is_upper)
    clearance = scene.undersides(points, height) - height
    grid = height.reshape(ahead.shape)
    step = max(np.abs(np.diff(grid, axis=axis)).max() for axis in (0, 1))
    is_clear = clearance.min() >= params.levels.clear_height - _SLACK
    return is_clear and step <= params.traversability.max_step + _SLACK


def of_plans(
    height_map: HeightMap, bag: Path, truth: LevelTruth, scene: Scene, params: Params
) -> dict[str, int]:
    """Goals that the planner finds and refuses, and paths that touch something."""
    planner = planner_over(
        height_map, params.levels, params.traversability, replace(params.planner, timeout=60.0)
    )
    pairs = read_goals(bag / "truth" / "goals.npz")
    plans = [
        planner.plan(place(start), place(goal))
        for start, goal in zip(pairs.start, pairs.goal, strict=True)
    ]
    found = np.array([plan.found for plan in plans])
    return {
        "observed": int(pairs.observed.sum()),
        "found": int((found & pairs.observed).sum()),
        "unreachable": int((~pairs.reachable).sum()),
        "refused": int((~found & ~pairs.reachable).sum()),
        "contacts": sum(contacts(plan, truth, scene, params) for plan in plans if plan.found),
    }


def row(errors: LevelErrors, plans: dict[str, int], ideal: Any) -> str:
    """A row of the table."""
    levels = [
        f"{level.tops_right:.3f}, {level.open_transitions.f1:.4f}, "
        f"{level.blocked_transitions.f1:.3f}"
        for level in (errors.lower, errors.upper)
    ]
    return (
        f"{levels[0]} | {levels[1]} | {errors.both_tops_right:.3f} of {errors.cells} | "
        f"{plans['found']} of {plans['observed']} ({ideal.found}) | "
        f"{plans['refused']} of {plans['unreachable']} | {plans['contacts']} |"
    )


def two_levels(folder: Path, seeds: list[int], params: Params) -> None:
    """The table of worlds with two levels."""
    print_table(
        "world, seed, order",
        "lower: tops, open F1, blocked F1",
        "upper: the same",
        "both tops",
        "goals found (ideal)",
        "refused",
        "paths with contact",
    )
    for world in WORLDS:
        for seed in seeds:
            bag = recorded(folder, world, seed)
            truth = read_levels(bag / "truth" / "surface.npz")
            assert truth is not None
            scene = world_of(world, seed).scene()
            scans = scans_of(bag, params)
            for order, ordered in (("driven", scans), ("reversed", scans[::-1])):
                height_map, _, _ = mapped(ordered, params)
                errors = evaluate_levels(height_map, params.levels, params.traversability, truth)
                plans = of_plans(height_map, bag, truth, scene, params)
                ideal = evaluate_goals_on_levels(
                    height_map, params.levels, params.traversability,
                    read_goals(bag / "truth" / "goals.npz"),
                )  # fmt: skip
                print(f"| `{world}`, {seed}, {order} | {row(errors, plans, ideal)}", flush=True)


def places(folder: Path, seeds: list[int], params: Params) -> None:
    """Places that the drive passed both over and under: whether paths lead there on both levels."""
    print_table("world, seed", "places", "both ways")
    for world in WORLDS:
        for seed in seeds:
            bag = recorded(folder, world, seed)
            height_map, *_ = mapped(scans_of(bag, params), params)
            planner = planner_over(
                height_map, params.levels, params.traversability,
                replace(params.planner, timeout=60.0),
            )  # fmt: skip
            start = place(read_goals(bag / "truth" / "goals.npz").start[0])
            passed = _passed_twice(bag)
            right = sum(
                all(planner.plan(start, place(position)).found for position in positions)
                for positions in passed
            )
            print(f"| `{world}`, {seed} | {len(passed)} | {right} |", flush=True)


def _passed_twice(bag: Path) -> list[tuple[Any, Any]]:
    """Lowest and highest position (x, y, z) in cells of 0.5 m where the robot was on two levels."""
    with Bag(bag) as opened:
        poses = [
            decode.odometry(event.message).T[:3, 3] for event in opened.events(["/ground_truth"])
        ]
    at = np.array(poses)
    cells = np.rint(at[:, :2] / 0.5).astype(int)
    inside = (at[(cells == cell).all(axis=1)] for cell in np.unique(cells, axis=0))
    extremes = ((near[near[:, 2].argmin()], near[near[:, 2].argmax()]) for near in inside)
    return [(low, high) for low, high in extremes if high[2] - low[2] > LevelsParams().clear_height]
