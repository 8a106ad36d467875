# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What keeps a pipeline from its work: found from what came, from whom, and what was dropped.

A node looks at the last seconds again and again (`recent`, `Watch`), a command at the whole bag.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

from heightmap25d_ros.pipelines import odometry_gate
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.input_watch import (
    AT_MAX,
    BELOW,
    BEYOND,
    LOST,
    REPEATED,
    RETURNS,
    InputWatch,
)

FLAT_FROM = 20
"""Messages of odometry from which on exact zeros are no accident."""

TOLERATED = 0.2
"""Share of the scans that may lack a pose or a mount: the first ones are early."""


NEARLY_ALL = 0.9
"""Share of the returns out of range from which on the ranges or their limits are wrong."""

AT_RANGE_MAX = 0.01
"""Share of the returns at exactly range_max from which on they are no returns."""

LEAST_USED = 0.5
"""Share of the scans that must be used: some wait for their poses."""

LOST_FROM, SOME_LOST = 0.02, 10
"""Share of the scans that may get lost, and how many: a driver may stumble."""

ENOUGH = 20
"""Scans or returns from which on shares are judged."""

_SOURCES = ("scan: ", "cloud: ")  # with which reasons of what was not used begin
_REFUSED = tuple(f"{source}bad " for source in _SOURCES)

PATIENCE = 5
"""Checks in a row without a problem after which it is over."""


class Problem(Enum):
    """What can be missing; docs/troubleshooting.md has a section on each, by these words."""

    CLOCK = "the clock does not run"
    NO_PUBLISHER = "nobody publishes"
    INCOMPATIBLE = "incompatible publisher"
    SILENT = "nothing comes"
    NO_ODOMETRY = "no odometry around the scans"
    UNKNOWN_MOUNT = "unknown mount"
    FLAT = "the odometry is flat"
    JUMPS = "the odometry jumps"
    REFUSED = "scans are refused"
    OUT_OF_RANGE = "returns out of range"
    AT_MAX = "returns at exactly range_max"
    MOUNT = "a mount is off"
    SWEEP = "scans last too long"
    OFFSET = "stamps do not go together"
    STUCK = "scans repeat"
    LOST = "scans get lost"
    UNUSED = "few scans are used"


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
    is_latched : bool
        Whether one message is enough for ever.
    """

    topic: str
    publishers: int
    incompatible: tuple[str, ...]
    received: int
    is_needed: bool
    is_latched: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Observed:
    """What was seen, since the activation or in the last seconds.

    Attributes
    ----------
    inputs : tuple of Input
    scans : int
        How many came.
    dropped : mapping of str to int
        How many messages were not used, by reason, as the pipelines word them.
    clock_ns : tuple of int [ns], optional
        The node's clock a second ago and now; None where it is not /clock.
    flat_poses : int
        Messages of odometry if z, roll and pitch were exactly 0 in all of them, else 0.
    used : int, optional
        How many scans were used; None where the node uses none.
    ranges : mapping of str to int
        How many returns lie where, and scans that are repeated or lost, as `InputWatch` counts
        them.
    examples : mapping of str to str
        Numbers to these, and to the reasons.
    sweep, offset, mount : str
        What is wrong with the times of scans, and with mounts; empty where nothing is.
    """

    inputs: tuple[Input, ...] = ()
    scans: int
    dropped: Mapping[str, int]
    clock_ns: tuple[int, int] | None = None
    flat_poses: int
    used: int | None = None
    ranges: Mapping[str, int] = field(default_factory=dict)
    examples: Mapping[str, str] = field(default_factory=dict)
    sweep: str = ""
    offset: str = ""
    mount: str = ""


def with_watch(observed: Observed, watch: InputWatch, dropped: Drops) -> Observed:
    """The same, with what a pipeline noticed about its scans."""
    places = (BEYOND, BELOW, AT_MAX, REPEATED, LOST)
    examples = dropped.examples | {place: watch.example(place) for place in places}
    return replace(
        observed,
        used=watch.used,
        ranges=watch.counts.copy(),
        examples=examples,
        sweep=watch.sweep_fault(),
        offset=watch.offset_fault(),
        mount=watch.mounts.fault(),
    )


def findings_of_drive(watch: InputWatch, dropped: Drops) -> list[Finding]:
    """What was wrong with the messages of a whole drive, in the words of the self-check."""
    refused = sum(n for reason, n in dropped.items() if reason.startswith(_REFUSED))
    observed = Observed(
        scans=watch.scans + refused, dropped=Counter(dropped), flat_poses=watch.flatness.poses
    )
    return findings(with_watch(observed, watch, dropped))


def recent(now: Observed, before: Observed) -> Observed:
    """What was seen in between; inputs that are the same, and a state that holds, stay."""
    received = {entry.topic: entry.received for entry in before.inputs}
    return replace(
        now,
        inputs=tuple(
            entry
            if entry.is_latched
            else replace(entry, received=entry.received - received.get(entry.topic, 0))
            for entry in now.inputs
        ),
        scans=now.scans - before.scans,
        dropped=Counter(now.dropped) - Counter(before.dropped),
        used=None if now.used is None else now.used - (before.used or 0),
        ranges=Counter(now.ranges) - Counter(before.ranges),
    )


@dataclass(frozen=True, slots=True)
class Finding:
    """A problem and its circumstances; of one topic, where there are several."""

    problem: Problem
    detail: str
    topic: str = ""

    def __str__(self) -> str:
        return f"{self.problem.value}: {self.detail}"


class Watch:
    """Which problems begin, and which are over, from one check to the next."""

    def __init__(self) -> None:
        self._present: dict[tuple[Problem, str], tuple[Finding, int]] = {}

    def update(self, found: list[Finding]) -> tuple[list[Finding], list[Finding]]:
        """The findings that were none before, and those that have not been for a while."""
        begun: list[Finding] = []
        unseen = {key: (old, count + 1) for key, (old, count) in self._present.items()}
        for finding in found:
            key = finding.problem, finding.topic
            if key not in unseen:
                begun.append(finding)
            unseen[key] = finding, 0
        over = [finding for finding, count in unseen.values() if count >= PATIENCE]
        self._present = {k: entry for k, entry in unseen.items() if entry[1] < PATIENCE}
        return begun, over


def findings(observed: Observed) -> list[Finding]:
    """The problems of a node, the likelier cause of the others first."""
    found: list[Finding] = []
    if observed.clock_ns is not None and observed.clock_ns[0] == observed.clock_ns[1]:
        seconds = observed.clock_ns[1] * 1e-9
        found.append(
            Finding(Problem.CLOCK, f"use_sim_time is set, and /clock stands at {seconds:.12g} s")
        )
    for entry in observed.inputs:
        found += _of_input(entry)
    scans = list(_of_scans(observed))
    found += scans
    is_unused = observed.used is not None and observed.used < LEAST_USED * observed.scans
    if is_unused and observed.scans >= ENOUGH and not scans:
        found.append(Finding(Problem.UNUSED, f"{observed.used} of {observed.scans}"))
    found += _of_ranges(observed)
    if observed.ranges.get(REPEATED):
        told = f"while the robot moved; {observed.examples.get(REPEATED, '')}"
        found.append(Finding(Problem.STUCK, told))
    jumps = {reason: observed.dropped.get(reason, 0) for reason in odometry_gate.JUMPS}
    if any(jumps.values()):
        found.append(Finding(Problem.JUMPS, _counted(jumps, observed.examples)))
    if observed.flat_poses >= FLAT_FROM:
        told = f"z, roll and pitch were exactly 0 in all of {observed.flat_poses} messages"
        found.append(Finding(Problem.FLAT, told))
    return found


def _of_scans(observed: Observed) -> Iterator[Finding]:
    """Times and mounts of scans, and scans that were not used."""
    if observed.sweep:
        yield Finding(Problem.SWEEP, observed.sweep)
    if observed.offset:
        yield Finding(Problem.OFFSET, observed.offset)
    if observed.mount:
        yield Finding(Problem.MOUNT, observed.mount)
    lost = observed.ranges.get(LOST, 0)
    if lost > max(LOST_FROM * observed.scans, SOME_LOST):
        yield Finding(
            Problem.LOST,
            f"{lost} did not come, by the stamps of others, {observed.examples.get(LOST, '')}",
        )
    for problem, words in (
        (Problem.NO_ODOMETRY, "the odometry"),
        (Problem.UNKNOWN_MOUNT, "its mount"),
        (Problem.REFUSED, "bad "),
    ):
        reasons = {r: count for r, count in observed.dropped.items() if _is_without(r, words)}
        if sum(reasons.values()) > TOLERATED * observed.scans:
            yield Finding(problem, _counted(reasons, observed.examples))


def _of_ranges(observed: Observed) -> Iterator[Finding]:
    returns = observed.ranges.get(RETURNS, 0)
    if returns < ENOUGH:
        return
    shares = {place: observed.ranges.get(place, 0) / returns for place in (BEYOND, BELOW, AT_MAX)}
    if shares[BEYOND] + shares[BELOW] >= NEARLY_ALL:
        place = BEYOND if shares[BEYOND] >= shares[BELOW] else BELOW
        yield Finding(
            Problem.OUT_OF_RANGE,
            f"{shares[place]:.0%} of {returns} are {place}, {observed.examples.get(place, '')}",
        )
    if shares[AT_MAX] >= AT_RANGE_MAX:
        yield Finding(
            Problem.AT_MAX,
            f"{shares[AT_MAX]:.0%} of {returns} are no objects; set sensor.no_return: range_max",
        )


def _counted(reasons: Mapping[str, int], examples: Mapping[str, str]) -> str:
    """Reasons with their counts and newest examples."""
    told = []
    for reason, count in reasons.items():
        example = examples.get(reason)
        if count:
            told.append(f"{reason} ({count}{f', the last one: {example}' if example else ''})")
    return ", ".join(told)


def _of_input(entry: Input) -> Iterator[Finding]:
    for reason in entry.incompatible:
        yield Finding(Problem.INCOMPATIBLE, f"{entry.topic}: {reason}", entry.topic)
    if entry.received or not entry.is_needed:
        return
    if not entry.publishers:
        yield Finding(Problem.NO_PUBLISHER, entry.topic, entry.topic)
    elif len(entry.incompatible) < entry.publishers:
        yield Finding(Problem.SILENT, entry.topic, entry.topic)


def _is_without(reason: str, words: str) -> bool:
    """Whether a reason of `ScanQueue` says so of a scan or a cloud."""
    return reason.startswith(_SOURCES) and words in reason
