# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What keeps a node from its work, found from plain values."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from bag_writer import laser_scan, odometry
from repository import ROOT

from heightmap25d_ros.io import decode
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import IntakeParams, Params
from heightmap25d_ros.pipelines import odometry_gate
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.input_watch import Flatness, InputWatch
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.self_check import (
    FLAT_FROM,
    Finding,
    Input,
    Observed,
    Problem,
    Watch,
    findings,
    recent,
)

MS = 10**6
TROUBLESHOOTING = ROOT / "docs" / "troubleshooting.md"


def received(topic="/scan", publishers=1, incompatible=(), received=10, is_needed=True, **changes):
    return Input(
        **changes,
        topic=topic,
        publishers=publishers,
        incompatible=incompatible,
        received=received,
        is_needed=is_needed,
    )


def problems(*inputs, scans=100, dropped=None, clock_ns=None, flat_poses=0, used=None):
    observed = Observed(
        inputs=inputs, scans=scans, dropped=dropped or {}, clock_ns=clock_ns,
        flat_poses=flat_poses, used=used,
    )  # fmt: skip
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
    stands = 1_700_000_012_250_000_000
    told = problems(clock_ns=(stands, stands))[0][1]
    assert told.endswith("/clock stands at 1700000012.25 s")
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
        flat.observe(0.0, 0.0, -0.0)
        rising.observe(1e-6 if step == 3 else 0.0, 0.0, 0.0)
        tilted.observe(0.0, -1e-9 * step, 0.0)
    assert (flat.poses, rising.poses, tilted.poses) == (FLAT_FROM, 0, 0)
    assert problems(flat_poses=flat.poses)[0][0] is Problem.FLAT


# What a pipeline notices about its scans.


RATE = 0.04  # [s] between scans


def mapped(
    count=100, *, values=None, scan_ahead=0.0, time_increment=0.0, beams=361, speed=0.2,
    is_stuck=False, **changes,
):  # fmt: skip
    """The mapping of a robot that drives [m/s], as it hears scans and odometry come.

    The laser's last beam tells nothing, but not always in the same way, unless it is stuck.
    """
    ranges = np.full(beams, 2.0) if values is None else np.resize(values, beams)
    params = with_values(Params(), {"intake.mounts": [0.0] * 6, "mapper.update_rule": "paper"})
    mapping = Mapping(params)
    for step in range(count):
        stamp = 10**18 + round(step * RATE * 1e9)
        mapping.take_odometry(odometry(stamp, (speed * step * RATE, 0.0, 0.01 * (step % 2))))
        last = -np.inf if step % 2 and not is_stuck else np.nan
        scan = laser_scan(
            stamp + round((scan_ahead + 0.001) * 1e9), np.append(ranges, last),
            time_increment=time_increment,
            **changes,
        )  # fmt: skip
        mapping.take_scan("scan", scan)
    mapping.settle()
    return mapping


def told(mapping):
    return [str(finding) for finding in mapping.problems()]


def test_a_drive_without_faults_is_not_complained_of():
    assert told(mapped()) == []
    assert told(mapped(values=[2.0, np.inf, np.nan])) == []


def test_ranges_in_millimetres():
    mapping = mapped(values=[4200.0])
    assert told(mapping) == [
        "returns out of range: 100% of 35739 are beyond range_max, "
        "the median is 4200 m against a range_max of 30 m"
    ]
    assert mapping.dropped == {"return: beyond range_max": 35739}
    assert not mapping.maps()[0].known.any()


@pytest.mark.parametrize(
    ("values", "limits", "detail"),
    [
        ([2.0], {"range_min": 0.0, "range_max": 0.0}, "2 m against a range_max of 0 m"),
        ([2.0] * 19 + [0.5], {"range_max": 1.0}, "95% of 35739 are beyond range_max"),
        ([0.0], {}, "100% of 35739 are below range_min, the median is 0 m against"),
    ],
)
def test_limits_that_leave_nothing(values, limits, detail):
    (line,) = told(mapped(values=values, **limits))
    assert line.startswith("returns out of range: ")
    assert detail in line


def test_some_returns_out_of_range_are_counted_and_no_problem():
    mapping = mapped(values=[2.0, 2.0, 81.91, 0.0])
    assert told(mapping) == []
    assert mapping.dropped.keys() == {"return: beyond range_max", "return: below range_min"}
    assert mapping.dropped.notable == 0


def test_returns_at_exactly_range_max_name_the_parameter_that_helps():
    (line,) = told(mapped(values=[2.0] * 9 + [30.0]))
    assert line == (
        "returns at exactly range_max: 10% of 35739 are no objects; set sensor.no_return: range_max"
    )


@pytest.mark.parametrize("convention", ["range_max", "out_of_range"])
def test_what_is_no_return_by_the_parameter_is_not_told(convention):
    watch, dropped = InputWatch(), Drops()
    scan = decode.scan(laser_scan(0, [2.0, 30.0, 31.0] * 10))
    watch.observe_ranges(scan, convention, dropped)
    assert (watch.counts["returns"], watch.counts["at range_max"], dropped) == (10, 0, {})


def test_a_scan_that_lasts_longer_than_the_time_to_the_next_one():
    (line, *_) = told(mapped(time_increment=0.05))
    assert line == (
        "scans last too long: scan: by its time_increment a scan lasts 18.1 s, "
        "and the next one comes after 0.04 s"
    )
    assert told(mapped(time_increment=RATE / 361)) == []  # a laser that turns all the time


@pytest.mark.parametrize(("ahead", "side"), [(0.35, "ahead of"), (-0.6, "behind")])
def test_clocks_that_do_not_agree(ahead, side):
    """The estimate is as good as the period of the odometry."""
    (line,) = [line for line in told(mapped(scan_ahead=ahead)) if "stamps" in line]
    pattern = rf"scan: scan stamps are (0\.\d\d) s {side} the odometry's"
    assert float(re.search(pattern, line)[1]) == pytest.approx(abs(ahead), abs=RATE)


@pytest.mark.parametrize("ahead", [0.05, -0.1])
def test_scans_that_are_a_little_late_are_no_problem(ahead):
    assert not [line for line in told(mapped(scan_ahead=ahead)) if "stamps" in line]


def test_scans_that_are_refused_are_told_with_the_numbers():
    (line,) = [t for t in told(mapped(angle_max=200.0)) if "refused" in t]
    assert line.startswith("scans are refused: scan: bad angle_max (100, the last one: angle_max:")


def test_a_driver_that_repeats_a_scan_while_the_robot_moves():
    (line,) = told(mapped(is_stuck=True))
    assert line == "scans repeat: while the robot moved; scan: 100 scans in a row are the same"
    assert told(mapped(is_stuck=True, speed=0.0)) == []  # a laser without noise
    assert told(mapped(is_stuck=True, values=[np.inf])) == []  # an empty yard


def test_scans_that_are_not_used_are_told():
    assert [p for p, _ in problems(scans=115, used=3)] == [Problem.UNUSED]
    assert problems(scans=115, used=3)[0][1] == "3 of 115"
    assert problems(scans=115, used=100) == problems(scans=10, used=0) == []
    assert problems(scans=115) == []  # planning uses none


def test_jumps_are_told():
    (found,) = problems(dropped={odometry_gate.BRIDGED: 1, "odometry: implausible pose": 2})
    assert found[0] is Problem.JUMPS
    assert "odometry: implausible pose (2)" in found[1]


def test_what_was_seen_in_the_last_seconds():
    before = Observed(
        inputs=(received(received=7), received("/map", received=1)), scans=100,
        dropped={"a": 2, "b": 1}, flat_poses=30, used=90, ranges={"returns": 1000},
    )  # fmt: skip
    now = replace(
        before, inputs=(received(received=9), received("/map", received=1, is_latched=True)),
        scans=150, dropped={"a": 7, "b": 1, "c": 1}, used=91, ranges={"returns": 1500},
    )  # fmt: skip
    seen = recent(now, before)
    assert [entry.received for entry in seen.inputs] == [2, 1]
    assert (seen.scans, seen.used, seen.flat_poses) == (50, 1, 30)
    assert (seen.dropped, seen.ranges) == ({"a": 5, "c": 1}, {"returns": 500})


def test_a_problem_is_told_when_it_begins_and_when_it_is_over():
    watch = Watch()
    scan, odom = Finding(Problem.SILENT, "/scan", "/scan"), Finding(Problem.SILENT, "/o", "/o")
    assert watch.update([]) == ([], [])
    assert watch.update([scan]) == ([scan], [])
    assert watch.update([scan, odom]) == ([odom], [])
    told_again = Finding(Problem.SILENT, "/scan, other numbers", "/scan")
    assert watch.update([told_again]) == ([], [])
    for _ in range(3):  # odom has not been seen four times in a row
        assert watch.update([scan]) == ([], [])
    assert watch.update([scan]) == ([], [odom])
    assert watch.update([scan, odom]) == ([odom], [])


@pytest.mark.parametrize("problem", Problem)
def test_every_message_is_explained(problem):
    headings = [line for line in TROUBLESHOOTING.read_text().splitlines() if line[:3] == "## "]
    assert [heading for heading in headings if problem.value in heading.lower()] != []
