# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Robots that do not know where they are: kidnapped ones, and such that begin with a wrong pose.

Two sections of measure_localization.py.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from localization_drives import PARAMS, LongTerm, material

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation import trajectory_error
from heightmap25d_ros.io.bag import Event
from heightmap25d_ros.localization.tracker import Kind
from heightmap25d_ros.localization.tracking_state import State
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.replay import feed
from heightmap25d_ros.pose_interpolation import interpolate

KIDNAPPED = 50  # of each world
UNIQUE, REPEATED = ("room", "ramp", "rough"), ("corridor", "court", "pillars", "twin_rooms")
SEARCH_WAY = 6.0  # [m] that a kidnapped robot drives at most
# How far off the pose is that a robot starts with, in a random direction [m], and its yaw [rad].
STARTS = {"1 m": (1.0, 0.0), "2 m and 0.5 rad": (2.0, 0.5), "turned round": (0.0, np.pi)}
STARTED = 4  # of each world and start
START_WAY = 20.0  # [m] that such a robot drives at most
RIGHT = 0.25, 5.0  # [m, deg] within which it is found


def random_of(world: str) -> np.random.Generator:
    """The same places in a world, whichever others are measured."""
    return np.random.default_rng([7, *world.encode()])


def kidnapped(bags: Path, worlds: Sequence[str], seeds: Sequence[int]) -> Iterator[str]:
    """Robots that wake up somewhere and search the whole map."""
    yield "\n| world | found rightly | wrongly | not | way until then | error |"
    yield "|---|---|---|---|---|---|"
    for world in worlds:
        rng = random_of(world)
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


def wrong_starts(bags: Path, worlds: Sequence[str], seeds: Sequence[int]) -> Iterator[str]:
    """Robots that begin a drive with a wrong pose, and are not told so."""
    yield "\n| world | pose at the start off by | right after | at most | never | surely wrong |"
    yield "|---|---|---|---|---|---|"
    for world in worlds:
        rng = random_of(world)
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
