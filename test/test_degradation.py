# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of the table of degradation in docs/reliability.md: what must not cost anything."""

from __future__ import annotations

import sys

import pytest
from repository import BAGS, ROOT

sys.path.append(str(ROOT / "studies"))

import measure_degradation as study
from disturbances import DISTURBANCES, Drive, Event

from heightmap25d_ros.pipelines.odometry_gate import SKIPPED

pytestmark = pytest.mark.slow


def mapped(name):
    return study.map_disturbed(BAGS / "ramp_1", DISTURBANCES[name], seed=1)


@pytest.fixture(scope="module")
def undisturbed():
    return mapped("undisturbed")


@pytest.mark.parametrize(
    ("name", "skipped"),
    [
        ("10 spikes of 3 poses, pitched by 20 degrees", 30),
        ("10 spikes of 3 poses, 0.15 m up", 30),
        ("10 glitches of 5 poses, 0.5 m sideways", 50),
    ],
)
def test_spikes_of_the_odometry_cost_nothing(undisturbed, name, skipped):
    outcome = mapped(name)
    assert outcome.mapping.dropped == {SKIPPED: skipped} | {
        reason: count for reason, count in outcome.mapping.dropped.items() if "return:" in reason
    }
    assert outcome.f1 > undisturbed.f1 - 0.01
    assert outcome.goals >= undisturbed.goals


def test_a_stuck_driver_writes_nothing_wrong(undisturbed):
    outcome = mapped("both lasers repeat a scan for 1 s")
    assert outcome.mapping.dropped["scan: the same as before, though the robot moves"] > 60
    assert outcome.f1 > undisturbed.f1 - 0.01


def test_a_gap_of_the_odometry_makes_no_wrong_pose_look_sure():
    room = BAGS / "room_1"
    long_term = study.mapped(study.read_drive(room, study.TRUE_POSES), "/odom")
    outcome = study.localize_disturbed(
        room, long_term, DISTURBANCES["odometry silent for 1.2 s"], seed=1
    )
    assert outcome.confidently_wrong == 0.0
    assert outcome.largest < 0.3
    assert outcome.seconds[study.State.DEGRADED] > 0.1


def test_disturbances_repeat_themselves_and_leave_the_drive_as_it_is():
    events = study.read_drive(BAGS / "ramp_1", study.TRUE_POSES)[:400]
    before = [repr(event.message) for event in events[:50]]
    for name, disturb in DISTURBANCES.items():
        first, again = (study.disturbed(events, disturb, seed=3) for _ in range(2))
        assert [e.recorded_ns for e in first] == [e.recorded_ns for e in again], name
        assert [e.arrives_ns for e in first] == sorted(e.arrives_ns for e in first), name
    assert [repr(event.message) for event in events[:50]] == before
    assert isinstance(first[0], Event)
    assert Drive(events, 0, 2 * 10**9, None).half == 1.0
