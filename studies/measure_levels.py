# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of worlds with two levels against the truth: the tables of docs/levels.md.

    python studies/measure_levels.py [--bags DIR] [--seeds 21 22 23]

Each drive is mapped with true poses, its scans in their order and in the reverse order: so each
deck is seen first once. Recordings are kept, and reused, in ``--bags``.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation.goal_reachability import evaluate_goals_on_levels
from heightmap25d_ros.evaluation.level_error import LevelErrors, evaluate_levels
from heightmap25d_ros.evaluation.path_drivability import evaluate_path
from heightmap25d_ros.evaluation.truth import LevelTruth, TrueGround, read_goals, read_levels
from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import LevelsParams, Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import replayed
from heightmap25d_ros.planning.level_planner import planner_over
from heightmap25d_ros.planning.plan import Plan, Pose2D
from heightmap25d_ros.simulation.recording import mounted_sensors, simulate

WORLDS = ("overpass", "garage")
ONE_LEVEL = ("ramp", "room", "rough", "street", "moving")
SCAN_RATE = 18.75
_SAME_LEVEL = 0.35  # [m] of a pose from the surface that it is on


def recorded(folder: Path, world: str, seed: int) -> Path:
    """A drive through a world, recorded where it is not there yet."""
    bag = folder / f"{world}_{seed}"
    if not bag.exists():
        simulate(world, seed, bag, mounted=mounted_sensors(SCAN_RATE))
    return bag


def scans_of(bag_path: Path, params: Params) -> list[Beams]:
    """The beams of each scan, from true poses."""
    with Bag(bag_path) as bag:
        intake = replace(params.intake, scan_topics=("/scan", "/scan_down"))
        settings = replace(params, intake=intake)
        mapping = Mapping(settings)
        return [
            reading.beams(settings)
            for step in replayed(bag, mapping, "/ground_truth", settings.intake)
            for reading in step.outcomes
        ]


def mapped(scans: list[Beams], params: Params) -> tuple[HeightMap, float, HeightGrid]:
    """A map of scans, the seconds of processor time that it took, and its grid."""
    grid = HeightGrid(params.grid, levels=params.levels)
    mapper = Mapper(grid, params.sensor, params.mapper)
    began = time.process_time()
    for beams in scans:
        mapper.integrate(beams)
    return grid.read(), time.process_time() - began, grid


def contacts(plan: Plan, truth: LevelTruth, params: Params) -> bool:
    """Whether a path leaves the true surface of its level, or touches something on it.

    Where both levels have the surface of a pose, as on a ramp, one on which it is free is enough.
    """
    poses = se3.to_xyz_rpy(plan.poses)
    cells = truth.geometry.cell_at(poses[:, :2])
    is_on = np.abs(truth.top[:, cells[:, 0], cells[:, 1]] - poses[:, 2]) < _SAME_LEVEL
    return not all(
        any(
            _is_free(pose, truth.ground(level), params)
            for level in np.flatnonzero(is_on[:, number])
        )
        for number, pose in enumerate(poses)
    )


def _is_free(pose: Any, ground: TrueGround, params: Params) -> bool:
    robot = params.planner.robot_length, params.planner.robot_width
    found = evaluate_path(ground, pose[None, [0, 1, 5]], *robot)
    is_clear = found.lowest_ceiling_m >= params.levels.clear_height - 1e-3
    return is_clear and found.largest_step_m <= params.traversability.max_step + 1e-3


def of_plans(height_map: HeightMap, bag: Path, truth: LevelTruth, params: Params) -> dict[str, int]:
    """Goals that the planner finds and refuses, and paths that touch something."""
    planner = planner_over(
        height_map, params.levels, params.traversability, replace(params.planner, timeout=60.0)
    )
    pairs = read_goals(bag / "truth" / "goals.npz")
    plans = [
        planner.plan(_place(start), _place(goal))
        for start, goal in zip(pairs.start, pairs.goal, strict=True)
    ]
    found = np.array([plan.found for plan in plans])
    return {
        "observed": int(pairs.observed.sum()),
        "found": int((found & pairs.observed).sum()),
        "unreachable": int((~pairs.reachable).sum()),
        "refused": int((~found & ~pairs.reachable).sum()),
        "contacts": sum(contacts(plan, truth, params) for plan in plans if plan.found),
    }


def _place(point: Any) -> Pose2D:
    return Pose2D(float(point[0]), float(point[1]), z=float(point[2]))


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
    print(
        "| world, seed, order | lower: tops, open F1, blocked F1 | upper: the same | both tops "
        "| goals found (ideal) | refused | paths with contact |"
    )
    print("|---|---|---|---|---|---|---|")
    for world in WORLDS:
        for seed in seeds:
            bag = recorded(folder, world, seed)
            truth = read_levels(bag / "truth" / "surface.npz")
            assert truth is not None
            scans = scans_of(bag, params)
            for order, ordered in (("driven", scans), ("reversed", scans[::-1])):
                height_map, _, _ = mapped(ordered, params)
                errors = evaluate_levels(height_map, params.levels, params.traversability, truth)
                plans = of_plans(height_map, bag, truth, params)
                ideal = evaluate_goals_on_levels(
                    height_map, params.levels, params.traversability,
                    read_goals(bag / "truth" / "goals.npz"),
                )  # fmt: skip
                print(f"| `{world}`, {seed}, {order} | {row(errors, plans, ideal)}", flush=True)


def cost(folder: Path, seed: int, params: Params) -> None:
    """Processor time and known cells with levels, against those without."""
    single = replace(params, levels=LevelsParams(max_surfaces=1))
    print("| world | time per beam | known cells | lost, won, moved > 0.10 m | upper surfaces |")
    print("|---|---|---|---|---|")
    for world in (*ONE_LEVEL, *WORLDS):
        scans = scans_of(recorded(folder, world, seed), params)
        before, *_ = mapped(scans, single)
        after, *_ = mapped(scans, params)
        times = np.array([
            [mapped(scans, settings)[1] for settings in (single, params)] for _ in range(5)
        ]).min(axis=0)  # fmt: skip
        area = before.known, after.known
        moved = np.abs(before.height.astype(int) - after.height) > 10
        counts = (
            (area[0] & ~area[1]).sum(),
            (area[1] & ~area[0]).sum(),
            (moved & area[0] & area[1]).sum(),
        )
        print(f"| `{world}` | {times[1] / times[0] - 1:+.1%} | {area[0].sum()} | "
              f"{', '.join(map(str, counts))} | {len(after.upper)} |", flush=True)  # fmt: skip


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bags", type=Path, help="directory of recordings, kept and reused")
    parser.add_argument("--seeds", type=int, nargs="+", default=[21, 22, 23])
    parser.add_argument("--without-cost", action="store_true", help="not the table of cost")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.bags or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        two_levels(folder, options.seeds, Params())
        if not options.without_cost:
            cost(folder, options.seeds[0], Params())


if __name__ == "__main__":
    main()
