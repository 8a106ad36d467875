# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation.trajectory_error import (
    alignment,
    confidently_wrong,
    evaluate_trajectory,
)

STAMPS = np.arange(5) * 10**9


def along_x(y=0.0, z=0.0, yaw=0.0):
    return se3.from_xyz_rpy([[x, y, z, 0.0, 0.0, yaw] for x in range(5)])


def test_no_error():
    error = evaluate_trajectory(STAMPS, along_x(), STAMPS, along_x())
    assert error.poses == 5
    assert (
        error.ate_rmse_m == error.ate_max_m == error.final_yaw_deg == pytest.approx(0.0, abs=1e-9)
    )


def test_a_constant_offset_is_the_error():
    error = evaluate_trajectory(STAMPS, along_x(y=0.3, z=0.4, yaw=0.1), STAMPS, along_x())
    assert error.ate_rmse_m == pytest.approx(0.5)
    assert error.final_position_m == pytest.approx(0.3)
    assert error.z_rmse_m == pytest.approx(0.4)
    assert error.final_yaw_deg == error.yaw_rmse_deg == pytest.approx(np.degrees(0.1))


def test_drift_by_hand():
    poses = along_x()
    poses[:, 1, 3] = [0.0, 0.0, 0.0, 0.0, 1.0]
    error = evaluate_trajectory(STAMPS, poses, STAMPS, along_x())
    assert error.ate_rmse_m == pytest.approx(np.sqrt(1 / 5))
    assert error.ate_max_m == error.final_position_m == pytest.approx(1.0)


def test_the_truth_is_interpolated_and_poses_outside_of_it_do_not_count():
    stamps = np.array([-1, 5 * 10**8, 25 * 10**8, 9 * 10**9])
    poses = se3.from_xyz_rpy([[x, 0, 0, 0, 0, 0] for x in (50.0, 0.5, 2.5, 50.0)])
    error = evaluate_trajectory(stamps, poses, STAMPS, along_x())
    assert (error.poses, error.ate_max_m) == (2, pytest.approx(0.0, abs=1e-9))
    assert evaluate_trajectory(stamps[:1], poses[:1], STAMPS, along_x()) is None


def test_yaw_errors_wrap_around():
    error = evaluate_trajectory(STAMPS, along_x(yaw=3.1), STAMPS, along_x(yaw=-3.1))
    assert error.final_yaw_deg == pytest.approx(np.degrees(2 * np.pi - 6.2))


@draws(50)
@given(
    shift=st.tuples(*[st.floats(-50.0, 50.0)] * 3),
    yaw=st.floats(-3.1, 3.1),
    seed=st.integers(0, 99),
)
def test_what_was_shifted_and_turned_is_aligned_exactly(shift, yaw, seed):
    rng = np.random.default_rng(seed)
    xyz_rpy = np.column_stack([rng.uniform(-9.0, 9.0, (20, 3)), rng.uniform(-1.0, 1.0, (20, 3))])
    poses, T = se3.from_xyz_rpy(xyz_rpy), se3.from_xyz_rpy([*shift, 0.0, 0.0, yaw])
    np.testing.assert_allclose(alignment(poses, T @ poses), T, atol=1e-9)


@pytest.mark.parametrize(
    ("x", "y", "is_wrong"),
    [(0.2, 0.0, False), (0.0, 0.2, True), (0.4, 0.0, True), (0.0, 0.1, False)],
)
def test_a_pose_is_confidently_wrong_beyond_15_cm_and_three_deviations(x, y, is_wrong):
    poses = np.eye(4)[None].copy()
    poses[0, :2, 3] = x, y
    covariances = np.diag(np.square([0.1, 0.02]))[None]
    found = confidently_wrong(poses, np.eye(4)[None], covariances)
    assert found.tolist() == [is_wrong]
