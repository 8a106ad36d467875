# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/localization.md: laps, corrected and not; kidnapped robots; real data.

Usage: python studies/measure_localization.py [--bags DIR] [--logs BAG ...] [--only SECTION ...]
         [--worlds WORLD ...] [--seeds SEED ...]

Simulated drives; long-term maps are of other drives through the same worlds. With --bags,
recordings that are in DIR/WORLD_SEED_DRIVE are taken and the others made there; without, all are
made anew and thrown away. Markdown to the terminal.

--logs are recordings of level lasers with /scan, /odom and the poses of a reference on
/ground_truth, with which their long-term map is made; all parameters have their defaults.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import io
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from localization_drives import (
    PARAMS,
    LongTerm,
    Run,
    error_of,
    events_of,
    localized,
    mapped,
    material,
    overconfident,
    truth_of,
)
from localization_peers import peers
from lost_robots import REPEATED, UNIQUE, kidnapped, wrong_starts
from scipy.spatial import cKDTree
from scipy.stats import chi2

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation import trajectory_error
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.bag import Bag, Event
from heightmap25d_ros.localization.landmarks import landmarks_of
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pose_interpolation import interpolate

WORLDS = ("room", "ramp", "rough", "street")
SEEDS = (1, 2, 3, 4)
SHORT_TERM = with_values(PARAMS, {"scan_filter.enabled": False})
PAPER = with_values(PARAMS, {"registration.method": "paper"})
METHODS = {"default": PARAMS, "short-term maps": SHORT_TERM, "paper": PAPER}
ON_MAP = 0.5, 0.2  # share of the returns within so many metres of a wall of the map
SAME_SCAN = 2e7  # [ns] between a pose of the reference and one of the odometry
SECTIONS = ("laps", "corrected", "kidnapped", "starts", "logs", "peers")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bags", type=Path, metavar="DIR", help="where recordings are, or go to")
    parser.add_argument("--logs", nargs="+", type=Path, metavar="BAG", default=(), help="real ones")
    parser.add_argument("--worlds", nargs="+", metavar="WORLD", help="instead of all of a section")
    parser.add_argument("--seeds", nargs="+", type=int, metavar="SEED", help="of the worlds")
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=SECTIONS)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        for line in tables(options, options.bags or Path(scratch)):
            print(line, flush=True)


def tables(options: argparse.Namespace, bags: Path) -> Iterator[str]:
    """The lines of the sections that are asked for."""
    worlds, seeds = options.worlds, options.seeds
    if "laps" in options.only:
        yield from laps(bags, worlds or WORLDS, seeds or SEEDS)
    if "corrected" in options.only:
        yield from on_corrected_maps(bags, seeds or SEEDS)
    if "kidnapped" in options.only:
        yield from kidnapped(bags, worlds or (*UNIQUE, *REPEATED), seeds or (1, 2))
    if "starts" in options.only:
        yield from wrong_starts(bags, worlds or WORLDS, seeds or (1,))
    if "logs" in options.only:
        yield from real_logs(options.logs)
    if "peers" in options.only:
        yield from beside_peers(bags, worlds or ("room", "street"), seeds or (11,), options.logs)


def normalised(run: Run, truth: tuple[np.ndarray, se3.Matrix]) -> np.ndarray:
    """Squared errors of x, y, yaw over their covariance, one a second once it tracks."""
    stamps = np.array(run.stamps)
    true = interpolate(*truth, np.clip(stamps, truth[0][0], truth[0][-1]))
    error = se3.to_xyz_rpy(np.array(run.told)) - se3.to_xyz_rpy(true)
    error = error[:, [0, 1, 5]]
    error[:, 2] = np.angle(np.exp(1j * error[:, 2]))
    chosen = np.arange(100, len(stamps), 50)
    return np.array([error[k] @ np.linalg.solve(run.covariances[k], error[k]) for k in chosen])


def laps(bags: Path, worlds: Sequence[str], seeds: Sequence[int]) -> Iterator[str]:
    """Tables of the drives."""
    yield (
        "| drive | odometry alone: end | corrected: end | RMSE | largest | yaw RMSE | z RMSE | "
        "accepted | NEES / 3 | poses over 3 sigma and 0.15 m |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|"
    squares: dict[str, list[np.ndarray]] = {}
    for world in worlds:
        for seed in seeds:
            events, truth, long_term = material(bags, world, seed)
            for name, params in METHODS.items():
                if name == "paper" and world != "room":
                    continue
                localizer = Localizer(params)
                localizer.set_long_term(*long_term)
                run = localized(events, localizer)
                nees = normalised(run, truth)
                if name == "default":
                    squares.setdefault(world, []).append(nees)
                label = f"`{world}` {seed}" + (f", {name}" if name != "default" else "")
                yield row(label, run, truth, nees)
    for world, drives in squares.items():
        mean, count = np.mean([nees.mean() for nees in drives]), len(drives)
        low, high = chi2.ppf([0.025, 0.975], 3 * count) / count
        yield (
            f"\nNEES of `{world}`, mean of {count} drives: {mean:.2f}; for {count} independent "
            f"errors 95 % lie within {low:.2f} .. {high:.2f}"
        )


def row(label: str, run: Run, truth: tuple[np.ndarray, se3.Matrix], nees: np.ndarray) -> str:
    error, alone = error_of(run, run.told, truth), error_of(run, run.odometry, truth)
    accepted = sum(attempt.registration.is_accepted for attempt in run.attempts)
    return (
        f"| {label} | {alone.final_position_m:.3f} m, {alone.final_yaw_deg:.2f} deg "
        f"| {error.final_position_m:.3f} m, {error.final_yaw_deg:.2f} deg "
        f"| {error.planar_rmse_m:.3f} m | {error.planar_max_m:.3f} m "
        f"| {error.yaw_rmse_deg:.2f} deg | {error.z_rmse_m:.3f} m "
        f"| {accepted} of {len(run.attempts)} | {nees.mean() / 3:.2f} "
        f"| {overconfident(run, truth)} |"
    )


def beside_peers(
    bags: Path, worlds: Sequence[str], seeds: Sequence[int], logs: Sequence[Path]
) -> Iterator[str]:
    """Others on the same drives, and on logs, which are mapped in themselves."""
    yield "\n| drive | median | 95 % | largest | yaw: 95 % |"
    yield "|---|---|---|---|---|"
    for world in worlds:
        for seed in seeds:
            events, truth, long_term = material(bags, world, seed)
            localizer = Localizer(PARAMS)
            localizer.set_long_term(*long_term)
            run = localized(events, localizer)
            told = np.clip(run.stamps, truth[0][0], truth[0][-1])
            error = trajectory_error.planar_errors(np.array(run.told), interpolate(*truth, told))
            distance, turn = error[:, 0], np.abs(error[:, 2])
            yield (
                f"| `{world}` {seed}: ours | {np.median(distance):.3f} m "
                f"| {np.percentile(distance, 95):.3f} m | {distance.max():.2f} m "
                f"| {np.percentile(turn, 95):.1f} deg |"
            )
            yield from peers(f"`{world}` {seed}", events_of(bags, world, seed, 1), events, truth)
    for path in logs:
        with Bag(path) as bag:
            events = list(bag.events(["/scan", "/odom", "/ground_truth", "/tf_static"]))
        yield from peers(f"`{path.name}`", events, events, truth_of(events))


def on_corrected_maps(bags: Path, seeds: Sequence[int]) -> Iterator[str]:
    """Long-term maps that were themselves made with corrected poses."""
    yield "\n| long-term map made with corrected poses | end | RMSE | largest | yaw RMSE |"
    yield "|---|---|---|---|---|"
    for seed in seeds:
        events, truth, first = material(bags, "room", seed)
        other = events_of(bags, "room", seed, 2)
        localizer = Localizer(PARAMS)
        localizer.set_long_term(*first)
        run = localized(other, localizer)
        poses = iter(run.told)
        corrected = [
            event._replace(message=with_pose(event.message, next(poses)))
            if event.topic == "/odom"
            else event
            for event in other
        ]
        localizer = Localizer(PARAMS)
        localizer.set_long_term(*mapped(corrected, "/odom"))
        error = error_of(again := localized(events, localizer), again.told, truth)
        yield (
            f"| `room` {seed} | {error.final_position_m:.3f} m, {error.final_yaw_deg:.2f} deg "
            f"| {error.planar_rmse_m:.3f} m | {error.planar_max_m:.3f} m "
            f"| {error.yaw_rmse_deg:.2f} deg |"
        )


def with_pose(message, T: se3.Matrix):
    """An Odometry with another pose."""
    pose = message.pose.pose
    x, y, z = T[:3, 3]
    qx, qy, qz, qw = se3.to_quaternion(T)
    return dataclasses.replace(
        message,
        pose=dataclasses.replace(
            message.pose,
            pose=dataclasses.replace(
                pose,
                position=dataclasses.replace(pose.position, x=x, y=y, z=z),
                orientation=dataclasses.replace(pose.orientation, x=qx, y=qy, z=qz, w=qw),
            ),
        ),
    )


def real_logs(paths: Sequence[Path]) -> Iterator[str]:
    """Each log on the map of all of it, and its second half on the map of the first."""
    if not paths:
        return
    yield (
        "\n| log | poses | median | 95 % | largest | yaw: median | 95 % | over 3 sigma and 0.15 m |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    notes = []
    for path in paths:
        with Bag(path) as bag:
            middle = (bag.start_ns + bag.end_ns) // 2
            events = list(bag.events(["/scan", "/odom", "/ground_truth", "/tf_static"]))
        first = [e for e in events if e.stamp_ns <= middle]
        second = [e for e in events if e.topic == "/tf_static" or e.stamp_ns > middle]
        for label, before, drive in (
            ("on the map of all of it", events, events),
            ("second half on the map of the first", first, second),
        ):
            lines, note = real_log(f"`{path.name}`, {label}", before, drive)
            yield from lines
            notes.append(note)
    yield "\n" + "\n".join(notes)


def real_log(label: str, before: Sequence[Event], drive: Sequence[Event]) -> tuple[list[str], str]:
    """Rows of the errors everywhere and where the map reaches, and what became of registrations."""
    params = with_values(Params(), {"intake.scan_topics": ["/scan"]})
    long_term = mapped([e for e in before if e.topic != "/odom"], "/ground_truth", params)
    stamps, truth = truth_of(drive)
    drive = [e for e in drive if e.topic == "/tf_static" or e.stamp_ns >= stamps[0]]
    x, y, z, _, _, yaw = se3.to_xyz_rpy(truth[0])
    localizer = Localizer(params)
    localizer.set_long_term(*long_term)
    localizer.begin_at(np.array([x, y, z, yaw]))
    run = localized(drive, localizer)
    at = np.array(run.stamps)
    # The reference is that of scans; odometry of another moment is not compared with it.
    after = np.clip(np.searchsorted(stamps, at), 1, len(stamps) - 1)
    nearest = np.minimum(np.abs(stamps[after] - at), np.abs(stamps[after - 1] - at))
    is_known = (nearest < SAME_SCAN) & (at >= stamps[0]) & (at <= stamps[-1])
    at = at[is_known]
    true = interpolate(stamps, truth, at)
    T_map_odom = run.told[0] @ se3.inverse(run.odometry[0])
    wheels = T_map_odom @ np.array(run.odometry)[is_known]
    told, covariances = np.array(run.told)[is_known], np.array(run.covariances)[is_known]
    reaches = is_on_map(long_term, drive, at, true)
    lines = [
        log_row(f"{label}: wheels alone", wheels, true),
        log_row(f"{label}: corrected", told, true, covariances),
        log_row(f"{label}: where the map reaches", told[reaches], true[reaches],
                covariances[reaches]),
    ]  # fmt: skip
    outcomes = Counter(f"{a.kind.value}: {a.registration.reason.value}" for a in run.attempts)
    counts = ", ".join(f"{name} {count}" for name, count in outcomes.most_common())
    return lines, f"{label}: {counts}; at the end {run.state.name}."


def is_on_map(
    long_term: LongTerm, drive: Sequence[Event], at: np.ndarray, true: se3.Matrix
) -> np.ndarray:
    """(N,) whether what the laser sees from true poses is on the map."""
    assert long_term[1] is not None
    walls = cKDTree(landmarks_of(long_term[0], long_term[1]).walls[:, :2])
    scans = {decode.stamp_ns(e.message.header): e.message for e in drive if e.topic == "/scan"}
    (mount,) = next(e.message.transforms for e in drive if e.topic == "/tf_static")
    x_of_laser = mount.transform.translation.x
    found = np.zeros(len(at), bool)
    for i, (stamp, T) in enumerate(zip(at, true, strict=True)):
        if int(stamp) in scans:
            scan = scans[int(stamp)]
            ranges = np.asarray(scan.ranges)
            angles = scan.angle_min + np.arange(len(ranges)) * scan.angle_increment
            seen = (
                np.isfinite(ranges) & (ranges > scan.range_min) & (ranges < PARAMS.sensor.max_range)
            )
            x, y = ranges * np.cos(angles) + x_of_laser, ranges * np.sin(angles)
            places = np.column_stack([x, y])[seen] @ T[:2, :2].T + T[:2, 3]
            found[i] = len(places) and (walls.query(places)[0] < ON_MAP[1]).mean() >= ON_MAP[0]
    return found


def log_row(label: str, poses: se3.Matrix, true: se3.Matrix, covariances=None) -> str:
    error = trajectory_error.planar_errors(poses, true)
    distance, turn = error[:, 0], np.abs(error[:, 2])
    too_sure = ""
    if covariances is not None:
        deviation = np.sqrt(np.linalg.eigvalsh(covariances[:, :2, :2])[:, -1])
        too_sure = str(int(((distance > 3 * deviation) & (distance > 0.15)).sum()))
    return (
        f"| {label} | {len(error)} | {np.median(distance):.3f} m "
        f"| {np.percentile(distance, 95):.3f} m | {distance.max():.2f} m "
        f"| {np.median(turn):.1f} deg | {np.percentile(turn, 95):.1f} deg | {too_sure} |"
    )


if __name__ == "__main__":
    with contextlib.redirect_stderr(io.StringIO()):
        main()
