# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What keeps a node from its work, found from plain values."""

from __future__ import annotations

import math
from collections import Counter

import pytest
from bag_writer import laser_scan, odometry
from repository import ROOT

from heightmap25d_ros.nodes.self_check import (
    FLAT_FROM,
    Flatness,
    Input,
    Observed,
    Problem,
    findings,
)
from heightmap25d_ros.params.sections import IntakeParams, Params
from heightmap25d_ros.pipelines.mapping import Mapping

MS = 10**6
TROUBLESHOOTING = ROOT / "docs" / "troubleshooting.md"


def received(topic="/scan", publishers=1, incompatible=(), received=10, is_needed=True):
    return Input(
        topic=topic,
        publishers=publishers,
        incompatible=incompatible,
        received=received,
        is_needed=is_needed,
    )


def problems(*inputs, scans=100, dropped=None, clock_ns=None, flat_poses=0):
    observed = Observed(
        inputs=inputs, scans=scans, dropped=dropped or {}, clock_ns=clock_ns, flat_poses=flat_poses
    )
    return [(finding.problem, finding.detail) for finding in findings(observed)]


def test_nothing_is_missing_where_all_comes():
    assert problems(received(), received("/odom"), clock_ns=(5, 6), flat_poses=FLAT_FROM - 1) == []


@pytest.mark.parametrize(
    ("lacking", "problem", "detail"),
    [
        (received(publishers=0, received=0), Problem.NO_PUBLISHER, "/scan"),
        (received(received=0), Problem.SILENT, "/scan"),
        (
            received(incompatible=("/driver: best effort",), received=0),
            Problem.INCOMPATIBLE,
            "/scan: /driver: best effort",
        ),
    ],
)
def test_a_topic_that_brings_nothing_is_named_with_its_cause_only(lacking, problem, detail):
    assert problems(lacking, received("/odom")) == [(problem, detail)]


def test_topics_that_need_not_be_there_are_told_only_where_somebody_publishes_in_vain():
    optional = {"topic": "/pose_correction", "received": 0, "is_needed": False}
    assert problems(received(publishers=0, **optional), received(**optional)) == []
    assert [problem for problem, _ in problems(received(incompatible=("/a: no",), **optional))] == [
        Problem.INCOMPATIBLE
    ]


def test_a_clock_that_stands_is_told_and_one_that_is_not_used_is_not():
    assert problems(clock_ns=(0, 0))[0][0] is Problem.CLOCK
    assert problems(clock_ns=(7 * 10**9, 7 * 10**9))[0][1].endswith("/clock stands at 7")
    assert problems(clock_ns=None) == []


def dropped_by_mapping(*, with_odometry, with_mount):
    """Reasons as the intake words them, after two seconds of scans."""
    mounts = (0.0,) * 6 if with_mount else ()
    mapping = Mapping(Params(intake=IntakeParams(mounts=mounts)))
    for milliseconds in range(0, 3000, 20):
        if with_odometry:
            mapping.take_odometry(odometry(milliseconds * MS, (0.0, 0.0, 0.0)))
        mapping.take_scan("scan", laser_scan((milliseconds + 5) * MS, (2.0, 2.0)))
    return mapping.dropped


@pytest.mark.parametrize(
    ("with_odometry", "with_mount", "expected"),
    [
        (True, True, []),
        (False, True, [Problem.NO_ODOMETRY]),
        (True, False, [Problem.UNKNOWN_MOUNT]),
    ],
)
def test_scans_that_are_dropped_name_what_was_missing(with_odometry, with_mount, expected):
    dropped = dropped_by_mapping(with_odometry=with_odometry, with_mount=with_mount)
    found = problems(received(), dropped=dropped)
    assert [problem for problem, _ in found] == expected
    assert all("scan: without" in detail for _, detail in found)


def test_some_scans_that_come_before_everything_else_are_no_problem():
    early = {"scan: before the odometry": 15}
    assert problems(received(), scans=100, dropped=early) == []
    assert [problem for problem, _ in problems(received(), scans=50, dropped=early)] == [
        Problem.NO_ODOMETRY
    ]


def test_other_drops_are_not_taken_for_a_problem():
    reasons = ("odometry: of 'x', not of 'base_link'", "scan: bad ranges", "scan: out of order")
    assert problems(received(), dropped=Counter(reasons)) == []


def test_odometry_is_flat_only_where_it_never_left_the_plane():
    flat, rising, tilted = Flatness(), Flatness(), Flatness()
    for step in range(FLAT_FROM):
        turned = (0.0, 0.0, math.sin(step), math.cos(step))
        flat.observe(odometry(step * MS, (0.1 * step, 0.0, 0.0), turned))
        rising.observe(odometry(step * MS, (0.0, 0.0, 1e-6 if step == 3 else 0.0)))
        pose = odometry(step * MS, (0.0, 0.0, 0.0))
        pose.pose.pose.orientation.x = -1e-9 * step
        tilted.observe(pose)
    assert (flat.poses, rising.poses, tilted.poses) == (FLAT_FROM, 0, 0)
    assert problems(flat_poses=flat.poses)[0][0] is Problem.FLAT


@pytest.mark.parametrize("problem", Problem)
def test_every_message_is_explained(problem):
    headings = [line for line in TROUBLESHOOTING.read_text().splitlines() if line[:3] == "## "]
    assert [heading for heading in headings if problem.value in heading.lower()] != []
