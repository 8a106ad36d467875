# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which poses of the odometry are motion, which are wild, and what follows from a jump."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from heightmap25d_ros import se3
from heightmap25d_ros.io.decode import Odometry
from heightmap25d_ros.params.sections import OdometryParams
from heightmap25d_ros.pipelines import odometry_gate
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.odometry_gate import OdometryGate

START = 10**18
IDENTITY = np.eye(4)


def pose(seconds, x=0.0, y=0.0, z=0.0, roll=0.0, pitch=0.0, yaw=0.0):
    return Odometry(
        stamp_ns=START + round(seconds * 1e9),
        frame_id="odom",
        child_frame_id="base_link",
        T=se3.from_xyz_rpy([x, y, z, roll, pitch, yaw]),
    )


def gate_of(*poses, **params):
    """A gate that has seen poses, and the stamps [s] of those that it admitted."""
    gate = OdometryGate(OdometryParams(**params), Drops())
    admitted = [p for given in poses for p in gate.admit(given)]
    return gate, [round((p.stamp_ns - START) * 1e-9, 3) for p in admitted]


def counts(gate):
    return dict(gate._dropped)


def torn(gate, first, last):
    return gate.is_torn(START + round(first * 1e9), START + round(last * 1e9))


def drive(until, rate=50.0, speed=1.0, begin=0.0, **at):
    """Poses along x at a rate [Hz] and a speed [m/s]."""
    times = np.arange(round(begin * rate), round(until * rate)) / rate
    return [pose(t, x=speed * t, **at) for t in times]


@pytest.mark.parametrize(
    ("rate", "motion"),
    [
        (10.0, {"x": 20.0}),  # a car
        (50.0, {"x": 20.0, "yaw": 0.5}),
        (10.0, {"x": 20.0, "z": 4.0}),  # a car on a slope of 20 %
        (1.0, {"x": 20.0}),
        (20.0, {"yaw": 5.0}),  # on the spot
        (100.0, {"pitch": 1.0}),
        (0.12, {"x": 0.3, "yaw": 0.1}),  # stops for 8.4 s
    ],
)
def test_motion_is_never_taken_for_a_jump(rate, motion):
    times = np.arange(30) / rate
    poses = [
        pose(t, **{name: min(value * t, 1.2) if name == "pitch" else value * t
                   for name, value in motion.items()})
        for t in times
    ]  # fmt: skip
    gate, admitted = gate_of(*poses)
    assert admitted == [round(t, 3) for t in times]
    assert (counts(gate), gate.jump) == ({}, None)


@given(
    st.lists(st.floats(-0.02, 0.02), min_size=30, max_size=30),
    st.lists(st.floats(-0.05, 0.05), min_size=30, max_size=30),
)
def test_noise_of_stamps_and_positions_is_no_jump(late, noise):
    """A car at 20 m/s: 2 cm of noise, and 50 Hz stamps that are 2 ms off, hardly apart at times."""
    poses = [
        pose(t + 0.1 * d, x=20.0 * t + n, y=n, z=n, yaw=n)
        for t, d, n in zip(0.02 * np.arange(30), late, noise, strict=True)
    ]
    gate, _ = gate_of(*poses)
    assert counts(gate) == {}


@pytest.mark.parametrize(
    ("wild", "motion"),
    [
        ({"x": 500.0}, "499 m in 0.02 s"),
        ({"x": 1.0, "y": 1.0}, "1 m in 0.02 s"),
        ({"x": 1.0, "z": -0.5}, "-0.5 m of height"),
        ({"x": 1.0, "pitch": 0.3}, "0.3 rad of roll and pitch"),
        ({"x": 1.0, "yaw": -math.pi}, "3.14 rad of yaw"),
    ],
)
def test_a_single_wild_pose_is_skipped(wild, motion):
    gate, admitted = gate_of(*drive(1.02), pose(1.02, **wild), pose(1.04, x=1.04))
    assert (1.02 not in admitted, admitted[-1]) == (True, 1.04)
    assert counts(gate) == {odometry_gate.SKIPPED: 1}
    assert motion in gate._dropped.examples[odometry_gate.SKIPPED]
    assert gate.jump is None
    assert torn(gate, 1.01, 1.011)
    assert torn(gate, 1.03, 1.05)
    assert not torn(gate, 0.9, 1.0)
    assert not torn(gate, 1.04, 1.05)


def test_wild_poses_that_agree_with_nothing_are_all_skipped():
    wild = [pose(1.0 + 0.02 * i, x=100.0 * i) for i in range(1, 6)]
    gate, admitted = gate_of(*drive(1.02), *wild, pose(1.12, x=1.12))
    assert admitted[-2:] == [1.0, 1.12]
    assert counts(gate) == {odometry_gate.SKIPPED: 5}
    assert torn(gate, 1.05, 1.06)


def test_a_wild_pose_at_the_end_is_counted():
    gate, _ = gate_of(*drive(1.0), pose(1.0, x=99.0))
    gate.finish()
    assert counts(gate) == {odometry_gate.SKIPPED: 1}


def test_a_wild_first_pose_is_skipped_as_well():
    gate, admitted = gate_of(pose(0.0), pose(0.02, x=50.0), pose(0.04, x=50.02))
    assert admitted == [0.0, 0.02, 0.04]
    assert torn(gate, 0.0, 0.01)
    np.testing.assert_array_equal(gate.T_first_odom(START + 10**8), IDENTITY)
    assert counts(gate) == {odometry_gate.SKIPPED: 1}


@pytest.mark.parametrize(
    "shift",
    [
        (0.0, 1.0, 0.0, 0.0, 0.0, 0.0),
        (300.0, 0.0, 0.0, 0.0, 0.0, 1.5),
        (0.0, 0.0, 0.8, 0.0, 0.0, 0.0),
        (-2.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    ],
)
@pytest.mark.parametrize("speed", [0.0, 1.0, 20.0])
def test_a_jump_that_stays_is_bridged_by_continuity(shift, speed):
    """The robot goes on as it did; the motion during the jump is that of before and after it."""
    T_shift = se3.from_xyz_rpy(shift)
    poses = [
        p if p.stamp_ns < START + 10**9
        else Odometry(stamp_ns=p.stamp_ns, frame_id="odom", child_frame_id="base_link",
                      T=T_shift @ p.T)
        for p in drive(2.0, speed=speed, z=0.3)
    ]  # fmt: skip
    gate, admitted = gate_of(*poses)
    assert len(admitted) == 100
    assert counts(gate) == {odometry_gate.BRIDGED: 1}
    later = START + round(1.5e9)
    np.testing.assert_allclose(gate.T_first_odom(later) @ T_shift, IDENTITY, atol=1e-6)
    np.testing.assert_array_equal(gate.T_first_odom(START + 5 * 10**8), IDENTITY)
    assert gate.jump.is_known
    assert gate.unknown_since_ns is None
    assert torn(gate, 0.985, 0.995)
    assert not torn(gate, 1.0, 1.01)


def test_a_driver_that_starts_anew_near_its_origin_is_noticed():
    """Half a metre from the origin no speed tells; the pose, exactly 0, does."""
    gate, _ = gate_of(*drive(0.5), pose(0.5), pose(0.52, x=0.02), pose(0.54, x=0.04))
    assert counts(gate) == {odometry_gate.BRIDGED: 1}
    x = gate.T_first_odom(START + 10**9)[0, 3]
    assert x == pytest.approx(0.5, abs=1e-6)


def test_a_driver_that_levels_itself_where_the_robot_is_tilted():
    pitch = -0.2
    gate, _ = gate_of(*drive(1.0, pitch=pitch), pose(1.0), pose(1.02, x=0.02), pose(1.04, x=0.04))
    T = gate.T_first_odom(START + 2 * 10**9)
    assert se3.to_xyz_rpy(T)[4] == pytest.approx(pitch, abs=1e-6)


def test_noise_of_roll_and_pitch_tilts_no_frame():
    gate, _ = gate_of(
        *drive(1.0, roll=0.01), pose(1.0, x=50.0, roll=-0.01), pose(1.02, x=50.02, roll=-0.01)
    )
    np.testing.assert_allclose(se3.to_xyz_rpy(gate.T_first_odom(START + 2 * 10**9))[3:5], 0.0)


def test_after_a_while_the_robot_may_have_moved():
    gate, admitted = gate_of(*drive(1.0), pose(3.0, x=300.0), pose(3.02, x=300.02))
    assert admitted[-2:] == [3.0, 3.02]
    assert counts(gate) == {odometry_gate.UNKNOWN: 1}
    assert gate.unknown_since_ns == START + 3 * 10**9
    assert not gate.jump.is_known
    assert (gate.is_known(START), gate.is_known(START + 3 * 10**9)) == (True, False)
    gate.locate()
    assert gate.is_known(START + 4 * 10**9)


def test_a_jump_in_an_unknown_frame_does_not_make_it_known():
    gate, _ = gate_of(
        *drive(1.0), pose(3.0, x=300.0), pose(3.02, x=300.0), pose(3.04, x=9.0, y=90.0),
        pose(3.06, x=9.0, y=90.0),
    )  # fmt: skip
    assert counts(gate) == {odometry_gate.UNKNOWN: 1, odometry_gate.BRIDGED: 1}
    assert gate.unknown_since_ns == START + round(3.04e9)


@pytest.mark.parametrize("away", [1.0, 3.0])
def test_a_pose_that_comes_back_is_in_the_old_frame_again(away):
    """At once, without waiting for another pose; known or not in between."""
    gap = 0.02 if away == 1.0 else 2.0
    there = [pose(1.0 + gap + 0.02 * i, x=300.0 + 0.02 * i) for i in range(50)]
    back = 2.0 + gap
    gate, admitted = gate_of(*drive(1.0), *there, pose(back, x=back))
    assert admitted[-1] == back
    np.testing.assert_array_equal(gate.T_first_odom(START + 100 * 10**9), IDENTITY)
    assert gate.unknown_since_ns is None
    assert not gate.is_known(there[10].stamp_ns) or gap == 0.02
    assert counts(gate)[odometry_gate.RETURNED] == 1


def test_a_slow_robot_notices_smaller_jumps():
    jump = *drive(1.0), pose(1.0, x=1.5), pose(1.02, x=1.52)
    assert counts(gate_of(*jump)[0]) == {}
    assert counts(gate_of(*jump, max_speed=3.0)[0]) == {odometry_gate.BRIDGED: 1}


def test_a_new_map_begins_in_the_present_frame():
    gate, _ = gate_of(*drive(1.0), pose(1.0, x=50.0), pose(1.02, x=50.02))
    gate.begin_anew()
    np.testing.assert_array_equal(gate.T_first_odom(START + 2 * 10**9), IDENTITY)
    assert torn(gate, 0.5, 0.6)
    assert not torn(gate, 1.0, 1.1)


def offered(*poses):
    """A gate to which poses were offered as the queue does, and how many it admitted of a frame."""
    gate = OdometryGate(OdometryParams(), Drops())
    admitted = Counter()
    for given_pose in poses:
        if gate.refusal(given_pose, "base_link") is None:
            admitted.update(p.frame_id for p in gate.admit(given_pose))
    return gate, admitted


def renamed(poses, name):
    return [replace(p, frame_id=name) for p in poses]


def test_a_frame_of_another_name_takes_over_where_the_present_one_is_silent():
    gate, admitted = offered(*drive(2.0), *renamed(drive(4.0, begin=2.0), "other"))
    assert admitted == {"odom": 100, "other": 49}  # after a second
    assert gate.unknown_since_ns == START + round(3.02e9)
    _, beside = offered(
        *(p for pair in zip(drive(4.0), renamed(drive(4.0), "other"), strict=True) for p in pair)
    )
    assert beside == {"odom": 200}


def test_a_single_first_pose_of_an_odd_name_does_not_keep_the_others_out():
    gate, admitted = offered(*renamed(drive(0.02), "odd"), *drive(3.0, begin=0.02))
    assert admitted == {"odd": 1, "odom": 98}
    assert gate.unknown_since_ns is None
