# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Keyframes of drives in a room, of which the truth is known and the odometry drifts."""

import itertools

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.slam.bundle import Keyframe

LASER = 0.3, 0.0, 0.6  # in base_link


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
        keyframe_of(k, odom, se3.transform_points(odom @ se3.inverse(T), points_of()))
        for k, (T, odom) in enumerate(zip(true, T_odom_base, strict=True))
    ]


def keyframe_of(number, T_odom_base, returns, edges=()):
    laser = se3.transform_points(T_odom_base, [[*LASER]])
    returns, origins = np.broadcast_arrays(returns.astype(np.float32), laser.astype(np.float32))
    edges = np.reshape(edges, (-1, 3)).astype(np.float32)
    return Keyframe(number, 0, np.eye(4), T_odom_base, np.eye(4), returns, origins, edges)


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
