# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The table of docs/planning.md: paths over maps of simulated drives, driven on the true surface.

Usage: python studies/measure_planning.py [--bags DIR]

Five worlds, three seeds each, mapped with true poses and the default parameters. Of each drive's
goals.npz every pair of start and goal is planned; every path is held against the true surface
under the robot's rectangle. With --bags, recordings that are in DIR/WORLD_SEED are taken and the
others made there; without, all are made anew and thrown away. Markdown to the terminal.
"""

import argparse
import math
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from measure_defaults import SEEDS, WORLDS, record, run

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation.path_drivability import Drivability, evaluate_path
from heightmap25d_ros.evaluation.truth import TrueGround, read_goals, read_ground
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.graph import transition_graph
from heightmap25d_ros.planning.plan import Plan, Pose2D
from heightmap25d_ros.planning.planner import Planner


@dataclass
class Tally:
    """Of all seeds of a world."""

    observed: int = 0
    found: int = 0
    unreachable: int = 0
    refused: int = 0
    drivable: int = 0
    paths: int = 0
    worst_step: float = 0.0
    worst_slope: float = 0.0
    milliseconds: list[float] = field(default_factory=list)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bags", type=Path, metavar="DIR", help="where recordings are, or go to")
    options = parser.parse_args()
    params = Params()
    print(f"| world, {len(SEEDS)} seeds | observed goals found | unreachable ones refused | paths "
          "that can be driven | largest step | steepest slope | ms a plan |")  # fmt: skip
    print("|---" * 7 + "|")
    with tempfile.TemporaryDirectory() as scratch:
        bags = options.bags or Path(scratch, "bags")
        bags.mkdir(parents=True, exist_ok=True)
        record(bags)
        for world in WORLDS:
            tally = Tally()
            for seed in SEEDS:
                measure(bags / f"{world}_{seed}", Path(scratch, f"{world}_{seed}"), params, tally)
            print(
                f"| `{world}` | {tally.found} of {tally.observed} | {tally.refused} of "
                f"{tally.unreachable} | {tally.drivable} of {tally.paths} | "
                f"{tally.worst_step:.3f} m | {math.degrees(tally.worst_slope):.1f} deg | "
                f"{np.median(tally.milliseconds):.1f} |"
            )


def measure(bag: Path, directory: Path, params: Params, tally: Tally) -> None:
    run("map", bag, "-o", directory)
    height_map = map_directory.load(directory, params.mapper.probability_threshold).height_map
    graph = transition_graph(height_map, params.traversability, params.planner)
    planner = Planner(graph, params.traversability, params.planner)
    goals = read_goals(bag / "truth" / "goals.npz")
    ground = read_ground(bag / "truth" / "surface.npz")
    plans = [
        planner.plan(Pose2D(*start), Pose2D(*goal), is_robot_there=False)
        for start, goal in zip(goals.start[:, :2].tolist(), goals.goal[:, :2].tolist(), strict=True)
    ]
    is_found = np.array([plan.found for plan in plans])
    tally.observed += int(goals.observed.sum())
    tally.found += int((is_found & goals.observed).sum())
    tally.unreachable += int((~goals.reachable).sum())
    tally.refused += int((~is_found & ~goals.reachable).sum())
    tally.milliseconds += [1e3 * plan.seconds for plan in plans]
    for plan in plans:
        if plan.found:
            met = driven(ground, plan, params)
            tally.paths += 1
            tally.worst_step = max(tally.worst_step, met.largest_step_m)
            tally.worst_slope = max(tally.worst_slope, met.steepest_slope_rad)
            tally.drivable += (
                met.largest_step_m <= params.traversability.max_step + 1e-6
                and met.steepest_slope_rad <= params.traversability.max_slope
            )


def driven(ground: TrueGround, plan: Plan, params: Params) -> Drivability:
    xyz_rpy = se3.to_xyz_rpy(plan.poses)
    size = params.planner.robot_length, params.planner.robot_width
    return evaluate_path(ground, xyz_rpy[:, [0, 1, 5]], *size)


if __name__ == "__main__":
    main()
