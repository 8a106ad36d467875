# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How registrations add up, how gently they reach others, and what state they lead to."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from heightmap25d_msgs.msg import LocalizationStatus
from heightmap25d_ros import se3
from heightmap25d_ros.localization.pose_filter import PoseFilter, SmoothCorrection
from heightmap25d_ros.localization.registration import Reason, Registration
from heightmap25d_ros.localization.tracker import Tracker
from heightmap25d_ros.localization.tracking_state import Health, State
from heightmap25d_ros.params.sections import LocalizationParams, Params

PARAMS = LocalizationParams()
poses = st.tuples(
    *[st.floats(-5.0, 5.0)] * 3, *[st.floats(-0.3, 0.3)] * 2, st.floats(-3.0, 3.0)
).map(se3.from_xyz_rpy)


def registration(reason=Reason.ACCEPTED, offset=(0.0, 0.0, 0.0), information=None, z=0.0):
    return Registration(
        reason=reason, offset=np.array(offset), z=z, known=1.0, overlap=1.0, residual=0.01,
        ratio=0.0,
        information=1e4 * np.eye(3) if information is None else information, points=500,
    )  # fmt: skip


@given(poses, poses, st.tuples(*[st.floats(-0.5, 0.5)] * 3), st.floats(-0.5, 0.5))
def test_a_sure_registration_moves_the_robot_by_its_offset(T_map_odom, T_odom_base, offset, z):
    yaw = se3.to_xyz_rpy(T_map_odom)[5]
    level = se3.from_xyz_rpy([*T_map_odom[:3, 3], 0.0, 0.0, yaw])
    estimate = PoseFilter(PARAMS, level, 100.0 * np.eye(3))
    before = se3.to_xyz_rpy(level @ T_odom_base)
    estimate.correct(registration(offset=offset, information=1e9 * np.eye(3), z=z), T_odom_base)
    after = se3.to_xyz_rpy(estimate.T_map_odom @ T_odom_base)
    change = after - before
    change[5] = np.angle(np.exp(1j * change[5]))
    np.testing.assert_allclose(change, (offset[0], offset[1], z, 0.0, 0.0, offset[2]), atol=1e-6)


def test_what_is_not_observed_is_not_corrected():
    estimate = PoseFilter(PARAMS, np.eye(4), 0.01 * np.eye(3))
    along_y = np.diag([0.0, 1e6, 0.0])
    estimate.correct(registration(offset=(0.3, 0.2, 0.1), information=along_y), np.eye(4))
    np.testing.assert_allclose(estimate.T_map_odom[:2, 3], (0.0, 0.2), atol=1e-4)
    assert estimate.covariance[0, 0] == pytest.approx(0.01)
    assert estimate.covariance[1, 1] < 1e-5
    assert estimate.deviation[0] == pytest.approx(0.1)


def test_driving_makes_it_less_sure_and_an_unsure_heading_sideways_most():
    estimate = PoseFilter(PARAMS, np.eye(4), np.diag([1e-6, 1e-6, 0.1**2]))
    ahead = se3.from_xyz_rpy([10.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    estimate.predict(np.eye(4), ahead, 10.0)
    across = np.sqrt(estimate.covariance[1, 1])
    assert across == pytest.approx(1.0, rel=0.05)  # 10 m at 0.1 rad
    assert np.sqrt(estimate.covariance[0, 0]) == pytest.approx(
        PARAMS.position_drift * np.sqrt(10), rel=0.01
    )


@given(poses, poses, poses, st.floats(0.01, 1.0))
def test_others_are_told_no_faster_than_allowed_and_in_the_end_all(start, target, base, seconds):
    smooth = SmoothCorrection(PARAMS, start)
    for _ in range(3):
        before = smooth.T_map_odom @ base
        smooth.follow(target, base, seconds)
        after = smooth.T_map_odom @ base
        moved = np.linalg.norm(after[:3, 3] - before[:3, 3])
        assert moved <= PARAMS.correction_speed * seconds + 1e-9
        turn = after[:3, :3] @ before[:3, :3].T
        assert np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)) <= (
            PARAMS.correction_turn * seconds + 1e-6
        )
    level = se3.from_xyz_rpy([1.0, 2.0, 0.3, 0.0, 0.0, 1.0])
    smooth = SmoothCorrection(PARAMS, np.eye(4))
    for _ in range(40):
        smooth.follow(level, base, 2.0)
    np.testing.assert_allclose(smooth.T_map_odom @ base, level @ base, atol=1e-6)


def test_the_states_are_those_of_the_message():
    for state in State:
        assert getattr(LocalizationStatus, state.name) == state


def refused(reason=Reason.HIGH_RESIDUAL):
    return registration(reason=reason)


def test_state_comes_and_goes_with_hysteresis():
    health = Health(PARAMS)
    assert health.state is State.DEGRADED
    health.update(registration(), 0.02)
    assert health.state is State.DEGRADED
    health.update(registration(), 0.02)
    assert health.state is State.TRACKING
    for _ in range(PARAMS.degraded_refusals - 1):
        health.update(refused(), 0.02)
        assert health.state is State.TRACKING
    health.update(refused(), 0.02)
    assert health.state is State.DEGRADED
    health.update(registration(), 0.02)
    assert health.state is State.DEGRADED
    for _ in range(PARAMS.lost_refusals):
        health.update(refused(), 0.02)
    assert health.state is State.LOST
    for _ in range(5):
        health.update(registration(), 0.02)
    assert health.state is State.LOST
    health.begin(is_confirmed=True)
    assert health.state is State.TRACKING


@pytest.mark.parametrize("reason", [Reason.UNOBSERVED, Reason.AMBIGUOUS, Reason.FEW_POINTS])
def test_what_says_nothing_loses_nobody_but_uncertainty_degrades(reason):
    health = Health(dataclasses.replace(PARAMS, confirmations=1))
    health.update(registration(), 0.02)
    for _ in range(100):
        health.update(refused(reason), 0.05)
    assert health.state is State.TRACKING
    health.update(refused(reason), PARAMS.degraded_deviation + 0.01)
    assert health.state is State.DEGRADED


def test_a_robot_that_drives_without_registrations_is_degraded_when_its_deviation_says_so():
    tracker = Tracker(Params(), np.eye(4), np.diag([0.01, 0.01, 1e-6]))
    tracker.health.begin(is_confirmed=True)
    states = []
    for x in np.arange(0.0, 20.0, 0.5):
        tracker.move(se3.from_xyz_rpy([x, 0.0, 0.0, 0.0, 0.0, 0.0]))
        states.append(
            (tracker.estimate.deviation[0] > PARAMS.degraded_deviation, tracker.health.state)
        )
    assert {is_wide: state for is_wide, state in states} == {
        False: State.TRACKING, True: State.DEGRADED,
    }  # fmt: skip
    assert len(set(states)) == 2


def test_a_pose_that_was_given_is_not_tracking_before_the_map_has_confirmed_it():
    health = Health(dataclasses.replace(PARAMS, confirmations=1, degraded_deviation=0.3))
    for deviation, state in (
        (0.29, State.DEGRADED), (0.13, State.DEGRADED), (0.1, State.TRACKING),
        (0.29, State.TRACKING), (0.31, State.DEGRADED), (0.29, State.TRACKING),
    ):  # fmt: skip
        health.update(registration(), deviation)
        assert health.state is state
    health.begin()  # given once more
    health.update(registration(), 0.29)
    assert health.state is State.DEGRADED
