# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What keeps a node from its work: found from what came, from whom, and what was dropped."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

FLAT_FROM = 20
"""Messages of odometry from which on exact zeros are no accident."""

TOLERATED = 0.2
"""Share of the scans that may lack a pose or a mount: the first ones are early."""


class Problem(Enum):
    """What can be missing; docs/troubleshooting.md has a section on each, by these words."""

    CLOCK = "the clock does not run"
    NO_PUBLISHER = "nobody publishes"
    INCOMPATIBLE = "incompatible publisher"
    SILENT = "nothing comes"
    NO_ODOMETRY = "no odometry around the scans"
    UNKNOWN_MOUNT = "unknown mount"
    FLAT = "the odometry is flat"


@dataclass(frozen=True, slots=True, kw_only=True)
class Input:
    """A subscribed topic.

    Attributes
    ----------
    topic : str
    publishers : int
    incompatible : tuple of str
        Publishers that cannot reach the node, each with the reason.
    received : int
        Messages since the activation.
    is_needed : bool
        Whether the node is of no use without it.
    """

    topic: str
    publishers: int
    incompatible: tuple[str, ...]
    received: int
    is_needed: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Observed:
    """What a node has seen since its activation.

    Attributes
    ----------
    inputs : tuple of Input
    scans : int
        How many came.
    dropped : mapping of str to int
        How many messages were not used, by reason, as `intake.ScanIntake` words them.
    clock_ns : tuple of int [ns], optional
        The node's clock a second ago and now; None where it is not /clock.
    flat_poses : int
        Messages of odometry if z, roll and pitch were exactly 0 in all of them, else 0.
    """

    inputs: tuple[Input, ...]
    scans: int
    dropped: Mapping[str, int]
    clock_ns: tuple[int, int] | None
    flat_poses: int


@dataclass(frozen=True, slots=True)
class Finding:
    """A problem and its circumstances."""

    problem: Problem
    detail: str

    def __str__(self) -> str:
        return f"{self.problem.value}: {self.detail}"


def findings(observed: Observed) -> list[Finding]:
    """The problems of a node, the likelier cause of the others first."""
    found: list[Finding] = []
    if observed.clock_ns is not None and observed.clock_ns[0] == observed.clock_ns[1]:
        seconds = observed.clock_ns[1] * 1e-9
        found.append(
            Finding(Problem.CLOCK, f"use_sim_time is set, and /clock stands at {seconds:g}")
        )
    for entry in observed.inputs:
        found += _of_input(entry)
    for problem, words in (
        (Problem.NO_ODOMETRY, "the odometry"),
        (Problem.UNKNOWN_MOUNT, "its mount"),
    ):
        reasons = {r: count for r, count in observed.dropped.items() if _is_without(r, words)}
        if sum(reasons.values()) > TOLERATED * observed.scans:
            found.append(Finding(problem, ", ".join(f"{r} ({n})" for r, n in reasons.items())))
    if observed.flat_poses >= FLAT_FROM:
        told = f"z, roll and pitch were exactly 0 in all of {observed.flat_poses} messages"
        found.append(Finding(Problem.FLAT, told))
    return found


def _of_input(entry: Input) -> Iterator[Finding]:
    for reason in entry.incompatible:
        yield Finding(Problem.INCOMPATIBLE, f"{entry.topic}: {reason}")
    if entry.received or not entry.is_needed:
        return
    if not entry.publishers:
        yield Finding(Problem.NO_PUBLISHER, entry.topic)
    elif len(entry.incompatible) < entry.publishers:
        yield Finding(Problem.SILENT, entry.topic)


def _is_without(reason: str, words: str) -> bool:
    """Whether a reason of `intake.ScanIntake` says that a scan had no such pose."""
    return reason.startswith("scan: ") and words in reason


class Flatness:
    """Counts messages of odometry for as long as all of them lie exactly in the plane."""

    def __init__(self) -> None:
        self.poses = 0
        self._is_flat = True

    def observe(self, message: Any) -> None:
        """Look at a nav_msgs/Odometry."""
        if not self._is_flat:
            return
        position, turn = message.pose.pose.position, message.pose.pose.orientation
        self._is_flat = position.z == turn.x == turn.y == 0.0
        self.poses = self.poses + 1 if self._is_flat else 0
