# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Some of the returns of a scan as points, in the order of the beams."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.mapping.scan import Scan


def scan_points(
    scan: Scan,
    T_odom_base: se3.Matrix,
    T_base_sensor: se3.Matrix,
    step: int,
    points: NDArray[np.float64],
    lever: NDArray[np.float64],
) -> None:
    """Fill in every so many-th beam as a point, and as it is seen from its laser.

    Parameters
    ----------
    scan : Scan
    T_odom_base, T_base_sensor : (N, 4, 4) or (1, 4, 4) float64
        At each beam's own time, or once for all beams.
    step : int
    points : (K, 3) float64 [m], odom
        NaN where there is no return.
    lever : (K, 3) float64 [m], base_link
        From the laser; NaN as well.
    """
    _fill_in(
        scan.ranges, (scan.angle_min, scan.angle_increment), (scan.range_min, scan.range_max),
        np.ascontiguousarray(T_odom_base), np.ascontiguousarray(T_base_sensor), step, points, lever,
    )  # fmt: skip


def count_of_points(scan: Scan, step: int) -> int:
    """How many these are."""
    return len(range(0, len(scan.ranges), step))


@kernel
def _fill_in(ranges, angles, limits, T_odom_base, T_base_sensor, step, points, lever):
    base_step, mount_step = min(len(T_odom_base) - 1, 1), min(len(T_base_sensor) - 1, 1)
    for k in range(len(points)):
        i = k * step
        is_return = limits[0] < ranges[i] < limits[1]
        distance = np.float64(ranges[i]) if is_return else np.nan
        angle = angles[0] + angles[1] * i
        x, y = distance * np.cos(angle), distance * np.sin(angle)
        mount, base = T_base_sensor[i * mount_step], T_odom_base[i * base_step]
        for axis in range(3):
            lever[k, axis] = mount[axis, 0] * x + mount[axis, 1] * y
        for axis in range(3):
            points[k, axis] = base[axis, 3]
            for j in range(3):
                points[k, axis] += base[axis, j] * (lever[k, j] + mount[j, 3])
