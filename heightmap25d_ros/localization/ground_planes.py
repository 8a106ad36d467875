# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Planes of the ground through the mean heights of cells, and how well they are known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array, cells_of_mask
from heightmap25d_ros.kernels import inlined_kernel, kernel

_HALF = 2  # [cells] on each side of the middle one
_LEAST_CELLS = 6
_LEAST_SPREAD = 0.3  # [cells^2] variance of the cells in x and in y
_LEAST_AREA = 1e-6  # [cells^4] determinant of that of both
_STEP, _STEEPEST = 0.25, 0.3  # [m], [m/m] beyond which a cell is not on the same ground
_FLOOR = 1e-6  # [m^2] of variance that no plane is free of


def fit_planes(
    heights: Array, is_ground: NDArray[np.bool_], resolution: float
) -> tuple[NDArray[np.int64], Array]:
    """Planes through 5 x 5 cells, one for each cell of ground that has enough around it.

    Parameters
    ----------
    heights : (rows, columns) float64 [m]
        Of the ground at the middle of each cell.
    is_ground : (rows, columns) bool
    resolution : float [m]

    Returns
    -------
    cells : (K, 2) int64
        iy, ix.
    planes : (K, 5) float64
        Height at the middle of the cell [m], slope along x and along y, rms of the cells about
        the plane [m], variance of each of the slopes.
    """
    cells = cells_of_mask(is_ground)
    planes = np.full((len(cells), 5), np.nan)
    _fit(cells, heights, is_ground, resolution, planes)
    is_found = ~np.isnan(planes[:, 0])
    return cells[is_found], planes[is_found]


@kernel
def _fit(cells, heights, is_ground, resolution, planes):
    moments = np.empty(10)
    for k in range(len(cells)):
        iy, ix = cells[k]
        _sum(iy, ix, heights, is_ground, resolution, moments)
        count = moments[0]
        if count < _LEAST_CELLS:
            continue
        x, y, z = moments[1] / count, moments[2] / count, moments[3] / count
        xx, xy, yy = moments[4] / count - x * x, moments[5] / count - x * y, 0.0
        yy = moments[6] / count - y * y
        xz, yz, zz = moments[7] / count - x * z, moments[8] / count - y * z, 0.0
        zz = moments[9] / count - z * z
        area = xx * yy - xy * xy
        least = _LEAST_SPREAD * resolution**2
        if area < _LEAST_AREA * resolution**4 or xx < least or yy < least:
            continue
        along_x, along_y = (yy * xz - xy * yz) / area, (xx * yz - xy * xz) / area
        variance = max(zz - along_x * xz - along_y * yz, 0.0) * count / max(count - 3.0, 1.0)
        planes[k, 0] = heights[iy, ix] + z - along_x * x - along_y * y
        planes[k, 1], planes[k, 2] = along_x, along_y
        planes[k, 3] = np.sqrt(variance)
        planes[k, 4] = (variance + _FLOOR) / count * 0.5 * (xx + yy) / area


@inlined_kernel
def _sum(iy, ix, heights, is_ground, resolution, moments):
    """Moments of the ground around a cell, seen from its middle."""
    moments[:] = 0.0
    for j in range(max(iy - _HALF, 0), min(iy + _HALF + 1, heights.shape[0])):
        for i in range(max(ix - _HALF, 0), min(ix + _HALF + 1, heights.shape[1])):
            z = heights[j, i] - heights[iy, ix]
            x, y = (i - ix) * resolution, (j - iy) * resolution
            if not is_ground[j, i] or abs(z) > _STEP + _STEEPEST * (abs(x) + abs(y)):
                continue
            moments[0] += 1.0
            moments[1] += x
            moments[2] += y
            moments[3] += z
            moments[4] += x * x
            moments[5] += x * y
            moments[6] += y * y
            moments[7] += x * z
            moments[8] += y * z
            moments[9] += z * z
