# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses: the axioms of the group, hand-computed values, slerp against scipy's."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from heightmap25d_ros import se3
from heightmap25d_ros.pose_interpolation import interpolate

coordinates = st.floats(-1e3, 1e3)
angles = st.floats(-3.14, 3.14)
six = st.tuples(coordinates, coordinates, coordinates, angles, st.floats(-1.5, 1.5), angles)
poses = six.map(se3.from_xyz_rpy)
points = st.tuples(coordinates, coordinates, coordinates).map(np.array)


def close(a, b, tolerance=1e-9):
    return np.allclose(a, b, rtol=0.0, atol=tolerance)


@given(poses, poses, poses)
def test_composition_is_associative(a, b, c):
    assert close((a @ b) @ c, a @ (b @ c), 1e-8)


@given(poses)
def test_inverse_undoes_from_both_sides(pose):
    assert close(pose @ se3.inverse(pose), np.eye(4), 1e-8)
    assert close(se3.inverse(pose) @ pose, np.eye(4), 1e-8)
    assert close(se3.inverse(pose), np.linalg.inv(pose), 1e-8)


@given(poses, poses)
def test_composition_stays_a_rigid_motion(a, b):
    rotation = (a @ b)[:3, :3]
    assert close(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert (a @ b)[3].tolist() == [0.0, 0.0, 0.0, 1.0]


@given(poses, poses, points)
def test_points_are_carried_one_pose_after_the_other(a, b, point):
    twice = se3.transform_points(a, se3.transform_points(b, point))
    assert close(se3.transform_points(a @ b, point), twice, 1e-8)


@given(six)
def test_angles_round_trip(xyz_rpy):
    assert close(se3.to_xyz_rpy(se3.from_xyz_rpy(xyz_rpy)), xyz_rpy, 1e-6)


@given(six, six)
def test_angles_quaternions_and_products_are_scipys(a, b):
    one, other = Rotation.from_euler("xyz", a[3:]), Rotation.from_euler("xyz", b[3:])
    T = se3.compose(se3.from_xyz_rpy([a]), se3.from_xyz_rpy([b]))[0]
    assert close(T, se3.from_xyz_rpy(a) @ se3.from_xyz_rpy(b), 1e-8)
    assert close(T[:3, :3], (one * other).as_matrix())
    assert close(se3.to_quaternion(T), (one * other).as_quat(canonical=True), 1e-7)
    assert close(se3.from_quaternion(T[:3, 3], se3.to_quaternion(T)), T)


def test_straight_up_the_yaw_is_in_the_roll():
    for pitch in (np.pi / 2, -np.pi / 2):
        T = se3.from_xyz_rpy([1.0, 2.0, 3.0, 0.4, pitch, 0.3])
        angles = se3.to_xyz_rpy(T)
        assert angles[5] == 0.0
        assert close(se3.from_xyz_rpy(angles), T, 1e-7)


@given(poses)
def test_yaw_is_that_of_the_angles(pose):
    assert math.isclose(se3.yaw(pose), se3.to_xyz_rpy(pose)[5], abs_tol=1e-9)


@given(poses, st.floats(-3, 3))
def test_a_correction_shifts_a_pose_and_turns_it_on_the_spot(pose, yaw):
    corrected = se3.correction_about(pose, (1.0, -2.0, 0.5), yaw) @ pose
    np.testing.assert_allclose(corrected[:3, 3], pose[:3, 3] + (1.0, -2.0, 0.5), atol=1e-9)
    turned = Rotation.from_euler("z", yaw) * Rotation.from_matrix(pose[:3, :3])
    np.testing.assert_allclose(corrected[:3, :3], turned.as_matrix(), atol=1e-9)


@given(poses, st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))
def test_a_pose_is_tilted_where_it_is(pose, roll, pitch):
    tilted = se3.tilt_about(pose, (roll, pitch)) @ pose
    np.testing.assert_allclose(tilted[:3, 3], pose[:3, 3], atol=1e-9)
    turned = Rotation.from_euler("xy", [roll, pitch]) * Rotation.from_matrix(pose[:3, :3])
    np.testing.assert_allclose(tilted[:3, :3], turned.as_matrix(), atol=1e-9)


@given(poses)
def test_quaternions_round_trip(pose):
    back = se3.from_quaternion(pose[:3, 3], se3.to_quaternion(pose))
    assert close(back, pose)


def test_functions_take_stacks():
    stack = se3.from_xyz_rpy(np.arange(12.0).reshape(2, 6) / 10.0)
    assert stack.shape == (2, 4, 4)
    for one, pose in zip(np.arange(12.0).reshape(2, 6) / 10.0, stack, strict=True):
        assert close(pose, se3.from_xyz_rpy(one))
    assert close(se3.inverse(stack)[1], np.linalg.inv(stack[1]))


@pytest.mark.parametrize(
    ("rpy", "point", "expected"),
    [
        ((math.pi / 2, 0, 0), (0, 1, 0), (0, 0, 1)),  # roll: left goes up
        ((0, math.pi / 2, 0), (1, 0, 0), (0, 0, -1)),  # pitch: the nose goes down
        ((0, 0, math.pi / 2), (1, 0, 0), (0, 1, 0)),  # yaw: ahead turns to the left
        ((math.pi / 2, 0, math.pi / 2), (0, 1, 0), (0, 0, 1)),  # fixed axes: roll first
        ((0, math.pi / 2, math.pi / 2), (0, 1, 0), (-1, 0, 0)),
    ],
)
def test_angles_turn_as_in_rep_103(rpy, point, expected):
    pose = se3.from_xyz_rpy((10, 20, 30, *rpy))
    assert close(se3.transform_points(pose, np.array(point, float)), np.add((10, 20, 30), expected))


@pytest.mark.parametrize(
    ("quaternion", "rpy"),
    [
        ((0, 0, 0, 1), (0, 0, 0)),
        ((0, 0, math.sqrt(0.5), math.sqrt(0.5)), (0, 0, math.pi / 2)),
        ((math.sin(0.1), 0, 0, math.cos(0.1)), (0.2, 0, 0)),
        ((0, math.sin(-0.3), 0, math.cos(-0.3)), (0, -0.6, 0)),
        ((0, 0, 3.0, 3.0), (0, 0, math.pi / 2)),  # normalised
    ],
)
def test_quaternions_are_in_the_order_of_geometry_msgs(quaternion, rpy):
    assert close(se3.from_quaternion((1, 2, 3), quaternion), se3.from_xyz_rpy((1, 2, 3, *rpy)))


@pytest.mark.parametrize("quaternion", [(0, 0, 0, 0), (math.nan, 0, 0, 1), (0, 0, 0, math.inf)])
def test_what_is_no_rotation_is_refused(quaternion):
    with pytest.raises(ValueError, match=r"finite|norm"):
        se3.from_quaternion((0, 0, 0), quaternion)


def test_a_position_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="finite"):
        se3.from_quaternion((0, math.nan, 0), (0, 0, 0, 1))


@given(
    st.lists(poses, min_size=2, max_size=6),
    st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8),
    st.integers(0, 2_000_000_000),
    st.data(),
)
def test_interpolation_equals_scipys(knots, fractions, epoch_s, data):
    gaps = data.draw(st.lists(st.integers(1_000, 10**10), min_size=len(knots), max_size=len(knots)))
    stamps = epoch_s * 10**9 + np.cumsum(gaps)
    query = stamps[0] + np.rint(np.multiply(fractions, stamps[-1] - stamps[0])).astype(np.int64)
    got = interpolate(stamps, np.stack(knots), query)
    seconds, query_seconds = (stamps - stamps[0]) / 1e9, (query - stamps[0]) / 1e9
    rotations = Rotation.from_matrix(np.stack(knots)[:, :3, :3])
    steps = (rotations[:-1].inv() * rotations[1:]).magnitude()
    if steps.max() < math.pi - 1e-3:  # at half a turn both ways round are as short
        expected = Slerp(seconds, rotations)(query_seconds).as_matrix()
        assert close(got[:, :3, :3], expected, 1e-5)
    for axis in range(3):
        line = np.interp(query_seconds, seconds, np.stack(knots)[:, axis, 3])
        assert close(got[:, axis, 3], line, 1e-5)
    assert close(got[:, :3, :3] @ np.swapaxes(got[:, :3, :3], 1, 2), np.eye(3), 1e-9)


@given(st.lists(poses, min_size=1, max_size=5))
def test_interpolation_passes_through_its_poses(knots):
    stamps = 1_700_000_000_000_000_000 + 13_000_000 * np.arange(len(knots))
    assert close(interpolate(stamps, np.stack(knots), stamps), np.stack(knots), 1e-7)


@given(six, angles, st.floats(0.0, 1.0))
def test_slerp_turns_at_a_constant_rate_about_one_axis(start, yaw, fraction):
    T_a = se3.from_xyz_rpy(start)
    turn = 0.99 * yaw
    T_b = T_a @ se3.from_xyz_rpy((0, 0, 0, 0, 0, turn))
    stamps = np.array([0, 10**9])
    got = interpolate(stamps, np.stack([T_a, T_b]), [round(fraction * 10**9)])[0]
    part = se3.inverse(T_a) @ got
    assert close(se3.to_xyz_rpy(part)[3:], (0, 0, fraction * turn), 1e-6)


@given(poses, poses, poses, st.floats(0.0, 1.0))
def test_interpolation_does_not_depend_on_the_frame(frame, a, b, fraction):
    stamps, query = np.array([0, 10**9]), [round(fraction * 10**9)]
    turn = Rotation.from_matrix(a[:3, :3].T @ b[:3, :3]).magnitude()
    if turn < math.pi - 1e-3:
        moved = interpolate(stamps, np.stack([frame @ a, frame @ b]), query)
        assert close(moved, frame @ interpolate(stamps, np.stack([a, b]), query), 1e-6)


@pytest.mark.parametrize("query", [[99], [201], [150, 250]])
def test_nothing_is_extrapolated(query):
    with pytest.raises(ValueError, match="outside"):
        interpolate(np.array([100, 200]), np.stack([np.eye(4)] * 2), query)


def test_a_single_pose_holds_at_its_own_stamp():
    pose = se3.from_xyz_rpy((1, 2, 3, 0.1, 0.2, 0.3))
    got = interpolate(np.array([100]), pose[None], [100, 100])
    assert close(got, np.stack([pose, pose]))
