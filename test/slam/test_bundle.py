# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses and surface refined together, against drives of which the truth is known."""

import numpy as np
import pytest
from bent_drives import LASER, circle, drive, keyframe_of, keyframes_of, room

from heightmap25d_ros import se3
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam import bundle
from heightmap25d_ros.slam.bundle import refined
from heightmap25d_ros.slam.contacts import contacts_of
from heightmap25d_ros.slam.patches import STATES, NormalEquations, Returns, add_patches

PARAMS = Params().scan_filter


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


@pytest.mark.parametrize("count", [2, 3, 4])
def test_a_drive_of_a_few_keyframes_is_refined(count):
    true, keyframes, _ = drive(11, count=80)
    unmoved = np.broadcast_to(np.eye(4), (count, 4, 4))
    found = refined(keyframes[:count], unmoved, PARAMS, [0, count - 1])
    assert away(found, true[:count], keyframes[:count]).max() < 0.02
    assert np.isfinite(found.covariances).all()


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


def test_stretches_that_are_not_bent_are_not_refined_again(monkeypatch):
    """Neither as they were, nor turned and moved as a whole; one that is bent is."""
    true, keyframes, _ = drive(3)
    unmoved = np.broadcast_to(np.eye(4), (len(true), 4, 4))
    marks = [0, 20, 39]
    known = refined(keyframes, unmoved, PARAMS, marks)
    whole = se3.from_xyz_rpy([0.5, -0.2, 0.0, 0.0, 0.0, 0.1]) @ known.T_map_odom
    with monkeypatch.context() as context:
        context.setattr(bundle, "_solved", None)
        again = refined(keyframes, whole, PARAMS, marks, known)
    np.testing.assert_allclose(again.T_map_odom, whole, atol=1e-12)
    np.testing.assert_array_equal(again.covariances, known.covariances)
    np.testing.assert_array_equal(again.tilts, known.tilts)
    bent = refined(keyframes, unmoved, PARAMS, marks, known)
    np.testing.assert_allclose(bent.T_map_odom, known.T_map_odom, atol=1e-12)


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


def test_one_crate_that_a_level_laser_sees_tells_of_wheels_that_slip_by_a_third():
    """By what poses err, its face is smeared into what looks like level ground at laser height."""
    rng, count = np.random.default_rng(9), 30
    true = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    true[:, 0, 3] = np.linspace(0.0, 2.4, count)
    odometry = true.copy()
    odometry[:, 0, 3] *= 0.67

    def points():
        sides = np.column_stack([rng.uniform(-1, 8, 60), rng.choice([-3.0, 3.0], 60)])
        face = np.column_stack([np.full(40, 3.5), rng.uniform(-0.4, 0.4, 40)])
        level = np.concatenate([sides, face])
        at = np.column_stack([level, np.full(len(level), LASER[2])])
        return at + rng.normal(0.0, [0.005, 0.005, 0.002], at.shape)

    keyframes = keyframes_of(true, odometry, points)
    found = refined(keyframes, np.broadcast_to(np.eye(4), true.shape), PARAMS)
    assert away(found, true, keyframes).max() < 0.03


def test_along_a_corridor_the_jambs_of_a_door_tell_how_far_the_robot_came():
    """Wheels slip by a tenth, and nothing else is seen but two smooth walls."""
    rng, count = np.random.default_rng(10), 30
    true = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    true[:, 0, 3] = np.linspace(0.0, 2.4, count)
    odometry = true.copy()
    odometry[:, 0, 3] *= 0.9
    jambs = np.array([(2.0, 1.2, 0.6), (2.9, 1.2, 0.6)])
    keyframes = []
    for k in range(count):
        walls = np.column_stack([rng.uniform(-4, 8, 200), rng.choice([-1.2, 1.2], 200)])
        seen = np.column_stack([walls, np.full(200, 0.6)]) + rng.normal(0.0, 0.005, (200, 3))
        edges = jambs + rng.normal(0.0, [0.01, 0.01, 0.0], (2, 3))
        back = odometry[k] @ se3.inverse(true[k])
        parts = (se3.transform_points(back, points) for points in (seen, edges))
        keyframes.append(keyframe_of(k, odometry[k], *parts))
    unmoved = np.broadcast_to(np.eye(4), true.shape)
    blind = [keyframe._replace(edges=keyframe.edges[:0]) for keyframe in keyframes]
    assert away(refined(blind, unmoved, PARAMS), true, keyframes).max() > 0.1
    assert away(refined(keyframes, unmoved, PARAMS), true, keyframes).max() < 0.02


def rows_ahead(true, ground, rng, noise):
    """Rows that a laser which looks down sees of ground(x), with noise of their ranges."""
    for T in true:
        laser = T[:3, 3] + LASER
        way = np.linspace(0.5, 2.5, 2001)
        x = np.interp(0.0, laser[2] - 0.5 * way - ground(laser[0] + way), laser[0] + way)
        ends = np.column_stack([np.full(60, x), np.linspace(-1, 1, 60), np.full(60, ground(x))])
        beams = ends - laser
        length = np.linalg.norm(beams, axis=1)
        yield laser + beams * (1.0 + rng.normal(0.0, noise, 60) / length)[:, None]


def test_noise_of_ranges_does_not_draw_poses_together():
    """Beams that graze the ground: what is too far is too low. As if they were upright it does."""
    count, pulls = 25, []
    true = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    true[:, 0, 3] = np.linspace(0.0, 2.0, count)
    pose_of = np.repeat(np.arange(count), 60)
    for seed in range(4):
        rows = rows_ahead(true, lambda x: -0.1 * x, np.random.default_rng(seed), 0.02)
        seen = np.concatenate([row - T[:3, 3] for row, T in zip(rows, true, strict=True)])
        aimed = (seen - LASER) / np.linalg.norm(seen - LASER, axis=1)[:, None]
        for beams in (aimed, np.tile([0.0, 0.0, -1.0], (len(seen), 1))):
            size = STATES * (count + 1)
            equations = NormalEquations.zero(size)
            returns = Returns(seen, beams, pose_of, np.zeros(len(seen), np.bool_))
            add_patches(returns, true[:, :3, 3].copy(), 1.0, 0.1, equations)
            pulls.append(equations.gradient[: STATES * count : STATES] @ true[:, 0, 3])
    aimed, upright = np.mean(np.reshape(pulls, (-1, 2)), axis=0)
    assert abs(aimed) < 0.05 * upright


def along_a_thin_wall(rng, side, heights):
    """What a robot sees of the face of a wall 0.1 m thick, on either side of it, from 5 poses."""
    positions = np.column_stack([np.linspace(-1.0, 1.0, 5), np.full(5, 2.0 * side), np.zeros(5)])
    x, z = rng.uniform(-1.0, 1.0, (5, 300)), rng.uniform(*heights, (5, 300))
    y = np.full((5, 300), 0.05 * side) + rng.normal(0.0, 0.005, (5, 300))
    return positions, np.stack([x, y, z], axis=2) - positions[:, None]


@pytest.mark.parametrize("heights", [(0.1, 0.12), (-1.0, 1.0)])  # of a row, of all of it
def test_the_faces_of_a_thin_wall_do_not_hold_one_another(heights):
    """As one surface they would draw poses together that are on either side of it."""
    rng = np.random.default_rng(9)
    sides = [along_a_thin_wall(rng, side, heights) for side in (-1.0, 1.0)]
    positions, seen = (np.concatenate(part) for part in zip(*sides, strict=True))
    seen, pose_of = seen.reshape(-1, 3), np.repeat(np.arange(10), 300)
    beams = seen / np.linalg.norm(seen, axis=1)[:, None]
    equations = NormalEquations.zero(STATES * 11)
    returns = Returns(seen, beams, pose_of, np.zeros(len(seen), np.bool_))
    add_patches(returns, positions, 1.0, 0.1, equations)
    nearer = np.zeros(len(equations.gradient))
    nearer[1 : 5 * STATES : STATES] = 1.0  # all poses on one side, along y
    upper = np.triu(equations.matrix)
    stiffness = nearer @ (upper + np.triu(upper, 1).T) @ nearer
    held = np.diag(equations.matrix) @ nearer  # by the wall, each for itself
    assert held > 1e6
    assert stiffness < 1e-3 * held
    assert abs(equations.gradient @ nearer) < 1e-4 * held


def on_a_slope(height):
    """Poses (20, 4, 4) on z = 0.2 x, with base_link at a height above it."""
    poses = np.zeros((20, 6))
    poses[:, 0], poses[:, 4] = np.linspace(0.0, 2.0, 20), -np.arctan(0.2)
    poses[:, 2] = 0.2 * poses[:, 0]
    return se3.from_xyz_rpy(poses) @ se3.from_xyz_rpy([0.0, 0.0, height, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("height", [0.0, 0.13])
def test_wheels_are_on_the_ground_that_was_seen(height):
    xy = np.random.default_rng(6).uniform((-1, -1), (3, 1), (20000, 2))
    T_map_base = on_a_slope(height)
    contacts = contacts_of(np.column_stack([xy, 0.2 * xy[:, 0]]), T_map_base)
    at = contacts.seen + T_map_base[contacts.pose_of, :3, 3]
    assert len(np.unique(contacts.pose_of)) == 20
    np.testing.assert_allclose(at[:, 2], 0.2 * at[:, 0], atol=0.008)
    np.testing.assert_allclose(contacts.beams @ [-0.2, 0.0, 1.0], -np.hypot(1.0, 0.2))


def test_without_ground_nothing_bears_the_robot():
    """As for level lasers: walls beside the way, and returns far below it."""
    xy = np.random.default_rng(7).uniform((-1, -1), (3, 1), (20000, 2))
    walls = np.column_stack([xy[:, 0], np.sign(xy[:, 1]), xy[:, 0]])
    below = np.column_stack([xy, np.full(len(xy), -2.0)])
    assert len(contacts_of(np.concatenate([walls, below]), on_a_slope(0.0)).seen) == 0


def test_the_height_above_the_ground_is_found():
    """Wheels that seem to stand 1 cm above the ground are lowered, and nothing else is moved."""
    rng = np.random.default_rng(8)
    ground = np.column_stack([rng.uniform(-1, 1, (3000, 2)), np.zeros(3000)])
    wheels = np.column_stack([rng.uniform(-1, 1, (300, 2)), np.full(300, 0.01)])
    seen, is_contact = np.concatenate([ground, wheels]), np.repeat([False, True], [3000, 300])
    down = np.tile([0.0, 0.0, -1.0], (3300, 1))
    equations = NormalEquations.zero(3 * STATES)
    returns = Returns(seen, down, rng.integers(0, 2, 3300), is_contact)
    add_patches(returns, np.zeros((2, 3)), 1.0, 0.1, equations)
    height = 2 * STATES
    lowered = -equations.gradient[height] / equations.matrix[height, height]
    np.testing.assert_allclose(lowered, 0.01, rtol=0.02)


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
    size = STATES * (len(true) + 1)
    equations = NormalEquations.zero(size)
    pose_of = np.repeat(np.arange(len(true)), [len(points) for points in seen])
    seen = np.concatenate(seen)
    beams = seen / np.linalg.norm(seen, axis=1)[:, None]
    returns = Returns(seen, beams, pose_of, np.zeros(len(seen), np.bool_))
    assert add_patches(returns, true[:, :3, 3].copy(), 1.0, 0.1, equations) > 50
    motion = np.zeros((len(true), STATES))
    motion[:, state] = 1.0
    if state == 2:  # x, y, yaw, z
        motion[:, 0], motion[:, 1] = -true[:, 1, 3], true[:, 0, 3]
    whole = np.triu(equations.matrix) + np.triu(equations.matrix, 1).T
    whole = whole[: motion.size, : motion.size]
    told, alone = motion.ravel() @ whole @ motion.ravel(), np.diag(whole)[state::STATES].sum()
    assert 0.0 <= told < 1e-3 * alone
    assert np.linalg.eigvalsh(whole)[0] > -1e-6 * np.linalg.eigvalsh(whole)[-1]
