# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses as elements of SE(3): 4x4 matrices, ``p_map = T_map_base @ p_base``.

All functions take and return stacks, shape (..., 4, 4) float64 [m]. Roll, pitch and yaw are
REP-103's fixed-axis angles [rad]; quaternions are (x, y, z, w) as in geometry_msgs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Matrix = NDArray[np.float64]


def from_rotation(position: ArrayLike, rotation: Rotation) -> Matrix:
    """Pose from a position (..., 3) [m] and a scipy rotation of the same stack shape."""
    position = np.asarray(position, dtype=np.float64)
    pose = np.zeros((*position.shape[:-1], 4, 4))
    pose[..., :3, :3] = rotation.as_matrix()
    pose[..., :3, 3] = position
    pose[..., 3, 3] = 1.0
    return pose


def from_quaternion(position: ArrayLike, quaternion: ArrayLike) -> Matrix:
    """Pose from a position (..., 3) [m] and a quaternion (..., 4), normalised here.

    Raises
    ------
    ValueError
        If a quaternion has norm zero or a value is not finite.
    """
    position = np.asarray(position, dtype=np.float64)
    quaternion = np.asarray(quaternion, dtype=np.float64)
    if not (np.isfinite(position).all() and np.isfinite(quaternion).all()):
        raise ValueError("a pose holds a value that is not finite")
    return from_rotation(position, Rotation.from_quat(quaternion))


def from_xyz_rpy(xyz_rpy: ArrayLike) -> Matrix:
    """Pose from (..., 6): x, y, z [m], roll, pitch, yaw [rad]."""
    xyz_rpy = np.asarray(xyz_rpy, dtype=np.float64)
    return from_rotation(xyz_rpy[..., :3], Rotation.from_euler("xyz", xyz_rpy[..., 3:]))


def to_xyz_rpy(pose: Matrix) -> Matrix:
    """(..., 6): x, y, z [m], roll, pitch, yaw [rad] of a pose."""
    angles = Rotation.from_matrix(pose[..., :3, :3]).as_euler("xyz")
    return np.concatenate([pose[..., :3, 3], angles], axis=-1)


def to_quaternion(pose: Matrix) -> Matrix:
    """(..., 4): the rotation as x, y, z, w."""
    return np.asarray(Rotation.from_matrix(pose[..., :3, :3]).as_quat(), dtype=np.float64)


def yaw(pose: Matrix) -> float:
    """The yaw [rad] of one pose (4, 4), as of `to_xyz_rpy`."""
    return float(np.arctan2(pose[1, 0], pose[0, 0]))


def inverse(pose: Matrix) -> Matrix:
    """``T_b_a`` of ``T_a_b``."""
    rotation_inverse = np.swapaxes(pose[..., :3, :3], -1, -2)
    result = np.zeros_like(pose)
    result[..., :3, :3] = rotation_inverse
    result[..., :3, 3] = -np.einsum("...ij,...j->...i", rotation_inverse, pose[..., :3, 3])
    result[..., 3, 3] = 1.0
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
