# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sources that fall silent and come back, as mapping and planning notice it."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from bag_writer import header, laser_scan, odometry
from grid_messages import grid

from heightmap25d_ros.io import decode
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import GIVEN_UP, Mapping
from heightmap25d_ros.pipelines.planning import Planning
from heightmap25d_ros.pipelines.silence import Silence
from heightmap25d_ros.planning.plan import Pose2D

START = 10**18
SECOND = 10**9
PARAMS = with_values(
    Params(), {"intake.mounts": [0.0, 0.0, 0.5, 0.0, 0.0, 0.0], "intake.timeout": 1.0}
)


def pass_seconds(of, seconds, begin=0.0):
    for tenths in range(round(10 * seconds) + 1):
        of.pass_time(START + round((begin + tenths / 10) * SECOND))


def test_nobody_is_silent_while_the_clock_stands_jumps_back_or_the_process_is_busy():
    silence = Silence(["scan"], timeout=1.0)
    for seconds in (0, 0, 0, 100, 40, 40, 40.3):  # 0.5 s of the first step count, 0.3 of the last
        silence.pass_time(START + round(seconds * SECOND))
    assert silence.seconds("scan") == pytest.approx(0.8)
    assert silence.silent == []


def status(state, milliseconds=0):
    return SimpleNamespace(
        LOST=2, TRACKING=0, state=state, header=header(START + milliseconds * 10**6, "map")
    )


class Driver:
    """Feeds a standing robot's odometry and scans."""

    def __init__(self, mapping):
        self.mapping, self.milliseconds = mapping, 0

    def merges_a_scan(self):
        before = self.mapping.merged["scans"]
        for begin in (0, 20):
            self.mapping.take_odometry(odometry(START + (self.milliseconds + begin) * 10**6))
            self.mapping.take_scan(
                "scan", laser_scan(START + (self.milliseconds + 10) * 10**6, (2.0,))
            )
        self.milliseconds += 40
        return self.mapping.merged["scans"] > before


@pytest.mark.parametrize("state", [0, 2], ids=["TRACKING", "LOST"])
def test_mapping_pauses_when_localization_falls_silent_and_gives_it_up_in_the_end(state):
    mapping = Mapping(PARAMS)
    driver = Driver(mapping)
    pass_seconds(mapping, 5.0)
    assert driver.merges_a_scan()  # it never relied on it
    mapping.take_localization_status(status(state))
    assert driver.merges_a_scan() == (state == 0)
    pass_seconds(mapping, 1.2, begin=5.0)
    assert not driver.merges_a_scan()
    assert mapping.trouble == "not mapping: nothing from localization for 1.2 s"
    mapping.take_localization_status(status(0))
    assert mapping.trouble == ""
    assert driver.merges_a_scan()
    mapping.take_localization_status(status(state))
    pass_seconds(mapping, GIVEN_UP - 0.2, begin=6.2)
    assert not driver.merges_a_scan()
    assert mapping.dropped.new_notices() == []
    pass_seconds(mapping, 0.6, begin=6.0 + GIVEN_UP)
    assert driver.merges_a_scan()
    assert mapping.trouble == ""
    (notice,) = mapping.dropped.new_notices()
    assert "silent for 60 s" in notice
    mapping.take_localization_status(status(2))  # it is relied on again
    assert not driver.merges_a_scan()


def test_a_plan_is_stale_while_the_odometry_is_silent():
    planning = Planning(PARAMS)
    planning.set_map(decode.height_map(grid(np.zeros((80, 160)))))
    pass_seconds(planning, 3.0)
    assert planning.staleness == ""  # there is none
    planning.take_odometry(odometry(START, (2.0, 5.0, 0.0)))
    goal = odometry(0, (18.0, 5.0, 0.0), frame_id="map")
    assert planning.take_goal(SimpleNamespace(header=goal.header, pose=goal.pose.pose)).found
    assert planning.staleness == ""
    pass_seconds(planning, 0.9, begin=3.0)
    assert planning.staleness == ""
    planning.take_odometry(odometry(START + SECOND, (math.nan, 5.0, 0.0)))  # no sign of life
    pass_seconds(planning, 0.2, begin=3.9)
    assert planning.staleness == "the plan is stale: nothing from odometry for 1.1 s"
    assert planning.plan_between(Pose2D(2.0, 5.0, 0.0), Pose2D(9.0, 5.0, 0.0)).found
    planning.take_odometry(odometry(START + 2 * SECOND, (2.1, 5.0, 0.0)))
    assert planning.staleness == ""


def test_localization_names_each_silent_source():
    localizer = Localizer(
        with_values(PARAMS, {"intake.scan_topics": ["a", "b"], "intake.mounts": []})
    )
    pass_seconds(localizer, 0.8)
    localizer.take_odometry(odometry(START))
    localizer.take_scan("a", laser_scan(START, (2.0,)))
    pass_seconds(localizer, 0.4, begin=0.8)
    assert localizer.lapse == "nothing from b for 1.2 s"
    localizer.take_odometry(odometry(START, (math.nan, 0.0, 0.0)))
    localizer.take_scan("b", laser_scan(START, (2.0,)))
    pass_seconds(localizer, 0.8, begin=1.2)
    assert localizer.lapse == "nothing from odometry for 1.2 s, nothing from a for 1.2 s"
    localizer.take_odometry(odometry(START + SECOND))
    localizer.take_scan("a", laser_scan(START + SECOND, (2.0,)))
    assert localizer.lapse == ""
