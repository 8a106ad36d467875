# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of worlds with two levels against the truth: the tables of docs/levels.md.

    python studies/measure_levels.py [--bags DIR] [--seeds 24 25 26] [--only SECTION ...]

Each drive is mapped with true poses, its scans in their order and in the reverse order: so each
deck is seen first once. Recordings are kept, and reused, in ``--bags``.

"places" are those that the robot was at both over and under another: right if a path leads over
and another one under them. "gates" are those of the world `arch`, with and without a nodding laser:
right if a path leads through exactly where the robot fits. "localization" is that of a drive with
drifting odometry on the map of another drive, apart for the upper level.
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
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import LevelsParams, Params
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import replayed
from heightmap25d_ros.planning.level_planner import planner_over
from heightmap25d_ros.planning.plan import Plan, Pose2D
from heightmap25d_ros.pose_interpolation import interpolate
from heightmap25d_ros.simulation.recording import mounted_sensors, simulate, world_of

WORLDS = ("overpass", "garage")
ONE_LEVEL = ("ramp", "room", "rough", "street", "moving")
SCAN_RATE = 18.75
_THROUGH = 2.6  # [m] of a path of 2 m that leads through a gate, and not around
_UPPER = 1.5  # [m] z above which the robot is on the upper level
_SAME_LEVEL = 0.35  # [m] of a pose from the surface that it is on


def recorded(folder: Path, world: str, seed: int) -> Path:
    """A drive through a world, recorded where it is not there yet."""
    bag = folder / f"{world}_{seed}"
    if not bag.exists():
        simulate(world, seed, bag, mounted=mounted_sensors(SCAN_RATE))
    return bag


def scans_of(
    bag_path: Path, params: Params, topics: tuple[str, ...] = ("/scan", "/scan_down")
) -> list[Beams]:
    """The beams of each scan, from true poses."""
    with Bag(bag_path) as bag:
        intake = replace(params.intake, scan_topics=topics)
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


def places(folder: Path, seeds: list[int], params: Params) -> None:
    """Places that the drive passed both over and under: whether paths lead there on both levels."""
    print("| world, seed | places | both ways |")
    print("|---|---|---|")
    for world in WORLDS:
        for seed in seeds:
            bag = recorded(folder, world, seed)
            height_map, *_ = mapped(scans_of(bag, params), params)
            planner = planner_over(
                height_map, params.levels, params.traversability,
                replace(params.planner, timeout=60.0),
            )  # fmt: skip
            start = _place(read_goals(bag / "truth" / "goals.npz").start[0])
            passed = _passed_twice(bag)
            right = sum(
                all(planner.plan(start, Pose2D(x, y, z=z)).found for z in heights)
                for x, y, *heights in passed
            )
            print(f"| `{world}`, {seed} | {len(passed)} | {right} |", flush=True)


def _passed_twice(bag: Path) -> list[tuple[float, ...]]:
    """Places (x, y, z below, z above), 0.5 m apart, at which the robot was on two levels."""
    with Bag(bag) as opened:
        poses = [
            decode.odometry(event.message).T[:3, 3] for event in opened.events(["/ground_truth"])
        ]
    at = np.array(poses)
    found: dict[tuple[int, ...], tuple[float, ...]] = {}
    for cell in {tuple(cell) for cell in np.rint(at[:, :2] / 0.5).astype(int).tolist()}:
        near = at[np.hypot(*(at[:, :2] - 0.5 * np.array(cell)).T) < 0.2]
        if len(near) and np.ptp(near[:, 2]) > LevelsParams().clear_height:
            low, high = near[near[:, 2].argmin()], near[near[:, 2].argmax()]
            found[cell] = (float(low[0]), float(low[1]), float(low[2]), float(high[2]))
    return list(found.values())


def gates(folder: Path, seeds: list[int], params: Params) -> None:
    """Gates of `arch` that are planned through, or not, as they should be."""
    print("| seed, lasers | gates right | wrong (clear height) | undersides seen | largest error |")
    print("|---|---|---|---|---|")
    for seed in seeds:
        for has_nodding in (False, True):
            bag = folder / f"arch_{seed}{'_nodding' * has_nodding}"
            if not bag.exists():
                sensors = mounted_sensors(SCAN_RATE, has_nodding=has_nodding)
                simulate("arch", seed, bag, mounted=sensors)
            topics = ("/scan", "/scan_down", *(["/scan_nod"] * has_nodding))
            height_map, *_ = mapped(scans_of(bag, params, topics), params)
            planner = planner_over(height_map, params.levels, params.traversability, params.planner)
            wrong, errors, count = [], [], 0
            for solid in world_of("arch", seed).solids:
                if not solid.is_overhead:
                    continue
                (x, y, z), half = solid.center, solid.size
                clear, count = z - half[2], count + 1
                plan = planner.plan(
                    Pose2D(x - 1.0, y, yaw=0.0, z=0.0), Pose2D(x + 1.0, y, yaw=0.0, z=0.0)
                )
                is_open = plan.found and plan.length < _THROUGH and not plan.reason
                if is_open != (clear >= params.levels.clear_height):
                    wrong.append(f"{clear:.2f} m")
                errors += _underside_errors(height_map, x, y, half, clear)
            largest = f"{max(errors):.3f} m" if errors else "-"
            name = "with the nodding one" if has_nodding else "two"
            told = ", ".join(wrong) or "none"
            print(f"| {seed}, {name} | {count - len(wrong)} of {count} | {told} | "
                  f"{len(errors)} | {largest} |", flush=True)  # fmt: skip


def _underside_errors(
    height_map: HeightMap, x: float, y: float, half: Any, clear: float
) -> list[float]:
    """By how much [m] the underside of a lintel is off, where the map has surfaces of it."""
    centres = height_map.geometry.cell_center(height_map.upper.cell)
    inside = (np.abs(centres - (x, y)) < np.array(half[:2]) + 0.07).all(axis=1)
    bottoms = height_map.upper.bottom[inside] * 0.01
    return [abs(float(bottoms.min()) - clear)] if inside.any() else []


def localization(folder: Path, seeds: list[int], params: Params) -> None:
    """Errors of drives with drifting odometry, on the map of another drive."""
    print("| world, seed | odometry alone: end | RMSE | lower | upper | largest | z RMSE |")
    print("|---|---|---|---|---|---|---|")
    params = replace(params, intake=replace(params.intake, scan_topics=("/scan", "/scan_down")))
    for world in WORLDS:
        for seed in seeds:
            bags = [folder / f"{world}_{seed}_drive{drive}" for drive in (0, 1)]
            for drive, bag in enumerate(bags):
                if not bag.exists():
                    simulate(world, seed, bag, drive=drive)
            print(f"| `{world}`, {seed} | {_localized(*bags, params)}", flush=True)


def _localized(driven: Path, mapped_drive: Path, params: Params) -> str:
    mapping, localizer = Mapping(params), Localizer(params)
    with Bag(mapped_drive) as bag:
        for _ in replayed(bag, mapping, "/ground_truth", params.intake):
            pass
    mapping.flush()
    height_map = mapping.maps()[0]
    localizer.set_long_term(height_map, mapping.layers(height_map.geometry))
    told, alone, stamps = [], [], []
    with Bag(driven) as bag:
        truth = [decode.odometry(event.message) for event in bag.events(["/ground_truth"])]
        for step in replayed(bag, localizer, "/odom", params.intake):
            pose = localizer.pose
            if pose is not None and (not stamps or pose.stamp_ns > stamps[-1]):
                told.append(pose.T_map_base)
                alone.append(se3.inverse(pose.T_map_odom) @ pose.T_map_base)
                stamps.append(pose.stamp_ns)
            del step
    times = np.array([pose.stamp_ns for pose in truth])
    true = interpolate(
        times, np.array([pose.T for pose in truth]), np.clip(stamps, times[0], times[-1])
    )
    off = np.array(told)[:, :3, 3] - true[:, :3, 3]
    away, is_upper = np.hypot(off[:, 0], off[:, 1]), true[:, 2, 3] > _UPPER
    drift = np.hypot(*(np.array(alone)[-1, :2, 3] - true[-1, :2, 3]))
    rmse = [f"{np.sqrt(np.mean(away[chosen] ** 2)):.3f} m" for chosen in (
        np.ones(len(away), bool), ~is_upper, is_upper,
    )]  # fmt: skip
    return (
        f"{drift:.2f} m | {' | '.join(rmse)} | {away.max():.3f} m | "
        f"{np.sqrt(np.mean(off[:, 2] ** 2)):.3f} m |"
    )


def cost(folder: Path, seeds: list[int], params: Params) -> None:
    """Processor time and known cells with levels, against those without."""
    single = replace(params, levels=LevelsParams(max_surfaces=1))
    print("| world | time per beam | known cells | lost, won, moved > 0.10 m | upper surfaces |")
    print("|---|---|---|---|---|")
    for world in (*ONE_LEVEL, *WORLDS):
        scans = scans_of(recorded(folder, world, seeds[0]), params)
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


SECTIONS = {
    "levels": two_levels,
    "places": places,
    "gates": gates,
    "localization": localization,
    "cost": cost,
}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bags", type=Path, help="directory of recordings, kept and reused")
    parser.add_argument("--seeds", type=int, nargs="+", default=[24, 25, 26])
    parser.add_argument("--only", nargs="+", choices=list(SECTIONS), default=list(SECTIONS))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.bags or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for section in options.only:
            SECTIONS[section](folder, options.seeds, Params())


if __name__ == "__main__":
    main()
