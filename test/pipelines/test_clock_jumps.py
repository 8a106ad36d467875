# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where localization is when the clock has jumped: without a map, it says what it was told."""

from __future__ import annotations

import numpy as np
import pytest
from bag_writer import odometry, rosbags_type

from heightmap25d_ros import se3
from heightmap25d_ros.pipelines.localization import Localizer

START = 10**18
SECOND = 10**9


def initial_pose(x, y):
    pose = odometry(0, (x, y, 0.0), frame_id="map")
    return rosbags_type("geometry_msgs/msg/PoseWithCovarianceStamped")(
        header=pose.header, pose=pose.pose
    )


def at(seconds, x):
    return odometry(START + round(seconds * SECOND), (x, 0.0, 0.0))


def position(localizer):
    return tuple(localizer.pose.T_map_base[:2, 3].round(6))


@pytest.fixture
def told():
    """Told to be at (5, 7) when the odometry has it at x = 1; then 2 m farther on."""
    localizer = Localizer()
    localizer.take_odometry(at(0.0, 1.0))
    localizer.take_initial_pose(initial_pose(5.0, 7.0))
    for step in range(21):
        localizer.take_odometry(at(0.1 * step, 1.0 + 0.1 * step))
    assert position(localizer) == (7.0, 7.0)
    return localizer


@pytest.mark.parametrize("off", [10.0, -10.0])
def test_one_wrong_stamp_does_not_move_the_robot(told, off):
    deviation = told.deviation
    told.take_odometry(at(2.1 + off, 3.1))
    told.take_odometry(at(2.2, 3.2))
    assert position(told) == (7.2, 7.0)
    assert told.deviation[0] >= deviation[0]
    assert told.dropped["poses: clock jumped back, the robot stayed"] == 1
    told.take_odometry(at(2.3, 3.3))
    assert position(told) == (7.3, 7.0)


def test_a_pose_that_was_found_stays_where_one_stamp_is_wrong():
    localizer = Localizer()
    localizer.take_odometry(at(0.0, 1.0))
    found = se3.from_xyz_rpy([3.0, 4.0, 0.0, 0.0, 0.0, 0.0])
    localizer._tracker.set_pose(found, 0.01 * np.eye(3))
    for seconds, x in ((0.1, 1.1), (10.2, 1.2), (0.3, 1.3)):
        localizer.take_odometry(at(seconds, x))
    assert position(localizer) == (4.3, 4.0)


def test_a_bag_that_loops_starts_where_it_was_told_to(told):
    told.take_odometry(at(0.0, 1.0))
    assert position(told) == (5.0, 7.0)
    assert told.dropped["poses: clock jumped back, localization starts over"] == 1
    told.take_odometry(at(0.1, 1.1))
    assert position(told) == (5.1, 7.0)


def test_what_begin_at_says_holds_in_each_loop():
    localizer = Localizer()
    localizer.begin_at([5.0, 7.0, 0.0, 0.0])
    for _ in range(3):
        localizer.take_odometry(at(0.0, 1.0))
        assert position(localizer) == (5.0, 7.0)
        localizer.take_odometry(at(3.0, 4.0))
        assert position(localizer) == (8.0, 7.0)
