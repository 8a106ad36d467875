# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry that tells motions wrong, and what level lasers see of walls."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from level_scans import CORRIDOR, ROOM, planar, scan
from properties import draws

from heightmap25d_ros import se3
from heightmap25d_ros.slam.laser_odometry import LaserOdometry


def drive(walls, true, told):
    """The pose (4, 4) that is found at the end of places x, y, yaw, with as many poses told."""
    odometry = LaserOdometry(memory=40.0)
    for place, pose in zip(true, told, strict=True):
        odometry.correct(scan(walls, place, pose), pose)
    return odometry.T_odom_wheels @ told[-1]


def assert_near(pose, place, within=0.03, within_yaw=0.01):
    np.testing.assert_allclose(pose[:2, 3], place[:2], atol=within)
    assert se3.yaw(pose) == pytest.approx(place[2], abs=within_yaw)


def test_encoders_that_do_not_tell_backwards():
    x = np.concatenate([np.arange(0.0, 1.55, 0.1), np.arange(1.4, 0.05, -0.1)])
    told = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x)))])
    found = drive(ROOM, [(a, 0.0, 0.3) for a in x], [planar(a, 0.0, 0.3) for a in told])
    assert told[-1] > 2.8
    assert_near(found, (x[-1], 0.0, 0.3))


def test_wheels_that_spin():
    x = np.minimum(np.arange(0.0, 3.0, 0.1), 1.0)
    told = np.arange(0.0, 3.0, 0.1)
    found = drive(ROOM, [(a, 0.0, 0.0) for a in x], [planar(a, 0.0, 0.0) for a in told])
    assert_near(found, (1.0, 0.0, 0.0))


@given(
    x=st.floats(-0.2, 0.2), y=st.floats(-0.2, 0.2), yaw=st.floats(-0.25, 0.25),
    heading=st.floats(-3.0, 3.0),
)  # fmt: skip
@draws(10, deadline=None)
def test_a_step_that_is_told_wrong_is_found(x, y, yaw, heading):
    begin, end = (0.0, 0.0, heading), (0.1, 0.1, heading)
    told = planar(0.1 + x, 0.1 + y, heading + yaw)
    assert_near(drive(ROOM, [begin, end], [planar(*begin), told]), end, within=0.05)


def test_along_a_plain_corridor_the_wheels_decide():
    true = [(0.05 * k, 0.0, 0.0) for k in range(60)]
    told = [planar(x, 0.1 * x, 0.02 * x) for x, _, _ in true]
    found = drive(CORRIDOR, true, told)
    assert abs(found[0, 3] - true[-1][0]) < 0.03  # grazed walls do not draw it back
    assert abs(found[1, 3]) < 0.02
    assert abs(se3.yaw(found)) < 0.01


def test_a_laser_that_sees_the_ground_corrects_nothing():
    odometry = LaserOdometry(memory=40.0)
    for k in range(5):
        told = planar(0.2 * k, 0.0, 0.0)
        beams = scan(ROOM, (0.1 * k, 0.0, 0.0), told, fall=0.2)
        assert odometry.correct(beams, told) is beams
    np.testing.assert_array_equal(odometry.T_odom_wheels, np.eye(4))


def test_a_robot_that_is_tilted_is_not_corrected():
    told = [planar(0.2 * k, 0.0, 0.0, tilt=0.1) for k in range(5)]
    true = [(0.1 * k, 0.0, 0.0) for k in range(5)]
    np.testing.assert_array_equal(drive(ROOM, true, told), told[-1])


def test_odometry_that_jumps_goes_on_where_the_robot_was():
    odometry = LaserOdometry(memory=40.0)
    odometry.correct(scan(ROOM, (0.0, 0.0, 0.0), np.eye(4)), np.eye(4))
    jumped = planar(7.0, -3.0, 2.0)
    odometry.mend(se3.inverse(jumped))
    assert_near(odometry.T_odom_wheels @ jumped, (0.0, 0.0, 0.0), 1e-9, 1e-9)
    told = jumped @ planar(0.3, 0.0, 0.0)
    for x in (0.1, 0.2):
        told = jumped @ planar(2.0 * x, 0.0, 0.0)
        odometry.correct(scan(ROOM, (x, 0.0, 0.0), told), told)
    assert_near(odometry.T_odom_wheels @ told, (0.2, 0.0, 0.0))


@pytest.mark.parametrize(("step", "turn"), [(0.2, 0.0), (0.0, 0.4), (0.1, 0.2)])
def test_memory_does_not_grow(step, turn):
    odometry = LaserOdometry(memory=5.0)
    kept = []
    true = np.zeros(3)
    for _ in range(300):
        told = planar(*true)
        odometry.correct(scan(CORRIDOR, true, told), told)
        kept.append(len(odometry._scans))
        true = true + (step * np.cos(true[2]), 0.1 * step * np.sin(true[2]), turn)
    assert kept[-1] > 20
    assert max(kept) <= 2.0 * 5.0 / 0.1 + 2
