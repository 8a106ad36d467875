# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/localization.md: laps, corrected and not; kidnapped robots; real data.

Usage: python studies/measure_localization.py [--bags DIR] [--logs BAG ...] [--only SECTION ...]

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
from scipy.spatial import cKDTree
from scipy.stats import chi2

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation import trajectory_error
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.bag import Bag, Event
from heightmap25d_ros.localization.landmarks import landmarks_of
from heightmap25d_ros.localization.layers import LayerMap
from heightmap25d_ros.localization.tracker import Attempt, Kind
from heightmap25d_ros.localization.tracking_state import State
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import feed
from heightmap25d_ros.pose_interpolation import interpolate
from heightmap25d_ros.simulation import recording

WORLDS = ("room", "ramp", "rough", "street")
SEEDS = (1, 2, 3, 4)
SCANS = ("/scan", "/scan_down")
PARAMS = with_values(Params(), {"intake.scan_topics": list(SCANS)})
SHORT_TERM = with_values(PARAMS, {"scan_filter.enabled": False})
PAPER = with_values(PARAMS, {"registration.method": "paper"})
METHODS = {"default": PARAMS, "short-term maps": SHORT_TERM, "paper": PAPER}
KIDNAPPED = 50  # of each world
UNIQUE, REPEATED = ("room", "ramp", "rough"), ("corridor", "court", "pillars", "twin_rooms")
SEARCH_WAY = 6.0  # [m] that a kidnapped robot drives at most
# How far off the pose is that a robot starts with, in a random direction [m], and its yaw [rad].
STARTS = {"1 m": (1.0, 0.0), "2 m and 0.5 rad": (2.0, 0.5), "turned round": (0.0, np.pi)}
STARTED = 4  # of each world and start
START_WAY = 20.0  # [m] that such a robot drives at most
RIGHT = 0.25, 5.0  # [m, deg] within which it is found
ON_MAP = 0.5, 0.2  # share of the returns within so many metres of a wall of the map
SAME_SCAN = 2e7  # [ns] between a pose of the reference and one of the odometry


@dataclasses.dataclass
class Run:
    """A drive that was localized."""

    stamps: list[int]
    told: list[se3.Matrix]
    odometry: list[se3.Matrix]
    covariances: list[np.ndarray]
    attempts: list[Attempt]
    state: State


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bags", type=Path, metavar="DIR", help="where recordings are, or go to")
    parser.add_argument("--logs", nargs="+", type=Path, metavar="BAG", default=(), help="real ones")
    sections = ("laps", "corrected", "kidnapped", "starts", "logs")
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS, help="of the laps")
    parser.add_argument(
        "--kidnapped-seeds", nargs="+", type=int, default=(1, 2), metavar="SEED",
        help="of the worlds of kidnapped robots, and of wrong starts",
    )  # fmt: skip
    parser.add_argument("--only", nargs="+", choices=sections, default=sections)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        bags = options.bags or Path(scratch)
        if "laps" in options.only:
            for line in laps(bags, options.seeds):
                print(line, flush=True)
        if "corrected" in options.only:
            print("\n".join(on_corrected_maps(bags)), flush=True)
        if "kidnapped" in options.only:
            for line in kidnapped(bags, options.kidnapped_seeds):
                print(line, flush=True)
        if "starts" in options.only:
            for line in wrong_starts(bags, options.kidnapped_seeds):
                print(line, flush=True)
        if "logs" in options.only and options.logs:
            for line in real_logs(options.logs):
                print(line, flush=True)


def events_of(bags: Path, world: str, seed: int, drive: int) -> list[Event]:
    path = bags / f"{world}_{seed}_{drive}"
    if not path.exists():
        recording.simulate(world, seed, path, drive=drive)
    with Bag(path) as bag:
        return list(bag.events([*SCANS, "/odom", "/ground_truth", "/tf_static"]))


LongTerm = tuple[HeightMap, LayerMap | None]


def mapped(events: Sequence[Event], odom_topic: str, params: Params = PARAMS) -> LongTerm:
    """A map with the poses of a topic, and its localization layers."""
    mapping = Mapping(params)
    for event in events:
        feed(mapping, event.topic, event.message, odom_topic)
    mapping.flush()
    height_map = mapping.maps()[0]
    return height_map, mapping.layers(height_map.geometry)


def localized(events: Sequence[Event], localizer: Localizer) -> Run:
    run = Run([], [], [], [], [], State.DEGRADED)
    for event in events:
        run.attempts += feed(localizer, event.topic, event.message)
        if event.topic == "/odom":
            pose = localizer.pose
            assert pose is not None
            run.stamps.append(pose.stamp_ns)
            run.told.append(pose.T_map_base)
            run.odometry.append(se3.inverse(pose.T_map_odom) @ pose.T_map_base)
            run.covariances.append(pose.covariance)
    run.state = localizer.state
    return run


def truth_of(events: Sequence[Event]) -> tuple[np.ndarray, se3.Matrix]:
    poses = [decode.odometry(e.message) for e in events if e.topic == "/ground_truth"]
    return np.array([p.stamp_ns for p in poses]), np.array([p.T for p in poses])


def error_of(run: Run, poses: Sequence[se3.Matrix], truth: tuple[np.ndarray, se3.Matrix]):
    return trajectory_error.evaluate_trajectory(np.array(run.stamps), np.array(poses), *truth)


def normalised(run: Run, truth: tuple[np.ndarray, se3.Matrix]) -> np.ndarray:
    """Squared errors of x, y, yaw over their covariance, one a second once it tracks."""
    stamps = np.array(run.stamps)
    true = interpolate(*truth, np.clip(stamps, truth[0][0], truth[0][-1]))
    error = se3.to_xyz_rpy(np.array(run.told)) - se3.to_xyz_rpy(true)
    error = error[:, [0, 1, 5]]
    error[:, 2] = np.angle(np.exp(1j * error[:, 2]))
    chosen = np.arange(100, len(stamps), 50)
    return np.array([error[k] @ np.linalg.solve(run.covariances[k], error[k]) for k in chosen])


def laps(bags: Path, seeds: Sequence[int]) -> Iterator[str]:
    """Tables of the drives."""
    yield (
        "| drive | odometry alone: end | corrected: end | RMSE | largest | yaw RMSE | z RMSE | "
        "accepted | NEES / 3 | poses over 3 sigma and 0.15 m |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|"
    squares: dict[str, list[np.ndarray]] = {}
    for world in WORLDS:
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


def material(bags: Path, world: str, seed: int):
    """Events and truth of drive 0, and the long-term map of drive 1."""
    long_term = mapped(events_of(bags, world, seed, 1), "/ground_truth")
    events = events_of(bags, world, seed, 0)
    return events, truth_of(events), long_term


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


def overconfident(run: Run, truth: tuple[np.ndarray, se3.Matrix]) -> int:
    """How many poses are off by more than 0.15 m and by more than three of their deviations."""
    stamps = np.clip(np.array(run.stamps), truth[0][0], truth[0][-1])
    error = (np.array(run.told) - interpolate(*truth, stamps))[:, :2, 3]
    planar = np.array(run.covariances)[:, :2, :2]
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(planar), error)
    return int(((squared > 9.0) & (np.linalg.norm(error, axis=1) > 0.15)).sum())


def on_corrected_maps(bags: Path) -> Iterator[str]:
    """Long-term maps that were themselves made with corrected poses."""
    yield "\n| long-term map made with corrected poses | end | RMSE | largest | yaw RMSE |"
    yield "|---|---|---|---|---|"
    for seed in SEEDS:
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


def kidnapped(bags: Path, seeds: Sequence[int]) -> Iterator[str]:
    """Robots that wake up somewhere and search the whole map."""
    yield "\n| world | found rightly | wrongly | not | way until then | error |"
    yield "|---|---|---|---|---|---|"
    rng = np.random.default_rng(7)
    for world in (*UNIQUE, *REPEATED):
        outcomes: Counter[str] = Counter()
        ways, errors = [], []
        for seed in seeds:
            events, truth, long_term = material(bags, world, seed)
            for _ in range(KIDNAPPED // len(seeds)):
                outcome, way, error = kidnap(events, truth, long_term, rng)
                outcomes[outcome] += 1
                if outcome == "right":
                    ways.append(way)
                    errors.append(error)
        found = (
            f"{np.mean(ways):.1f} m, at most {max(ways):.1f} m "
            f"| median {np.median(errors):.3f} m, at most {max(errors):.3f} m"
            if ways
            else "|"
        )
        yield (
            f"| `{world}` | {outcomes['right']} of {outcomes.total()} | {outcomes['wrong']} "
            f"| {outcomes['not']} | {found} |"
        )


def kidnap(
    events: Sequence[Event],
    truth: tuple[np.ndarray, se3.Matrix],
    long_term: LongTerm,
    rng: np.random.Generator,
) -> tuple[str, float, float]:
    """Wake up at a random time of a drive, believing to be somewhere else."""
    localizer = Localizer(PARAMS)
    localizer.set_long_term(*long_term)
    localizer.begin_at(rng.uniform((-5, -5, -0.5, -np.pi), (5, 5, 0.5, np.pi)))
    localizer.request_search()
    last = events[-1].stamp_ns
    begin = rng.uniform(events[0].stamp_ns, last - 8e9)
    way, before = 0.0, None
    for event in events:
        if event.topic != "/tf_static" and event.stamp_ns < begin:
            continue
        attempts = feed(localizer, event.topic, event.message)
        if event.topic == "/odom":
            p = event.message.pose.pose.position
            here = np.array([p.x, p.y])
            way += 0.0 if before is None else float(np.linalg.norm(here - before))
            before = here
        # What it believed at first may track for a moment; a search must have ended.
        if (
            attempts
            and attempts[-1].kind is Kind.CONFIRMATION
            and localizer.state is State.TRACKING
        ):
            stamp = np.clip(attempts[-1].stamp_ns, truth[0][0], truth[0][-1])
            true = interpolate(*truth, [stamp])
            distance, _, yaw = trajectory_error.planar_errors(attempts[-1].T_map_base[None], true)[
                0
            ]
            is_right = distance < RIGHT[0] and abs(yaw) < RIGHT[1]
            return ("right" if is_right else "wrong"), way, float(distance)
        if way > SEARCH_WAY:
            break
    return "not", way, 0.0


def wrong_starts(bags: Path, seeds: Sequence[int]) -> Iterator[str]:
    """Robots that begin a drive with a wrong pose, and are not told so."""
    yield "\n| world | pose at the start off by | right after | at most | never | surely wrong |"
    yield "|---|---|---|---|---|---|"
    rng = np.random.default_rng(7)
    for world in WORLDS:
        drives = [material(bags, world, seed) for seed in seeds]
        for label, off in STARTS.items():
            found = [
                wrong_start(*drive, off, rng)
                for drive in drives
                for _ in range(STARTED // len(seeds))
            ]
            ways = [way for way, _ in found if way is not None]
            after = f"{np.median(ways):.1f} m | {max(ways):.1f} m" if ways else "|"
            yield (
                f"| `{world}` | {label} | {after} | {len(found) - len(ways)} of {len(found)} "
                f"| {sum(seconds for _, seconds in found):.1f} s |"
            )


def wrong_start(
    events: Sequence[Event],
    truth: tuple[np.ndarray, se3.Matrix],
    long_term: LongTerm,
    off: tuple[float, float],
    rng: np.random.Generator,
) -> tuple[float | None, float]:
    """The way [m] after which the pose is right and stays so, and the time [s] it was surely wrong.

    Surely: told as TRACKING, and wrong by more than 3 standard deviations and 0.15 m.
    """
    first, last = events[0].stamp_ns, events[-1].stamp_ns
    begin = rng.uniform(first + 1e9, 0.5 * (first + last))
    drive = [e for e in events if e.topic == "/tf_static" or e.stamp_ns >= begin]
    direction = rng.uniform(-np.pi, np.pi)
    x, y, z, _, _, yaw = se3.to_xyz_rpy(interpolate(*truth, [int(begin)])[0])
    x, y = x + off[0] * np.cos(direction), y + off[0] * np.sin(direction)
    localizer = Localizer(PARAMS)
    localizer.set_long_term(*long_term)
    localizer.begin_at(np.array([x, y, z, yaw + off[1]]))
    way, right_since, surely_wrong, before = 0.0, None, 0.0, None
    for event in drive:
        feed(localizer, event.topic, event.message)
        pose = localizer.pose
        if (
            event.topic != "/odom"
            or pose is None
            or not truth[0][0] <= pose.stamp_ns <= truth[0][-1]
        ):
            continue
        odometry = (se3.inverse(pose.T_map_odom) @ pose.T_map_base)[:2, 3]
        if before is not None:
            way += float(np.linalg.norm(odometry - before[0]))
        true = interpolate(*truth, [pose.stamp_ns])
        distance, _, turn = trajectory_error.planar_errors(pose.T_map_base[None], true)[0]
        is_right = distance < RIGHT[0] and abs(turn) < RIGHT[1]
        right_since = (way if right_since is None else right_since) if is_right else None
        deviation = np.sqrt(np.linalg.eigvalsh(pose.covariance[:2, :2])[-1])
        is_sure = localizer.state is State.TRACKING
        if before is not None and is_sure and distance > max(3.0 * deviation, 0.15):
            surely_wrong += 1e-9 * (pose.stamp_ns - before[1])
        before = odometry, pose.stamp_ns
        if way > START_WAY:
            break
    return right_since, surely_wrong


def real_logs(paths: Sequence[Path]) -> Iterator[str]:
    """Each log on the map of all of it, and its second half on the map of the first."""
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
