# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Error of a trajectory against the true one: absolute trajectory error, planar, z and yaw."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.pose_interpolation import interpolate

WRONG, SIGMAS = 0.15, 3.0
"""[m], and standard deviations: a pose that is off by more than both is confidently wrong."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryError:
    """Errors of estimated poses, without alignment: both trajectories are in the same frame.

    Attributes
    ----------
    poses : int
        Number of estimated poses within the time of the true trajectory.
    ate_rmse_m, ate_max_m : float [m]
        Absolute trajectory error: distance in x, y and z to the true position.
    final_position_m, planar_rmse_m, planar_max_m : float [m]
        Distance in x and y to the true position: of the last pose, and of all.
    final_yaw_deg, yaw_rmse_deg : float [deg]
    z_rmse_m : float [m]
    """

    poses: int
    ate_rmse_m: float
    ate_max_m: float
    final_position_m: float
    planar_rmse_m: float
    planar_max_m: float
    final_yaw_deg: float
    yaw_rmse_deg: float
    z_rmse_m: float

    def as_dict(self) -> dict[str, float]:
        """The figures by name, rounded to tenths of a millimetre."""
        return {name: round(value, 4) for name, value in asdict(self).items()}


def evaluate_trajectory(
    stamps_ns: NDArray[np.int64],
    poses: se3.Matrix,
    true_stamps_ns: NDArray[np.int64],
    true_poses: se3.Matrix,
) -> TrajectoryError | None:
    """Errors of poses (N, 4, 4) at their stamps [ns]; None if the truth covers none.

    Parameters
    ----------
    stamps_ns : (N,) int64 [ns]
    poses : (N, 4, 4) float64
    true_stamps_ns : (K,) int64 [ns], strictly increasing
    true_poses : (K, 4, 4) float64
        In the frame of ``poses``; interpolated at their stamps.
    """
    covered = (stamps_ns >= true_stamps_ns[0]) & (stamps_ns <= true_stamps_ns[-1])
    if not covered.any():
        return None
    poses = poses[covered]
    truth = interpolate(true_stamps_ns, true_poses, stamps_ns[covered])
    distance = np.linalg.norm(poses[:, :3, 3] - truth[:, :3, 3], axis=1)
    planar, z, yaw = planar_errors(poses, truth).T
    return TrajectoryError(
        poses=len(poses),
        ate_rmse_m=_rms(distance),
        ate_max_m=float(distance.max()),
        final_position_m=float(planar[-1]),
        planar_rmse_m=_rms(planar),
        planar_max_m=float(planar.max()),
        final_yaw_deg=float(abs(yaw[-1])),
        yaw_rmse_deg=_rms(yaw),
        z_rmse_m=_rms(z),
    )


def alignment(poses: se3.Matrix, truth: se3.Matrix) -> se3.Matrix:
    """The shift and the yaw (4, 4) that bring positions of poses nearest to the true ones.

    Horn's closed form in the plane, as for the ATE of the TUM benchmark (Sturm et al., 2012); z is
    shifted by the mean difference.

    Parameters
    ----------
    poses, truth : (N, 4, 4) float64
        Of the same moments.
    """
    mean, true_mean = poses[:, :3, 3].mean(axis=0), truth[:, :3, 3].mean(axis=0)
    a, b = (poses[:, :3, 3] - mean)[:, :2], (truth[:, :3, 3] - true_mean)[:, :2]
    turn = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    T = se3.from_xyz_rpy([0.0, 0.0, 0.0, 0.0, 0.0, float(turn)])
    T[:3, 3] = true_mean - T[:3, :3] @ mean
    return T


def planar_errors(poses: se3.Matrix, truth: se3.Matrix) -> NDArray[np.float64]:
    """(N, 3): of each pose the distance in x and y [m], error of z [m], error of the yaw [deg]."""
    offset = poses[:, :3, 3] - truth[:, :3, 3]
    yaw = se3.to_xyz_rpy(poses)[:, 5] - se3.to_xyz_rpy(truth)[:, 5]
    yaw = np.degrees((yaw + np.pi) % (2 * np.pi) - np.pi)
    return np.column_stack([np.hypot(offset[:, 0], offset[:, 1]), offset[:, 2], yaw])


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def confidently_wrong(
    poses: se3.Matrix, truth: se3.Matrix, covariances: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(N,): whether poses are off by more than `WRONG`, and than their covariances allow.

    That is `SIGMAS` standard deviations of x, y (N, 2, 2) [m^2].
    """
    off = (poses - truth)[:, :2, 3]
    squared = np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariances), off)
    return np.asarray((squared > SIGMAS**2) & (np.hypot(*off.T) > WRONG))
