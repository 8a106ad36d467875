# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The table of degradation in docs/reliability.md: disturbed messages against map and pose.

Usage: python studies/measure_degradation.py [--bags DIR] [--seed N] [--only WORD ...]

Mapped is `ramp_1` with true poses, which are disturbed; localized is `room_1` with its odometry, in
the map of another drive through the same room. A pose is *confidently wrong* where it is off by
more than 0.15 m and by more than three of its own standard deviations while the state is TRACKING.
"""

from __future__ import annotations

import argparse
import dataclasses
import logging
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from disturbances import DISTURBANCES, ODOM, Disturbance, Drive, Event
from measure_localization import PARAMS, LongTerm, events_of, mapped

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation.goal_reachability import evaluate_goals
from heightmap25d_ros.evaluation.map_error import evaluate_map
from heightmap25d_ros.evaluation.truth import read_goals, read_truth
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.localization.tracking_state import State
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import feed
from heightmap25d_ros.pipelines.self_check import Problem
from heightmap25d_ros.pose_interpolation import interpolate

BAGS = Path(__file__).parent.parent / "bags"
TRUE_POSES = "/ground_truth"
WRONG, SIGMAS = 0.15, 3.0  # [m], and deviations
USUAL = 3  # reasons of a row at most
HEAD = """\
| disturbance | F1 | goals | pose while TRACKING: RMSE [m] | largest [m] | DEGRADED, LOST [s] | \
confidently wrong [s] | what mapping counted, or told |
|---|---|---|---|---|---|---|---|"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MapOutcome:
    """A disturbed drive, mapped."""

    f1: float
    goals: int
    mapping: Mapping


@dataclasses.dataclass(frozen=True, kw_only=True)
class PoseOutcome:
    """A disturbed drive, localized.

    Attributes
    ----------
    rmse, largest : float [m]
        Of the published poses while the state is TRACKING.
    confidently_wrong : float [s]
    seconds : Counter of State
    """

    rmse: float
    largest: float
    confidently_wrong: float
    seconds: Counter[State]
    localizer: Localizer


def read_drive(path: Path, odom_topic: str) -> list[Event]:
    """The events of a bag, with the poses of a topic as /odom."""
    with Bag(path) as bag:
        events = bag.events([*bag.scan_topics(), odom_topic, "/tf_static"])
        names = {odom_topic: ODOM}
        return [Event(names.get(e.topic, e.topic), e.message, *[e.stamp_ns] * 2) for e in events]


def read_truth_poses(path: Path) -> tuple[np.ndarray, se3.Matrix]:
    """Stamps (N,) [ns] and true poses (N, 4, 4) of a bag."""
    with Bag(path) as bag:
        poses = [decode.odometry(event.message) for event in bag.events([TRUE_POSES])]
    return np.array([p.stamp_ns for p in poses]), np.array([p.T for p in poses])


def disturbed(events: Sequence[Event], disturb: Disturbance, seed: int) -> list[Event]:
    """The events as they arrive."""
    moving = [event.recorded_ns for event in events if event.topic == ODOM]
    return disturb(Drive(events, moving[0], moving[-1], np.random.default_rng(seed)))


def map_disturbed(path: Path, disturb: Disturbance, seed: int) -> MapOutcome:
    """Map a bag with true poses, which are disturbed, as its scans are."""
    mapping = Mapping(PARAMS)
    for event in disturbed(read_drive(path, TRUE_POSES), disturb, seed):
        feed(mapping, event.topic, event.message)
    mapping.flush()
    height_map, obstacle_map = mapping.maps()
    error = evaluate_map(height_map, PARAMS.traversability, read_truth(path / "truth/surface.npz"))
    goals = evaluate_goals(obstacle_map, read_goals(path / "truth/goals.npz"))
    return MapOutcome(f1=error.blocked_transitions.f1, goals=goals.found, mapping=mapping)


def localize_disturbed(
    path: Path, long_term: LongTerm, disturb: Disturbance, seed: int
) -> PoseOutcome:
    """Localize a drive, whose messages are disturbed."""
    localizer = Localizer(PARAMS)
    localizer.set_long_term(*long_term)
    true_stamps, true_poses = read_truth_poses(path)
    recorded_ns: dict[int, int] = {}
    seconds: Counter[State] = Counter()
    told: list[Told] = []
    now_ns = None
    for event in disturbed(read_drive(path, ODOM), disturb, seed):
        seconds[localizer.state] += max(event.arrives_ns - (now_ns or event.arrives_ns), 0) * 1e-9
        now_ns = event.arrives_ns
        if event.topic == ODOM:
            stamp = event.message.header.stamp
            recorded_ns[stamp.sec * 10**9 + stamp.nanosec] = event.recorded_ns
        before = localizer.pose
        feed(localizer, event.topic, event.message)
        localizer.pass_time(event.arrives_ns)
        pose = localizer.pose
        if pose is not None and (before is None or pose.stamp_ns != before.stamp_ns):
            T = pose.T_map_base
            told.append(Told(recorded_ns[pose.stamp_ns], T, pose.covariance, localizer.state))
    stamps = np.clip([t.recorded_ns for t in told], true_stamps[0], true_stamps[-1])
    return _judged(told, interpolate(true_stamps, true_poses, stamps), seconds, localizer)


class Told(NamedTuple):
    """A pose as it was published, and the time at which it should be right [ns]."""

    recorded_ns: int
    T_map_base: se3.Matrix
    covariance: np.ndarray
    state: State


def _judged(
    told: Sequence[Told], truth: se3.Matrix, seconds: Counter[State], localizer: Localizer
) -> PoseOutcome:
    errors = (np.array([t.T_map_base for t in told]) - truth)[:, :2, 3]
    planar = np.array([t.covariance[:2, :2] for t in told])
    squared = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(planar), errors)
    off = np.linalg.norm(errors, axis=1)
    is_sure = np.array([t.state is State.TRACKING for t in told])
    is_wrong = is_sure & (off > WRONG) & (squared > SIGMAS**2)
    lasting = np.clip(np.diff([t.recorded_ns for t in told], append=told[-1].recorded_ns), 0, 10**9)
    sure = off[is_sure] if is_sure.any() else np.array([np.nan])
    return PoseOutcome(
        rmse=float(np.sqrt(np.mean(sure**2))),
        largest=float(sure.max()),
        confidently_wrong=float(lasting[is_wrong].sum() * 1e-9),
        seconds=seconds,
        localizer=localizer,
    )


def row(name: str, mapped: MapOutcome, located: PoseOutcome) -> str:
    """A row of the table."""
    seconds = located.seconds
    reasons = [
        f"{reason} ({count})" for reason, count in mapped.mapping.dropped.most_common()
        if not reason.startswith("return: ")
    ]  # fmt: skip
    told = [f.detail for f in mapped.mapping.problems() if f.problem is Problem.MOUNT]
    return (
        f"| {name} | {mapped.f1:.3f} | {mapped.goals} | {located.rmse:.3f} | {located.largest:.2f} "
        f"| {seconds[State.DEGRADED]:.1f}, {seconds[State.LOST]:.1f} "
        f"| {located.confidently_wrong:.2f} | {'; '.join([*reasons[:USUAL], *told])} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bags", type=Path, metavar="DIR", help="where recordings are, or go to")
    parser.add_argument("--seed", type=int, default=1, help="of what is disturbed at random")
    parser.add_argument("--only", nargs="+", default=[""], metavar="WORD", help="in a row's name")
    options = parser.parse_args()
    logging.disable()
    with tempfile.TemporaryDirectory() as scratch:
        other_drive = events_of(options.bags or Path(scratch), "room", 1, 1)
    long_term = mapped(other_drive, TRUE_POSES)
    print(HEAD)
    for name, disturb in DISTURBANCES.items():
        if any(word in name for word in options.only):
            on_map = map_disturbed(BAGS / "ramp_1", disturb, options.seed)
            located = localize_disturbed(BAGS / "room_1", long_term, disturb, options.seed)
            print(row(name, on_map, located), flush=True)


if __name__ == "__main__":
    main()
