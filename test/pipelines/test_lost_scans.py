# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans that did not come are counted by the stamps of those that did."""

import numpy as np
import pytest
from repository import BAGS

from heightmap25d_ros.io import decode, message_bytes
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.input_watch import LOST, InputWatch
from heightmap25d_ros.pipelines.self_check import Problem, findings_of_drive

PERIOD = 10**9 / 75


def lost_of(stamps):
    watch = InputWatch()
    for index, stamp in enumerate(stamps):
        ranges = np.full(3, 1.0 + index, np.float32)
        scan = Scan(stamp_ns=round(stamp), angle_min=0.0, angle_increment=0.1, ranges=ranges)
        watch.observe_scan("/scan", scan, 0)
    problems = {finding.problem for finding in findings_of_drive(watch, Drops())}
    return watch.counts[LOST], Problem.LOST in problems


def test_each_one_that_is_missing_is_counted():
    rng = np.random.default_rng(1)
    stamps = PERIOD * np.arange(1000) + rng.uniform(-0.08, 0.08, 1000) * PERIOD
    is_lost = rng.random(1000) < 0.1
    is_lost[:50] = is_lost[-1] = False
    is_lost[500:600] = True
    assert lost_of(stamps) == (0, False)
    counted, is_problem = lost_of(stamps[~is_lost])
    assert counted == pytest.approx(is_lost.sum(), abs=2)
    assert is_problem


def test_one_of_many_is_counted_and_is_no_problem():
    assert lost_of(np.delete(PERIOD * np.arange(1000), 600)) == (1, False)


@pytest.mark.parametrize(
    "stamps",
    [
        np.cumsum(np.random.default_rng(2).exponential(PERIOD, 1000)),  # without a rhythm
        np.cumsum([1e4, 1e4, 1e4, 1e4, 5e7] * 200),  # parts of one scan
        PERIOD * np.concatenate([np.arange(500), np.arange(1000, 1500)]),  # switched off between
        np.cumsum([PERIOD] * 500 + [-5e9] + [PERIOD] * 500),  # a clock that jumps back
    ],
)
def test_what_is_not_known_to_be_lost_is_not_counted(stamps):
    assert lost_of(stamps) == (0, False)


def test_a_laser_that_slows_down_has_lost_hardly_any():
    stamps = np.cumsum([PERIOD] * 500 + [2 * PERIOD] * 500)
    assert lost_of(stamps) == (10, False)


def test_of_a_recorded_drive_none_is_lost():
    watch = InputWatch()
    with Bag(BAGS / "ramp") as bag:
        for event in bag.events(bag.scan_topics(), readers=message_bytes.READERS):
            watch.observe_scan(event.topic, decode.scan(event.message), 0)
    assert watch.counts[LOST] == 0
