# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses as elements of SE(3): 4x4 matrices, ``p_map = T_map_base @ p_base``.

All functions take and return stacks, shape (..., 4, 4) float64 [m]. Roll, pitch and yaw are
REP-103's fixed-axis angles [rad]; quaternions are (x, y, z, w) as in geometry_msgs.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heightmap25d_ros.kernels import inlined_kernel, kernel

Matrix = NDArray[np.float64]


def from_quaternion(position: ArrayLike, quaternion: ArrayLike) -> Matrix:
    """Pose from a position (..., 3) [m] and a quaternion (..., 4), normalised here.

    Raises
    ------
    ValueError
        If a quaternion has norm zero or a value is not finite.
    """
    position, quaternion = _stack(position, 3), _stack(quaternion, 4)
    result = np.zeros((*position.shape[:-1], 4, 4))
    flat = position.reshape(-1, 3), quaternion.reshape(-1, 4), result.reshape(-1, 4, 4)
    if not _from_quaternions(*flat):
        raise ValueError("a pose holds a value that is not finite, or a quaternion of norm zero")
    return result


def from_xyz_rpy(xyz_rpy: ArrayLike) -> Matrix:
    """Pose from (..., 6): x, y, z [m], roll, pitch, yaw [rad]."""
    values = _stack(xyz_rpy, 6)
    result = np.zeros((*values.shape[:-1], 4, 4))
    _from_xyz_rpy(values.reshape(-1, 6), result.reshape(-1, 4, 4))
    return result


def to_xyz_rpy(pose: Matrix) -> Matrix:
    """(..., 6): x, y, z [m], roll, pitch, yaw [rad] of a pose.

    Straight up or down the yaw, which the roll is then one with, is 0.
    """
    result = np.empty((*pose.shape[:-2], 6))
    _to_xyz_rpy(_matrices(pose), result.reshape(-1, 6))
    return result


def to_quaternion(pose: Matrix) -> Matrix:
    """(..., 4): the rotation as x, y, z, w, of which w is not negative."""
    result = np.empty((*pose.shape[:-2], 4))
    _to_quaternions(_matrices(pose), result.reshape(-1, 4))
    return result


def compose(T_a_b: Matrix, T_b_c: Matrix) -> Matrix:
    """``T_a_c``, (N, 4, 4), of two stacks (N, 4, 4) or (1, 4, 4): ``@``, faster for many."""
    result = np.empty((max(len(T_a_b), len(T_b_c)), 4, 4))
    _compose(_matrices(T_a_b), _matrices(T_b_c), result)
    return result


def yaw(pose: Matrix) -> float:
    """The yaw [rad] of one pose (4, 4), as of `to_xyz_rpy`."""
    return float(np.arctan2(pose[1, 0], pose[0, 0]))


def inverse(pose: Matrix) -> Matrix:
    """``T_b_a`` of ``T_a_b``."""
    result = np.empty(pose.shape)
    _invert(_matrices(pose), result.reshape(-1, 4, 4))
    return result


def transform_points(pose: Matrix, points: Matrix) -> Matrix:
    """Points (..., 3) [m] transformed by a pose (..., 4, 4)."""
    return np.asarray(np.einsum("...ij,...j->...i", pose[..., :3, :3], points) + pose[..., :3, 3])


def correction_about(pose: Matrix, shift: ArrayLike, yaw: float) -> Matrix:
    """The motion (4, 4) that shifts a pose (4, 4) by (3,) [m] and turns it by a yaw [rad]."""
    turn = from_xyz_rpy([0.0, 0.0, 0.0, 0.0, 0.0, yaw])
    position = pose[:3, 3]
    turn[:3, 3] = position - turn[:3, :3] @ position + np.asarray(shift)
    return turn


def tilt_about(pose: Matrix, tilt: ArrayLike) -> Matrix:
    """The motion (4, 4) that tilts a pose (4, 4), where it is, by (2,) [rad] about x and y."""
    turn = from_xyz_rpy([0.0, 0.0, 0.0, *np.asarray(tilt), 0.0])
    turn[:3, 3] = pose[:3, 3] - turn[:3, :3] @ pose[:3, 3]
    return turn


def _stack(values: ArrayLike, size: int) -> Matrix:
    """Numbers (..., size) as kernels take them."""
    stack = np.ascontiguousarray(values, dtype=np.float64)
    if stack.shape[-1:] != (size,):
        raise ValueError(f"shape {stack.shape}, not (..., {size})")
    return stack


def _matrices(pose: Matrix) -> Matrix:
    """Poses (..., 4, 4) as (N, 4, 4), as kernels take them."""
    return np.ascontiguousarray(pose, dtype=np.float64).reshape(-1, 4, 4)


@kernel
def _from_quaternions(positions, quaternions, poses):
    """Whether all are finite and none has norm zero."""
    for i in range(len(poses)):
        x, y, z, w = quaternions[i]
        norm = math.sqrt(x * x + y * y + z * z + w * w)
        size = norm + abs(positions[i, 0]) + abs(positions[i, 1]) + abs(positions[i, 2])
        if not (norm > 0.0 and size < np.inf):
            return False
        _put(poses[i], positions[i], x / norm, y / norm, z / norm, w / norm)
    return True


@kernel
def _from_xyz_rpy(values, poses):
    """Half-angle quaternions of yaw, pitch and roll, multiplied in this order."""
    for i in range(len(poses)):
        sx, cx = math.sin(values[i, 3] / 2.0), math.cos(values[i, 3] / 2.0)
        sy, cy = math.sin(values[i, 4] / 2.0), math.cos(values[i, 4] / 2.0)
        sz, cz = math.sin(values[i, 5] / 2.0), math.cos(values[i, 5] / 2.0)
        x, y, z, w = cy * sx, sy * cx, -sy * sx, cy * cx
        _put(
            poses[i], values[i], cz * x - sz * y, cz * y + sz * x, cz * z + sz * w, cz * w - sz * z
        )


@inlined_kernel
def _put(pose, position, x, y, z, w):
    """A pose from a position and a unit quaternion."""
    pose[0, 0], pose[1, 1] = x * x - y * y - z * z + w * w, -x * x + y * y - z * z + w * w
    pose[2, 2] = -x * x - y * y + z * z + w * w
    pose[0, 1], pose[1, 0] = 2.0 * (x * y - z * w), 2.0 * (x * y + z * w)
    pose[0, 2], pose[2, 0] = 2.0 * (x * z + y * w), 2.0 * (x * z - y * w)
    pose[1, 2], pose[2, 1] = 2.0 * (y * z - x * w), 2.0 * (y * z + x * w)
    for axis in range(3):
        pose[axis, 3] = position[axis]
    pose[3, 3] = 1.0


@kernel
def _to_xyz_rpy(poses, values):
    for i in range(len(poses)):
        m = poses[i]
        level = math.hypot(m[0, 0], m[1, 0])
        is_upright = level < 1e-7
        for axis in range(3):
            values[i, axis] = m[axis, 3]
        values[i, 3] = math.atan2(-m[1, 2], m[1, 1]) if is_upright else math.atan2(m[2, 1], m[2, 2])
        values[i, 4] = math.atan2(-m[2, 0], level)
        values[i, 5] = 0.0 if is_upright else math.atan2(m[1, 0], m[0, 0])


@kernel
def _to_quaternions(poses, quaternions):
    for i in range(len(poses)):
        quaternions[i] = quaternion_of(poses[i])


@kernel
def quaternion_of(m):
    """(x, y, z, w), of which w is not negative, of a rotation or pose, by Shepperd's method.

    A kernel for kernels.
    """
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    q = np.empty(4)
    i = 0
    for j in range(1, 3):
        if m[j, j] > m[i, i]:
            i = j
    if trace > m[i, i]:
        q[0], q[1], q[2] = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
        q[3] = 1.0 + trace
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q[i] = 1.0 - trace + 2.0 * m[i, i]
        q[j], q[k] = m[j, i] + m[i, j], m[k, i] + m[i, k]
        q[3] = m[k, j] - m[j, k]
    q /= math.sqrt((q * q).sum())
    return -q if q[3] < 0.0 else q


@kernel
def _invert(poses, result):
    for i in range(len(poses)):
        pose, inverted = poses[i], result[i]
        for row in range(3):
            for column in range(3):
                inverted[row, column] = pose[column, row]
            inverted[row, 3] = -(
                pose[0, row] * pose[0, 3] + pose[1, row] * pose[1, 3] + pose[2, row] * pose[2, 3]
            )
            inverted[3, row] = 0.0
        inverted[3, 3] = 1.0


@kernel
def _compose(first, second, result):
    first_step, second_step = min(len(first) - 1, 1), min(len(second) - 1, 1)
    for i in range(len(result)):
        a, b = first[i * first_step], second[i * second_step]
        for row in range(3):
            for column in range(4):
                result[i, row, column] = (
                    a[row, 0] * b[0, column] + a[row, 1] * b[1, column] + a[row, 2] * b[2, column]
                )
            result[i, row, 3] += a[row, 3]
            result[i, 3, row] = 0.0
        result[i, 3, 3] = 1.0
