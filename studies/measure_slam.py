# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/slam.md: maps without known poses, of simulated laps and of real logs.

Usage: python studies/measure_slam.py [--bags DIR] [--logs BAG ...] [--only SECTION ...]
                                      [--seeds N ...]

With --bags, recordings that are in DIR/WORLD_SEED_DRIVE are taken and the others made there;
without, all are made anew and thrown away. Markdown to the terminal. --logs are recordings of level
lasers with /scan, /odom and the poses of a reference on /ground_truth, which are only compared
with; all parameters have their defaults.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import io
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation import map_error, truth
from heightmap25d_ros.evaluation.truth import Truth
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import replayed
from heightmap25d_ros.pipelines.slam import SlamResult, slam_bag
from heightmap25d_ros.pose_interpolation import interpolate
from heightmap25d_ros.simulation import recording

WORLDS = ("room", "ramp", "rough", "street")
TUNED, UNTUNED = (1,), (2, 3, 4, 5)
SCANS = ("/scan", "/scan_down")
PARAMS = with_values(Params(), {"intake.scan_topics": list(SCANS)})
LEVEL = with_values(Params(), {"intake.scan_topics": ["/scan"]})
Poses = tuple[np.ndarray, se3.Matrix]


@dataclasses.dataclass(frozen=True)
class Error:
    """Of a trajectory: as it is, and moved and turned to where it fits best [m]."""

    rmse: float
    end: float
    aligned: float
    aligned_max: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bags", type=Path, metavar="DIR", help="where recordings are, or go to")
    parser.add_argument("--logs", nargs="+", type=Path, metavar="BAG", default=(), help="real ones")
    sections = ("laps", "logs")
    parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=WORLDS)
    parser.add_argument("--seeds", nargs="+", type=int, default=(*TUNED, *UNTUNED), help="of laps")
    parser.add_argument("--only", nargs="+", choices=sections, default=sections)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        if "laps" in options.only:
            for line in laps(options.bags or Path(scratch), options.worlds, options.seeds):
                print(line, flush=True)
        if "logs" in options.only and options.logs:
            for line in logs(options.logs):
                print(line, flush=True)


def laps(bags: Path, worlds: Sequence[str], seeds: Sequence[int]) -> Iterator[str]:
    yield (
        "| lap | ATE: odometry | own map | aligned | end | F1: true poses | own map | odometry "
        "| loops closed | not observed | CPU s per s |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|---|"
    for world in worlds:
        for seed in seeds:
            path = bags / f"{world}_{seed}_0"
            if not path.exists():
                recording.simulate(world, seed, path, drive=0)
            yield lap(f"`{world}` {seed}", path)


def lap(label: str, path: Path) -> str:
    surface = truth.read_truth(path / "truth" / "surface.npz")
    with Bag(path) as bag:
        true = true_poses(bag)
        began = time.process_time()
        result = slam_bag(bag, PARAMS, "/odom")
        seconds = time.process_time() - began
        own, odometry = (error_of(poses, true) for poses in (result.trajectory, result.odometry))
        scores = [
            f1(height_map, surface)
            for height_map in (
                mapped(bag, "/ground_truth"), result.mapping.maps()[0], mapped(bag, "/odom")
            )
        ]  # fmt: skip
        duration = bag.duration
    return (
        f"| {label} | {odometry.rmse:.3f} m | {own.rmse:.3f} m | {own.aligned:.3f} m "
        f"| {own.end:.3f} m | {scores[0]:.3f} | {scores[1]:.3f} | {scores[2]:.3f} "
        f"| {closed(result)} | {result.slam.tracker.unobserved:.1f} m | {seconds / duration:.2f} |"
    )


def logs(paths: Sequence[Path]) -> Iterator[str]:
    yield (
        "\n| log | distance | odometry: ATE, aligned | own map: ATE, aligned | largest | loops "
        "closed | searches | passes disagree | times real time |"
    )
    yield "|---|---|---|---|---|---|---|---|---|"
    for path in paths:
        with Bag(path) as bag:
            true = true_poses(bag)
            began = time.process_time()
            result = slam_bag(bag, LEVEL, "/odom")
            seconds = time.process_time() - began
            speed = bag.duration / seconds
        own, odometry = (error_of(poses, true) for poses in (result.trajectory, result.odometry))
        outcomes = Counter(attempt.outcome for attempt in result.slam.tracker.attempts)
        told = ", ".join(f"{name} {count}" for name, count in outcomes.most_common())
        yield (
            f"| `{path.name}` | {result.slam.tracker.distance:.0f} m | {odometry.aligned:.2f} m "
            f"| {own.aligned:.3f} m | {own.aligned_max:.2f} m | {closed(result)} | {told} "
            f"| {result.disagreed:.1f} m | {speed:.0f} |"
        )


def true_poses(bag: Bag) -> Poses:
    poses = [decode.odometry(event.message) for event in bag.events(["/ground_truth"])]
    return np.array([p.stamp_ns for p in poses]), np.array([p.T for p in poses])


def error_of(trajectory: Sequence[tuple[int, se3.Matrix]], true: Poses) -> Error:
    """Horn's alignment in the plane, as the ATE of the TUM benchmark; stamps that both have."""
    stamps = np.array([stamp for stamp, _ in trajectory])
    is_known = (stamps >= true[0][0]) & (stamps <= true[0][-1])
    found = np.array([pose for _, pose in trajectory])[is_known][:, :2, 3]
    expected = interpolate(*true, stamps[is_known])[:, :2, 3]
    away = np.linalg.norm(found - expected, axis=1)
    a, b = found - found.mean(axis=0), expected - expected.mean(axis=0)
    turn = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    cos, sin = np.cos(turn), np.sin(turn)
    left = np.linalg.norm(a @ np.array([[cos, sin], [-sin, cos]]) - b, axis=1)
    return Error(
        rmse=float(np.sqrt(np.mean(away**2))), end=float(away[-1]),
        aligned=float(np.sqrt(np.mean(left**2))), aligned_max=float(left.max()),
    )  # fmt: skip


def mapped(bag: Bag, topic: str) -> HeightMap:
    mapping = Mapping(PARAMS)
    for _ in replayed(bag, mapping, topic, PARAMS.intake):
        pass
    return mapping.maps()[0]


def f1(height_map: HeightMap, surface: Truth) -> float:
    """Of the blocked transitions."""
    found = map_error.evaluate_map(height_map, PARAMS.traversability, surface)
    return found.blocked_transitions.f1 or 0.0


def closed(result: SlamResult) -> int:
    return sum(edge.is_loop for edge in result.slam.tracker.graph.edges)


if __name__ == "__main__":
    with contextlib.redirect_stderr(io.StringIO()):
        main()
