# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses between poses, for each beam of a scan at its own time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.se3 import Matrix


def interpolate(stamps_ns: NDArray[np.int64], poses: Matrix, query_ns: ArrayLike) -> Matrix:
    """Poses between poses: position linearly, orientation by slerp.

    Parameters
    ----------
    stamps_ns : (K,) int64 [ns], strictly increasing
    poses : (K, 4, 4) float64
    query_ns : (N,) int64 [ns], inside ``[stamps_ns[0], stamps_ns[-1]]``

    Returns
    -------
    (N, 4, 4) float64

    Raises
    ------
    ValueError
        If a query lies outside of the stamps: poses are never extrapolated.
    """
    query = np.asarray(query_ns, dtype=np.int64)
    if query.min() < stamps_ns[0] or query.max() > stamps_ns[-1]:
        raise ValueError("a pose was requested outside of the known stamps")
    if len(stamps_ns) == 1:
        return np.broadcast_to(poses[0], (len(query), 4, 4)).copy()
    segment = np.clip(np.searchsorted(stamps_ns, query, side="right") - 1, 0, len(stamps_ns) - 2)
    # Integers until the difference is taken: nanoseconds since 1970 do not fit into float64.
    fraction = (query - stamps_ns[segment]) / np.diff(stamps_ns)[segment]
    result = np.zeros((len(query), 4, 4))
    _interpolate(poses, segment, fraction, result)
    return result


def compile_kernels() -> None:
    """Compile, or load from numba's cache, what `interpolate` needs."""
    interpolate(np.array([0, 1]), np.stack([np.eye(4)] * 2), [0])


@kernel
def _interpolate(poses, segment, fraction, result):
    """Slerp: ``R0 exp(fraction * log(R0^T R1))`` in each segment, by Rodrigues' formula."""
    across, twice = np.empty((3, 3)), np.empty((3, 3))
    angle, last = 0.0, -1
    for i in range(len(segment)):
        first, second = poses[segment[i]], poses[segment[i] + 1]
        start = first[:3, :3]
        if segment[i] != last:
            last = segment[i]
            x, y, z, w = _relative_quaternion(start, second[:3, :3])
            sine = math.sqrt(x * x + y * y + z * z)
            angle = 2.0 * math.atan2(sine, w)
            if sine > 0.0:
                x, y, z = x / sine, y / sine, z / sine
            for row in range(3):
                a, b, c = start[row]
                across[row, 0], across[row, 1], across[row, 2] = (
                    b * z - c * y, c * x - a * z, a * y - b * x,
                )  # fmt: skip
                a, b, c = across[row]
                twice[row, 0], twice[row, 1], twice[row, 2] = (
                    b * z - c * y, c * x - a * z, a * y - b * x,
                )  # fmt: skip
        sine_now = math.sin(fraction[i] * angle)
        versine_now = 1.0 - math.cos(fraction[i] * angle)
        for row in range(3):
            for column in range(3):
                result[i, row, column] = (
                    start[row, column]
                    + sine_now * across[row, column]
                    + versine_now * twice[row, column]
                )
            result[i, row, 3] = first[row, 3] + fraction[i] * (second[row, 3] - first[row, 3])
        result[i, 3, 3] = 1.0


@kernel
def _relative_quaternion(start, end):
    """(x, y, z, w) with w >= 0 of the rotation ``start^T end``, by Shepperd's method."""
    m = start.T.copy() @ end.copy()
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
    if q[3] < 0.0:
        q = -q
    return q[0], q[1], q[2], q[3]
