# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses and surface refined together, against drives of which the truth is known."""

import itertools

import numpy as np
import pytest

from heightmap25d_ros import se3
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam import bundle
from heightmap25d_ros.slam.bundle import Keyframe, refined
from heightmap25d_ros.slam.patches import STATES, NormalEquations, add_patches

PARAMS = Params().scan_filter


def room(rng, count):
    """Returns (N, 3) of four walls, a box and the floor."""
    along, height = rng.uniform(-4, 4, (5, count)), rng.uniform(0.1, 1.0, (5, count))
    side, other = np.full(count, 4.0), np.full(count, -4.0)
    walls = [
        np.column_stack(columns) for columns in (
            (side, along[0], height[0]), (other, along[1], height[1]),
            (along[2], side, height[2]), (along[3], other, height[3]),
        )
    ]  # fmt: skip
    box = np.column_stack([np.full(count, 0.6), along[4] / 8, height[4]])
    floor = np.column_stack([rng.uniform(-4, 4, (6 * count, 2)), np.zeros(6 * count)])
    points = np.concatenate([*walls, box, floor])
    return points + rng.normal(0.0, 0.005, points.shape)


def circle(count, radius=2.0):
    """Poses (N, 4, 4) along most of a circle."""
    angle = np.linspace(0.0, 5.0, count)
    zero = np.zeros(count)
    return se3.from_xyz_rpy(np.column_stack([
        radius * np.sin(angle), -radius * np.cos(angle), zero, zero, zero, angle
    ]))  # fmt: skip


def drifting(true, slip, bias):
    """Odometry that takes every step too long, and turns aside on the way."""
    found = [true[0]]
    for before, after in itertools.pairwise(true):
        step = se3.inverse(before) @ after
        step[:3, 3] *= 1.0 + slip
        aside = se3.from_xyz_rpy([0, 0, 0, 0, 0, bias * np.linalg.norm(step[:3, 3])])
        found.append(found[-1] @ step @ aside)
    return np.array(found)


def keyframes_of(true, T_odom_base, points_of):
    return [
        Keyframe(k, 0, np.eye(4), odom,
                 se3.transform_points(odom @ se3.inverse(T), points_of()).astype(np.float32))
        for k, (T, odom) in enumerate(zip(true, T_odom_base, strict=True))
    ]  # fmt: skip


def drive(seed, count=40, tilt=0.0):
    """True poses, and keyframes whose odometry drifts and errs in roll and pitch [rad]."""
    rng = np.random.default_rng(seed)
    true = circle(count)
    odometry = drifting(true, 0.03, 0.02)
    tilts = rng.normal(0.0, tilt, (count, 2))
    poses = se3.to_xyz_rpy(odometry)
    wrong = se3.from_xyz_rpy(np.column_stack([np.zeros((count, 3)), tilts, np.zeros(count)]))
    odometry = se3.from_xyz_rpy(np.column_stack([poses[:, :3], np.zeros((count, 3))])) @ wrong
    odometry = odometry @ se3.from_xyz_rpy(np.pad(poses[:, 5:], ((0, 0), (5, 0))))
    return true, keyframes_of(true, odometry, lambda: room(rng, 40)), tilts


def away(found, true, keyframes):
    bases = found.T_map_odom @ np.array([k.T_odom_base for k in keyframes])
    return np.linalg.norm((bases - true)[:, :2, 3], axis=1)


def test_a_bent_drive_is_straightened():
    true, keyframes, _ = drive(1)
    unmoved = np.broadcast_to(np.eye(4), (len(true), 4, 4))
    assert (
        away(bundle.Refined(unmoved, np.zeros(2), np.zeros((0, 4, 4))), true, keyframes).max()
        > 0.15
    )
    found = refined(keyframes, unmoved, PARAMS)
    assert away(found, true, keyframes).max() < 0.01
    turned = se3.to_xyz_rpy(found.T_map_odom)[:, 3:5]
    np.testing.assert_allclose(turned, 0.0, atol=1e-9)


def test_roll_and_pitch_are_found():
    _, keyframes, tilts = drive(2, tilt=PARAMS.tilt_noise)
    unmoved = np.broadcast_to(np.eye(4), (len(tilts), 4, 4))
    found = refined(keyframes, unmoved, PARAMS)
    assert np.std(found.tilts + tilts) < 0.4 * np.std(tilts)


def test_a_long_drive_is_refined_in_stretches(monkeypatch):
    true, keyframes, _ = drive(3)
    unmoved = np.broadcast_to(np.eye(4), (len(true), 4, 4))
    monkeypatch.setattr(bundle, "WINDOW", 24)
    monkeypatch.setattr(bundle, "_OVERLAP", 8)
    found = refined(keyframes, unmoved, PARAMS)
    assert away(found, true, keyframes).max() < 0.05
    steps = np.diff(se3.to_xyz_rpy(found.T_map_odom), axis=0)
    assert np.abs(steps[:, :3]).max() < 0.02  # nothing jumps where stretches meet


def test_rows_that_a_level_laser_sees_on_a_slope_do_not_hold_the_robot():
    """The row goes up the slope as the robot rises, and looks like a wall from each place."""
    rng = np.random.default_rng(4)
    count, slope = 30, np.tan(0.35)
    x = np.linspace(0.0, 3.0, count)
    height = np.linspace(0.0, 0.5, count)  # of a ramp, which is not seen
    true = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    true[:, 0, 3], true[:, 2, 3] = x, height
    sides = (np.column_stack([rng.uniform(-1, 8, 60), np.full(60, y), rng.uniform(0, 1, 60)])
             for y in (-3.0, 3.0))  # fmt: skip
    walls = np.concatenate(list(sides))
    rows = iter(height)

    def points():
        level = next(rows) + rng.normal(0.0, 0.005, 60)
        row = np.column_stack([4.0 + level / slope, rng.uniform(-2, 2, 60), level])
        return np.concatenate([walls, row])

    keyframes = keyframes_of(true, true, points)
    found = refined(keyframes, np.broadcast_to(np.eye(4), true.shape), PARAMS)
    assert away(found, true, keyframes).max() < 0.02


def test_along_a_corridor_the_odometry_alone_tells_how_far_it_went():
    """Its variance over a distance in closed form: slip comes and goes, a scale stays."""
    rng = np.random.default_rng(6)
    count, distance = 30, 6.0
    true = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    true[:, 0, 3] = np.linspace(0.0, distance, count)

    def points():
        sides = [np.column_stack([rng.uniform(-4, 10, 150), np.full(150, y),
                                  rng.uniform(0.1, 1, 150)]) for y in (-1.2, 1.2)]  # fmt: skip
        return np.concatenate(sides)

    unmoved = np.broadcast_to(np.eye(4), true.shape)
    found = refined(keyframes_of(true, true, points), unmoved, PARAMS, [0, count - 1])
    lasts = PARAMS.slip_length
    slipped = lasts * (distance / lasts - 1.0 + np.exp(-distance / lasts))
    variance = (
        2.0 * lasts * PARAMS.slip**2 * slipped
        + (PARAMS.distance_scale * distance) ** 2
        + PARAMS.position_drift**2 * distance
    )
    deviation = np.sqrt(np.diagonal(found.covariances[0]))
    assert deviation[0] == pytest.approx(np.sqrt(variance), rel=0.1)
    assert (deviation[1:3] < 0.01).all()


@pytest.mark.parametrize("state", range(4))
def test_returns_tell_nothing_of_what_all_poses_have_in_common(state):
    """Moved or turned as a whole, poses and surface fit as before."""
    rng = np.random.default_rng(5)
    true = circle(6)
    seen = [room(rng, 200) - T[:3, 3] for T in true]
    size = STATES * len(true)
    equations = NormalEquations(np.zeros((size, size)), np.zeros(size))
    pose_of = np.repeat(np.arange(len(true)), [len(points) for points in seen])
    patches = add_patches(np.concatenate(seen), true[:, :3, 3].copy(), pose_of, 1.0, 0.1, equations)
    assert patches > 50
    motion = np.zeros((len(true), STATES))
    motion[:, state] = 1.0
    if state == 2:  # x, y, yaw, z
        motion[:, 0], motion[:, 1] = -true[:, 1, 3], true[:, 0, 3]
    whole = np.triu(equations.matrix) + np.triu(equations.matrix, 1).T
    told, alone = motion.ravel() @ whole @ motion.ravel(), np.diag(whole)[state::STATES].sum()
    assert 0.0 <= told < 1e-3 * alone
    assert np.linalg.eigvalsh(whole)[0] > -1e-6 * np.linalg.eigvalsh(whole)[-1]
