# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses between poses, for each beam of a scan at its own time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.se3 import Matrix, quaternion_of


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
    query = np.ascontiguousarray(query_ns, dtype=np.int64)
    result = np.zeros((len(query), 4, 4))
    if not _interpolate(stamps_ns, np.ascontiguousarray(poses), query, result):
        raise ValueError("a pose was requested outside of the known stamps")
    return result


@kernel
def span(stamps):
    """The earliest and the latest of some stamps (N,) [ns]."""
    first = last = stamps[0]
    for i in range(1, len(stamps)):
        first, last = min(first, stamps[i]), max(last, stamps[i])
    return first, last


@kernel
def _interpolate(stamps, poses, query, result):
    """Slerp: ``R0 exp(fraction * log(R0^T R1))`` in each segment, by Rodrigues' formula.

    Whether all queries lie inside of the stamps.
    """
    across, twice = np.empty((3, 3)), np.empty((3, 3))
    angle, last = 0.0, -1
    for i in range(len(query)):
        if not stamps[0] <= query[i] <= stamps[-1]:
            return False
        segment = max(last, 0)
        if last < 0 or not stamps[last] <= query[i] < stamps[last + 1]:
            segment = min(np.searchsorted(stamps, query[i], side="right"), len(stamps) - 1) - 1
        segment = max(segment, 0)
        first, second = poses[segment], poses[min(segment + 1, len(stamps) - 1)]
        start = first[:3, :3]
        if segment != last:
            last = segment
            x, y, z, w = quaternion_of(start.T.copy() @ second[:3, :3].copy())
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
        # Integers until the difference is taken: nanoseconds since 1970 do not fit into float64.
        fraction = 0.0
        if len(stamps) > 1:
            fraction = (query[i] - stamps[segment]) / (stamps[segment + 1] - stamps[segment])
        sine_now = math.sin(fraction * angle)
        versine_now = 1.0 - math.cos(fraction * angle)
        for row in range(3):
            for column in range(3):
                result[i, row, column] = (
                    start[row, column]
                    + sine_now * across[row, column]
                    + versine_now * twice[row, column]
                )
            result[i, row, 3] = first[row, 3] + fraction * (second[row, 3] - first[row, 3])
        result[i, 3, 3] = 1.0
    return True
