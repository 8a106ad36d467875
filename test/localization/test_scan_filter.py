# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans held to walls and ground of which everything is known."""

from __future__ import annotations

import numpy as np
import pytest
from landmark_worlds import (
    CORRIDOR,
    ROOM,
    ground_returns,
    landmarks_seen_by,
    mapped,
    tightly_cropped,
    wall_returns,
)

from heightmap25d_ros import se3
from heightmap25d_ros.localization import scan_update
from heightmap25d_ros.localization.landmarks import landmarks_of
from heightmap25d_ros.localization.odometry_errors import unknown_errors
from heightmap25d_ros.localization.registration import Reason
from heightmap25d_ros.localization.scan_filter import ScanFilter
from heightmap25d_ros.localization.scan_window import ScanWindow
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import Params, ScanFilterParams

PARAMS = Params()
PRIOR = np.diag(np.square([0.05, 0.05, 0.02, 0.03]))


def world(walls, noise, seed=1):
    rng = np.random.default_rng(seed)
    return landmarks_seen_by(
        ground_returns(rng, 80000, noise=noise), wall_returns(rng, 40000, walls, noise=noise)
    )


@pytest.fixture(scope="module")
def room():
    return world(ROOM, 0.01)


@pytest.fixture(scope="module")
def corridor():
    return world(CORRIDOR, 0.01)


def seen_from(T_map_base, walls, count=800, noise=0.01, seed=2):
    """Returns (N, 3), as the robot at a pose sees them in its own frame."""
    rng = np.random.default_rng(seed)
    ends = np.concatenate([
        ground_returns(rng, count // 2, half=(3.0, 1.1), noise=noise),
        wall_returns(rng, count, walls, noise=noise),
    ])  # fmt: skip
    ends = ends[np.abs(ends[:, 0]) < 4.5]
    return se3.transform_points(se3.inverse(T_map_base), ends)


def estimate_at(T, spread=(0.1, 0.1, 0.03)):
    return ScanFilter(PARAMS, T, np.diag(np.square(spread)), unknown_errors(PARAMS))


@pytest.mark.slow
def test_in_a_room_the_pose_is_found_to_millimetres(room):
    true = se3.from_xyz_rpy([0.3, 0.1, 0.0, 0.0, 0.0, 0.4])
    prior = se3.from_xyz_rpy([0.36, 0.05, 0.04, 0.0, 0.0, 0.43])
    estimate = estimate_at(prior)
    found = estimate.update(seen_from(true, ROOM), np.eye(4), room)
    assert found.reason is Reason.ACCEPTED
    error = se3.to_xyz_rpy(estimate.T_map_odom) - se3.to_xyz_rpy(true)
    assert np.abs(error[:3]).max() < 0.008
    assert abs(np.degrees(error[5])) < 0.15
    assert max(estimate.deviation) < 0.02


def test_walls_at_the_edge_of_the_map_count():
    """The walls of a robot's own map are where it ends."""
    rng = np.random.default_rng(1)
    returns = ground_returns(rng, 20000, noise=0.01), wall_returns(rng, 20000, noise=0.01)
    landmarks = landmarks_of(*tightly_cropped(*mapped(*returns)))
    true = se3.from_xyz_rpy([0.3, 0.1, 0.0, 0.0, 0.0, 0.4])
    estimate = estimate_at(se3.from_xyz_rpy([0.3, 0.05, 0.0, 0.0, 0.0, 0.43]))
    found = estimate.update(seen_from(true, CORRIDOR), np.eye(4), landmarks)
    assert found.is_accepted
    error = se3.to_xyz_rpy(estimate.T_map_odom) - se3.to_xyz_rpy(true)
    assert abs(error[1]) < 0.008
    assert abs(np.degrees(error[5])) < 0.15


def test_ground_at_the_edge_of_the_map_tells_nothing():
    """It was seen on one side only: what slopes there may be the foot of a wall."""
    returns = ground_returns(np.random.default_rng(1), 40000)
    landmarks = landmarks_of(*tightly_cropped(*mapped(returns)))
    rows, columns = np.nonzero(landmarks.plane_of >= 0)
    height, width = landmarks.is_wall.shape
    border = (landmarks.plane_of.shape[0] - height) // 2
    assert (rows.min(), rows.max()) == (border + 2, border + height - 3)
    assert (columns.min(), columns.max()) == (border + 2, border + width - 3)


def test_a_tilt_of_the_odometry_is_not_taken_for_height_or_place(room):
    true = se3.from_xyz_rpy([0.3, 0.1, 0.0, 0.0, 0.0, 0.4])
    returns = seen_from(true @ se3.from_xyz_rpy([0, 0, 0, 0.006, -0.008, 0]), ROOM)
    estimate = estimate_at(true)
    estimate.update(returns, np.eye(4), room)
    error = se3.to_xyz_rpy(estimate.T_map_odom) - se3.to_xyz_rpy(true)
    assert np.abs(error[:3]).max() < 0.012


def test_a_tilt_of_the_odometry_is_told_and_fades_with_the_way(room):
    """It is of the moment: the next error of roll and pitch is another one."""
    true = se3.from_xyz_rpy([0.3, 0.1, 0.0, 0.006, -0.008, 0.4])
    level = se3.from_xyz_rpy([0.3, 0.1, 0.0, 0.0, 0.0, 0.4])
    returns = seen_from(true, ROOM, count=8000)
    estimate = estimate_at(level)
    estimate.update(returns, np.eye(4), room)
    told = se3.tilt_about(estimate.T_map_odom, estimate.tilt) @ estimate.T_map_odom
    np.testing.assert_allclose(se3.to_xyz_rpy(told)[3:5], (0.006, -0.008), atol=0.0015)
    before, tilt = np.eye(4), np.abs(estimate.tilt)
    for x in (0.3, 0.6, 0.9):
        after = se3.from_xyz_rpy([x, 0.0, 0.0, 0.0, 0.0, 0.0])
        estimate.predict(before, after)
        assert (np.abs(estimate.tilt) < 0.5 * tilt).all()
        before, tilt = after, np.abs(estimate.tilt)


def test_along_a_corridor_nothing_is_told(corridor):
    returns = seen_from(np.eye(4), CORRIDOR)
    found = scan_update.update_by_returns(
        returns, np.zeros(3), np.linalg.inv(PRIOR), corridor, PARAMS.scan_filter
    )
    across, along = found.information[1, 1], found.information[0, 0]
    assert across > 1.0 / 0.005**2
    assert along < 1.0 / 1.0**2
    assert abs(found.error[0]) < 0.002


def test_only_the_share_of_information_counts_that_noise_does_not_explain():
    information = np.diag([1000.0, 1e6, 1e6, 1e6])
    gradient = np.array([10.0, 1e3, 1e3, 1e3])
    for faked, share in ((0.0, 1.0), (0.1, 0.8), (0.6, 0.0)):
        kept, kept_gradient = scan_update._discounted(
            information, gradient, np.diag([1000.0 * faked, 0.0, 0.0, 0.0]), 2.0, 3.0
        )
        caution = 1.0 + 3.0 * faked
        np.testing.assert_allclose(
            np.diag(kept), [1000.0 * share**2 / caution, 1e6, 1e6, 1e6], rtol=1e-4, atol=1e-3
        )
        np.testing.assert_allclose(
            kept_gradient, [10.0 * share / caution, 1e3, 1e3, 1e3], rtol=1e-4, atol=1e-3
        )


def driven(estimate, length, landmarks=None, step=0.08, scale=1.0):
    """Drive along x, straight; odometry tells ``scale`` of the distance."""
    T = np.eye(4)
    for k in range(round(length / step)):
        before, T = T, se3.from_xyz_rpy([scale * (k + 1) * step, 0.0, 0.0, 0.0, 0.0, 0.0])
        estimate.predict(before, T)
        if landmarks is not None:
            true = se3.from_xyz_rpy([(k + 1) * step, 0.0, 0.0, 0.0, 0.0, 0.0])
            seen = se3.transform_points(T, seen_from(true, CORRIDOR, seed=k))
            estimate.update(seen, T, landmarks)
    return T


def test_slip_grows_as_it_does_where_nothing_tells_of_it(corridor):
    """5.5 % of slip that lasts for 3 m: 0.14 m after 3 m and 0.25 m after 6 m."""
    for length, expected in ((3.0, 0.14), (6.0, 0.25)):
        alone = estimate_at(np.eye(4), (0.001, 0.001, 0.001))
        driven(alone, length)
        held = estimate_at(np.eye(4), (0.001, 0.001, 0.001))
        driven(held, min(length, 3.0), corridor)
        along = np.sqrt(alone.covariance[0, 0])
        assert along == pytest.approx(expected, rel=0.15)
        if length == 3.0:
            assert np.sqrt(held.covariance[0, 0]) > 0.9 * along
            assert np.sqrt(held.covariance[1, 1]) < 0.01


def test_a_scale_of_the_odometry_is_learned(room):
    estimate = estimate_at(np.eye(4), (0.01, 0.01, 0.01))
    T = np.eye(4)
    for lap in range(20):
        for k in range(10):
            x = 0.1 * (k + 1 if lap % 2 == 0 else 9 - k)
            before, T = T, se3.from_xyz_rpy([x / 1.03, 0.0, 0.0, 0.0, 0.0, 0.0])
            estimate.predict(before, T)
            true = se3.from_xyz_rpy([x, 0.0, 0.0, 0.0, 0.0, 0.0])
            returns = se3.transform_points(T, seen_from(true, ROOM, seed=k))
            estimate.update(returns, T, room)
    slip, scale = estimate.errors.mean[:2]
    assert slip + scale == pytest.approx(0.03, abs=0.01)


@pytest.mark.parametrize("share", [0.35, 0.6])
def test_where_much_has_changed_the_rest_tells_the_place_if_it_fits_sharply(share):
    """Walls alone, as level lasers see them: of the ground nothing is known."""
    rng = np.random.default_rng(5)
    room = landmarks_seen_by(wall_returns(rng, 40000, ROOM, noise=0.01))
    true = se3.from_xyz_rpy([0.3, 0.1, 0.0, 0.0, 0.0, 0.4])
    old = wall_returns(rng, round(600 * share), ROOM, noise=0.01)
    new = np.column_stack([rng.uniform((-2.8, -1), (3, 1), (600 - len(old), 2)),
                           rng.uniform(0.3, 0.8, 600 - len(old))])  # fmt: skip
    returns = se3.transform_points(se3.inverse(true), np.concatenate([old, new]))
    estimate = estimate_at(se3.from_xyz_rpy([0.34, 0.06, 0.0, 0.0, 0.0, 0.42]))
    found = estimate.update(returns, np.eye(4), room)
    assert found.reason is Reason.ACCEPTED
    assert found.overlap < PARAMS.registration.min_overlap
    assert np.abs((estimate.T_map_odom - true)[:2, 3]).max() < 0.01
    for elsewhere in (
        [1.3, 0.1, 0, 0, 0, 0.4],
        [-0.5, 0.3, 0, 0, 0, 1.4],
        [0.3, 0.5, 0, 0, 0, 0.7],
    ):
        wrong = estimate_at(se3.from_xyz_rpy(elsewhere))
        assert not wrong.update(returns, np.eye(4), room).is_accepted


@pytest.mark.parametrize(
    ("true", "told"),
    [((0.3, 0.0, 0.0), (0.3, 0.0, 0.17)), ((0.0, 0.0, 0.0), (0.3, 0.0, 0.0)),
     ((-0.15, 0.0, 0.0), (0.15, 0.0, 0.0))],
    ids=["a turn that did not happen", "wheels that spin", "a way without its sign"],
)  # fmt: skip
def test_a_motion_that_the_odometry_is_wrong_about_is_found(room, true, told):
    begin = se3.from_xyz_rpy([0.2, 0.1, 0.0, 0.0, 0.0, 0.3])
    estimate = estimate_at(begin, (0.01, 0.01, 0.005))
    estimate.update(seen_from(begin, ROOM), np.eye(4), room)
    T_true, T_told = (se3.from_xyz_rpy([x, y, 0.0, 0.0, 0.0, yaw]) for x, y, yaw in (true, told))
    estimate.predict(np.eye(4), T_told)
    returns = se3.transform_points(T_told, seen_from(begin @ T_true, ROOM, seed=4))
    assert estimate.update(returns, T_told, room).is_accepted
    apart = se3.inverse(begin @ T_true) @ estimate.T_map_odom @ T_told
    assert np.abs(apart[:2, 3]).max() < 0.02
    assert abs(apart[1, 0]) < 0.01


def test_what_contradicts_the_map_changes_nothing(room):
    estimate = estimate_at(np.eye(4))
    rng = np.random.default_rng(3)
    clutter = np.column_stack([rng.uniform((-3, -1), (3, 1), (500, 2)), rng.uniform(0.3, 0.8, 500)])
    before = estimate.covariance
    found = estimate.update(clutter, np.eye(4), room)
    assert found.reason is Reason.HIGH_RESIDUAL
    np.testing.assert_array_equal(estimate.covariance, before)
    few = estimate.update(clutter[:10], np.eye(4), room)
    assert few.reason is Reason.FEW_POINTS
    far = estimate.update(clutter + (100.0, 0.0, 0.0), np.eye(4), room)
    assert far.reason is Reason.LITTLE_OVERLAP


def test_settling_moves_the_pose_and_makes_it_no_surer(room):
    true = se3.from_xyz_rpy([0.3, 0.1, 0.0, 0.0, 0.0, 0.4])
    estimate = estimate_at(true @ se3.from_xyz_rpy([0.05, 0.03, 0, 0, 0, 0.02]), (0.3, 0.3, 0.1))
    before = estimate.covariance
    estimate.settle(seen_from(true, ROOM), np.eye(4), room)
    np.testing.assert_array_equal(estimate.covariance, before)
    error = se3.to_xyz_rpy(estimate.T_map_odom) - se3.to_xyz_rpy(true)
    assert np.abs(error[:2]).max() < 0.01


def test_a_robot_that_stands_is_not_told_the_same_again_and_again():
    window = ScanWindow(ScanFilterParams())
    ends = np.ones((5, 3))
    beams = Beams(
        origins=ends, ends=ends, is_hit=np.array([1, 1, 1, 1, 0], bool), is_lone=np.zeros(5, bool)
    )
    updates = 0
    for k in range(100):
        window.add(beams, k * 50_000_000)
        if window.is_due(0.0, k * 50_000_000):
            assert len(window.take(0.0, k * 50_000_000)) >= 4
            updates += 1
            if updates > 5:  # those before contradict the map
                window.confirm()
    assert updates == 5 + 3
    assert window.is_due(0.1, 100 * 50_000_000)


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.1])
def test_the_noise_of_turns_is_learned(room, noise):
    """A robot turns on the spot, 0.2 rad a step; its odometry errs by so much a radian."""
    rng = np.random.default_rng(4)
    estimate = estimate_at(np.eye(4), (0.02, 0.02, 0.01))
    told, true = 0.0, 0.0
    for k in range(200):
        before = told
        told, true = told + 0.2, true + 0.2 + noise * np.sqrt(0.2) * rng.normal()
        T_odom_base = se3.from_xyz_rpy([0, 0, 0, 0, 0, told])
        estimate.predict(se3.from_xyz_rpy([0, 0, 0, 0, 0, before]), T_odom_base)
        seen = seen_from(se3.from_xyz_rpy([0, 0, 0, 0, 0, true]), ROOM, seed=k)
        seen = se3.transform_points(T_odom_base, seen)
        estimate.update(np.ascontiguousarray(seen), T_odom_base, room)
    learned = np.sqrt(estimate.errors.turn_variance)
    assert max(0.5 * noise, 0.006) <= learned <= max(2.0 * noise, 0.02)
    yaw = se3.to_xyz_rpy(estimate.T_map_odom @ T_odom_base)[5]
    assert abs(np.angle(np.exp(1j * (yaw - true)))) < 0.02


def test_a_slope_tells_a_place_only_where_the_prior_is_not_wide():
    rng = np.random.default_rng(5)
    slope = 0.2, 0.0
    landmarks = landmarks_seen_by(ground_returns(rng, 60000, slope=slope, noise=0.005))
    seen = ground_returns(rng, 900, half=(3.0, 1.1), slope=slope, noise=0.005)
    for spread, is_told in ((0.05, True), (0.5, False)):
        precision = np.diag(1.0 / np.square([spread, spread, 0.02, 0.01]))
        found = scan_update.update_by_returns(
            seen, np.zeros(3), precision, landmarks, PARAMS.scan_filter
        )
        assert (found.information[0, 0] > 100.0) == is_told
        assert found.information[3, 3] > 1e4


def test_noise_of_a_ramp_does_not_lead_a_robot_astray_that_turns_on_it():
    """Nothing tells the way along a plain ramp, on a map that was made by scans as noisy."""
    slope = 0.17, 0.0

    def tilted(rng):
        return se3.from_xyz_rpy([0.0, 0.0, 0.0, *rng.normal(0.0, np.radians(0.3), 2), 0.0])

    def on_ramp(x, yaw=0.0):
        pitch = -np.arctan(slope[0])
        level = se3.from_xyz_rpy([x, 0.0, slope[0] * x, 0.0, pitch, 0.0])
        return level @ se3.from_xyz_rpy([0.0, 0.0, 0.0, 0.0, 0.0, yaw])

    shifts = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        scans = [
            ground_returns(rng, 900, half=(4.0, 1.5), slope=slope, noise=0.02) for _ in range(30)
        ]
        landmarks = landmarks_seen_by(np.concatenate([s @ tilted(rng)[:3, :3] for s in scans]))
        estimate = estimate_at(np.eye(4), (0.01, 0.01, 0.003))
        for x in np.arange(-3.0, -0.05, 0.1):
            estimate.predict(on_ramp(x), on_ramp(x + 0.1))
        assert estimate.deviation[0] > 0.1
        told = on_ramp(0.0)
        for k in range(60):
            before, true = told, on_ramp(0.0, 0.1 * (k + 1))
            told = true @ tilted(rng)
            estimate.predict(before, told)
            seen = ground_returns(rng, 900, half=(3.0, 1.1), slope=slope, noise=0.02)
            seen = np.ascontiguousarray(se3.transform_points(told @ se3.inverse(true), seen))
            estimate.update_growing(seen, told, landmarks, has_ground=True)
        shifts.append((estimate.T_map_odom @ told)[0, 3])
    assert np.abs(shifts).max() < 0.0005


def test_walls_tell_at_once_that_odometry_was_off_by_more(room):
    true = se3.from_xyz_rpy([0.3, 0.1, 0.0, 0.0, 0.0, 0.4])
    estimate = estimate_at(true @ se3.from_xyz_rpy([-0.1, 0.05, 0, 0, 0, 0.01]), (0.2, 0.2, 0.03))
    seen = seen_from(true, ROOM)
    for _ in range(3):
        estimate.update_growing(seen, np.eye(4), room, has_ground=True)
    error = se3.to_xyz_rpy(estimate.T_map_odom) - se3.to_xyz_rpy(true)
    assert np.abs(error[:2]).max() < 0.01
