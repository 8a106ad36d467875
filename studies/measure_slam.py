# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/slam.md: maps without known poses, of simulated laps and of real logs.

Usage: python studies/measure_slam.py [--bags DIR] [--logs BAG ...] [--only SECTION ...]
                                      [--worlds NAME ...] [--seeds N ...]

Sections: `laps`; `live`, what is told while they are driven, before all poses are refined together;
`localized`, another lap on maps of true poses and on own ones; `drift`, the same as `laps` with
three times the drift, or with wheels that slip by 15 %; `laps_merged`, three laps, weaving
differently, in one map; `court`, a long loop; `twins`, searches for loops where one place looks
like another; `logs`; `peers`, KISS-ICP and small_gicp on laps and logs.

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
import slam_peers
from localization_drives import localized, material

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation import map_error, truth
from heightmap25d_ros.evaluation.trajectory_error import (
    alignment,
    confidently_wrong,
    planar_errors,
)
from heightmap25d_ros.evaluation.truth import Truth
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import replayed
from heightmap25d_ros.pipelines.slam import Slam, SlamResult, slam_bag
from heightmap25d_ros.pipelines.slam_drives import DriveTask, join_drives, slam_drive
from heightmap25d_ros.pose_interpolation import interpolate
from heightmap25d_ros.simulation import recording
from heightmap25d_ros.simulation.odometry import OdometryNoise
from heightmap25d_ros.simulation.simulation import Noise
from heightmap25d_ros.slam.own_map_tracker import OwnMapTracker
from heightmap25d_ros.slam.pose_graph import between

WORLDS = ("room", "ramp", "rough", "street")
TUNED, UNTUNED = (1,), (2, 3, 4, 5)
SCANS = ("/scan", "/scan_down")
PARAMS = with_values(Params(), {"intake.scan_topics": list(SCANS)})
LEVEL = with_values(Params(), {"intake.scan_topics": ["/scan"]})
UNCHANGED = ("slip_length", "tilt_sigma", "tilt_time")
"""Of the odometry's noise where it drifts thrice as much."""

DRIVES = (0, 1, 2)
"""Of the simulator through one world, that become one map."""

SLOW = 10.0
"""Scans per second, in which places that look alike are searched."""

NEAR_SIGHTED = with_values(PARAMS, {"slam.active_distance": 8.0})
"""So that drives of 40 m search for loops at all."""

WRONG = 1.0
"""Error of a loop [m] that is another place."""

Poses = tuple[np.ndarray, se3.Matrix]
Told = Sequence[tuple[int, se3.Matrix]]


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
    sections = (
        "laps", "live", "localized", "drift", "laps_merged", "court", "twins", "logs", "peers"
    )  # fmt: skip
    parser.add_argument("--worlds", nargs="+", default=WORLDS, help="of laps")
    parser.add_argument("--seeds", nargs="+", type=int, default=(*TUNED, *UNTUNED), help="of laps")
    parser.add_argument("--only", nargs="+", choices=sections, default=sections)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        bags = options.bags or Path(scratch)
        tables = {
            "laps": laps(bags, options.worlds, options.seeds),
            "live": live_laps(bags, options.worlds, options.seeds),
            "localized": localized_laps(bags, options.worlds, options.seeds),
            "drift": drifting(bags, options.worlds, options.seeds),
            "laps_merged": merged_laps(bags, options.worlds, options.seeds),
            "court": laps(bags, ("court",), options.seeds),
            "twins": wrong_loops(bags, options.seeds),
            "logs": logs(options.logs),
            "peers": peers(bags, options.worlds, options.seeds, options.logs),
        }
        for section in options.only:
            for line in tables[section]:
                print(line, flush=True)


def laps(bags: Path, worlds: Sequence[str], seeds: Sequence[int]) -> Iterator[str]:
    yield (
        "| lap | ATE: odometry | own map | aligned | end | F1: true poses | own map | odometry "
        "| loops closed | not observed | CPU s per s |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|---|"
    for world in worlds:
        for seed in seeds:
            yield lap(f"`{world}` {seed}", recorded(bags, world, seed))


def recorded(bags: Path, world: str, seed: int, drive: int = 0) -> Path:
    """A drive of the simulator, made where it is not there."""
    path = bags / f"{world}_{seed}_{drive}"
    if not path.exists():
        recording.simulate(world, seed, path, drive=drive)
    return path


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


def live_laps(bags: Path, worlds: Sequence[str], seeds: Sequence[int]) -> Iterator[str]:
    """Poses that are told while laps are driven, and where submaps are in the end."""
    yield (
        "| lap | told: aligned | largest | end | confidently wrong | in the map: aligned | refined "
        "| CPU s per s |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    for world in worlds:
        for seed in seeds:
            yield live_lap(f"`{world}` {seed}", recorded(bags, world, seed))


def live_lap(label: str, path: Path) -> str:
    slam, told, covariances, wheels = Slam(PARAMS), [], [], []
    with Bag(path) as bag:
        true = true_poses(bag)
        began = time.process_time()
        for step in replayed(bag, slam, "/odom", PARAMS.intake):
            for reading in step.outcomes:
                told.append((reading.scan.stamp_ns, slam.tracker.T_map_base))
                wheels.append(reading.T_map_base[-1])
                covariances.append(slam.tracker.covariance()[:2, :2])
        load = (time.process_time() - began) / bag.duration
    own = error_of(told, true)
    mapped = [
        (pose.stamp_ns, pose.T_map_odom @ T)
        for pose, T in zip(slam.tracker.poses(), wheels, strict=False)
    ]
    stamps = np.clip([stamp for stamp, _ in told], true[0][0], true[0][-1])
    poses = np.array([T for _, T in told])
    is_wrong = confidently_wrong(poses, interpolate(*true, stamps), np.array(covariances))
    return (
        f"| {label} | {own.aligned:.3f} m | {own.aligned_max:.2f} m | {own.end:.3f} m "
        f"| {100 * is_wrong.mean():.0f} % | {error_of(mapped, true).aligned:.3f} m "
        f"| {slam.tracker.refined} | {load:.2f} |"
    )


def localized_laps(bags: Path, worlds: Sequence[str], seeds: Sequence[int]) -> Iterator[str]:
    """A lap that is localized on maps of another one: with true poses, and without known ones."""
    yield (
        "| lap | on a map of true poses: RMSE | aligned | largest, aligned | on its own: RMSE "
        "| aligned | largest, aligned |"
    )
    yield "|---|---|---|---|---|---|---|"
    for world in worlds:
        for seed in seeds:
            events, truth, long_term = material(bags, world, seed)
            with Bag(recorded(bags, world, seed, 1)) as bag:
                mapping = slam_bag(bag, PARAMS, "/odom").mapping
            own = mapping.maps()[0]
            errors = []
            for given in (long_term, (own, mapping.layers(own.geometry))):
                localizer = Localizer(PARAMS)
                localizer.set_long_term(*given)
                run = localized(events, localizer)
                errors.append(error_of(list(zip(run.stamps, run.told, strict=True)), truth))
            figures = " | ".join(
                f"{e.rmse:.3f} m | {e.aligned:.3f} m | {e.aligned_max:.2f} m" for e in errors
            )
            yield f"| `{world}` {seed} | {figures} |"


def merged_laps(bags: Path, worlds: Sequence[str], seeds: Sequence[int]) -> Iterator[str]:
    """Maps of single drives beside the one map of all of them."""
    yield (
        "| laps | map | ATE | F1 | heights: mean error | off by > 10 cm | found: position | z "
        "| yaw | CPU |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for world in worlds:
        for seed in seeds:
            yield from merged(f"`{world}` {seed}", [recorded(bags, world, seed, d) for d in DRIVES])


def merged(label: str, paths: Sequence[Path]) -> Iterator[str]:
    surfaces = [truth.read_truth(path / "truth" / "surface.npz") for path in paths]
    tasks, true = [], []
    for path in paths:
        with Bag(path) as bag:
            stretch = bag.start_ns, bag.end_ns + 1
            true.append(true_poses(bag))
        tasks.append(DriveTask(path=path, params=PARAMS, odom_topic="/odom", stretch=stretch))
    began = time.process_time()
    drives = [slam_drive(task) for task in tasks]
    joint = join_drives(tasks, drives)
    seconds = time.process_time() - began
    for number, (drive, poses, surface) in enumerate(zip(drives, true, surfaces, strict=True)):
        error, of_map = error_of(drive.trajectory, poses), figures(drive.height_map, surface)
        yield f"| {label} | drive {number} | {error.rmse:.3f} m | {of_map} | | | | |"
    errors = [error_of(*pair).rmse for pair in zip(joint.trajectories, true, strict=True)]
    for number, found in enumerate(joint.found[1:], 1):
        x, y, z, _, _, yaw = se3.to_xyz_rpy(found.T_fixed_moving)
        yield (
            f"| {label} | drive {number} in drive 0 | | | | | {100 * np.hypot(x, y):.1f} cm "
            f"| {100 * z:.1f} cm | {np.degrees(yaw):.2f} deg | |"
        )
    told = ", ".join(f"{error:.3f}" for error in errors)
    whole = figures(joint.mapping.maps()[0], seen_by_all(surfaces))
    yield f"| {label} | merged | {told} m | {whole} | | | | {seconds:.0f} s |"


def seen_by_all(surfaces: Sequence[Truth]) -> Truth:
    """The highest points that lasers have measured on any of the drives through a world."""
    seen = np.fmax.reduce([surface.seen for surface in surfaces])
    return dataclasses.replace(surfaces[0], seen=seen)


def figures(height_map: HeightMap, surface: Truth) -> str:
    """F1 of blocked transitions, and errors of heights of what lasers see."""
    found = map_error.evaluate_map(height_map, PARAMS.traversability, surface)
    seen = found.error_of_seen
    return (
        f"{found.blocked_transitions.f1 or 0.0:.3f} | {100 * (seen.bias_m or 0.0):.1f} cm "
        f"| {100 * (seen.share_beyond_10_cm or 0.0):.2f} %"
    )


def drifting(bags: Path, worlds: Sequence[str], seeds: Sequence[int]) -> Iterator[str]:
    usual = OdometryNoise()
    fields = {field.name for field in dataclasses.fields(usual)} - set(UNCHANGED)
    thrice = {name: 3.0 * getattr(usual, name) for name in fields}
    for label, noise in (
        ("thrice", dataclasses.replace(usual, **thrice)),
        ("slip", dataclasses.replace(usual, slip=0.15)),
    ):
        for world in worlds:
            for seed in seeds:
                path = bags / f"{world}_{seed}_{label}"
                if not path.exists():
                    recording.simulate(world, seed, path, noise=Noise(odometry=noise))
                yield lap(f"`{world}` {seed}, {label}", path)


def wrong_loops(bags: Path, seeds: Sequence[int]) -> Iterator[str]:
    """Loops that were closed between places that are not the same."""
    yield "| world | drives | searches | closed | wrong | largest error of a closed one |"
    yield "|---|---|---|---|---|---|"
    for world in ("twin_rooms", "pillars"):
        searches, errors = 0, []
        for seed in seeds:
            path = bags / f"{world}_{seed}_slow_scans"
            if not path.exists():
                mounted = recording.mounted_sensors(SLOW)
                recording.simulate(world, seed, path, mounted=mounted)
            with Bag(path) as bag:
                slam = Slam(NEAR_SIGHTED)
                for _ in replayed(bag, slam, "/odom", NEAR_SIGHTED.intake):
                    pass
                searches += len(slam.tracker.attempts)
                errors += loop_errors(slam.tracker, true_poses(bag))
        wrong = sum(error > WRONG for error in errors)
        largest = f"{max(errors):.2f} m" if errors else "-"
        yield f"| `{world}` | {len(seeds)} | {searches} | {len(errors)} | {wrong} | {largest} |"


def loop_errors(tracker: OwnMapTracker, true: Poses) -> list[float]:
    """How far off each loop's measurement is [m]."""
    # The last submap was begun after the last scan.
    starts = np.full(len(tracker.submaps), tracker.placed[-1].stamp_ns)
    for placed in reversed(tracker.placed):
        starts[placed.submap] = placed.stamp_ns
    poses = interpolate(*true, np.clip(starts, true[0][0], true[0][-1]))
    planar = se3.to_xyz_rpy(poses)[:, [0, 1, 5, 2]]
    return [
        float(np.hypot(*(between(planar[e.first], planar[e.second]) - e.measured)[:2]))
        for e in tracker.graph.edges
        if e.is_loop
    ]


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


def peers(
    bags: Path, worlds: Sequence[str], seeds: Sequence[int], paths: Sequence[Path]
) -> Iterator[str]:
    """KISS-ICP and small_gicp beside odometry; what comes of ours is in the other sections."""
    yield "\n| drive | method | ATE | aligned | largest, aligned | CPU s per s |"
    yield "|---|---|---|---|---|---|"
    drives = [(recorded(bags, world, seed), PARAMS) for world in worlds for seed in seeds]
    for path, params in [*drives, *((path, LEVEL) for path in paths)]:
        with Bag(path) as bag:
            true, found, duration = (
                true_poses(bag),
                list(slam_peers.frames(bag, params)),
                bag.duration,
            )
        yield peer(path.name, "odometry", [(f.stamp_ns, f.odometry) for f in found], true, 0.0)
        for method, name in ((slam_peers.kiss_icp, "KISS-ICP"), (slam_peers.small_gicp, "VGICP")):
            for is_guided, how in ((False, ""), (True, ", guided by odometry")):
                began = time.process_time()
                told = method(found, is_guided=is_guided)
                seconds = time.process_time() - began
                yield peer(path.name, f"{name}{how}", told, true, seconds / duration)


def peer(label: str, name: str, told: Told, true: Poses, load: float) -> str:
    error = error_of(told, true)
    return (
        f"| `{label}` | {name} | {error.rmse:.3f} m | {error.aligned:.3f} m "
        f"| {error.aligned_max:.2f} m | {load:.2f} |"
    )


def true_poses(bag: Bag) -> Poses:
    poses = [decode.odometry(event.message) for event in bag.events(["/ground_truth"])]
    return np.array([p.stamp_ns for p in poses]), np.array([p.T for p in poses])


def error_of(trajectory: Told, true: Poses) -> Error:
    """Of positions at stamps that both have, before and after alignment in the plane."""
    stamps = np.array([stamp for stamp, _ in trajectory])
    is_known = (stamps >= true[0][0]) & (stamps <= true[0][-1])
    found = np.array([pose for _, pose in trajectory])[is_known]
    expected = interpolate(*true, stamps[is_known])
    away = planar_errors(found, expected)[:, 0]
    left = planar_errors(alignment(found, expected) @ found, expected)[:, 0]
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
