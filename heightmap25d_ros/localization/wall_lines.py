# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of walls through the mean places of elevated returns, and how well they are known.

The normal of a wall from five neighbouring cells is wrong by 3 to 4 degrees, and each return then
tells of the direction *along* the wall, of which it knows nothing. So lines are as long as the
walls allow, and each carries the variance of its normal.

Through each cell goes, of the lines to its neighbours, the one with the most inliers; it is fitted
anew to these. Long windows are tried first and small ones, which must hold little else, after
them. Last come the cells right around, with the variance that they show.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array, cells_of_mask
from heightmap25d_ros.kernels import inlined_kernel, kernel

_BAND = 0.03  # [m] to either side of a line, in which its inliers are
_MOST_RMS = 0.015  # [m] of the inliers' distances from their line
_LEAST_SPREAD = 0.4  # [radius] of the inliers along their line
_LEAST_INLIERS = 5
_WINDOWS = ((10.0, 0.35), (6.0, 0.60))  # radius [cells], least share of inliers
_LAST_RADIUS = 2.2  # [cells]
_LAST_ASPECT = 0.3  # variance across a line over that along it, at most
_FLOOR = 1e-6  # [m^2] of variance that no line is free of
_LAST_FLOOR = 1e-4
_REFITS = 4
_MOST_PLACES = 512  # within the largest window


class Line(NamedTuple):
    """A line through places, as the kernels find it.

    Attributes
    ----------
    normal_x, normal_y : float
    offset : float [m]
        Of the line from the cell's own place, along the normal.
    normal_variance : float [rad^2]
    scatter : float [m^2]
        Variance of the places across the line.
    is_found : bool
    """

    normal_x: float
    normal_y: float
    offset: float
    normal_variance: float
    scatter: float
    is_found: bool


def fit_lines(
    places: Array, counts: NDArray[np.float64], resolution: float
) -> tuple[NDArray[np.int64], Array]:
    """Lines through all measured cells that are on one.

    Parameters
    ----------
    places : (rows, columns, 2) float64 [m]
        x and y of the mean places, in any frame along the axes of the cells.
    counts : (rows, columns) float64
        How many returns each is the mean of, which is what it weighs; 0: none. Of a wall close to
        the border of two cells the one has most returns, and the other few that lie far off.
    resolution : float [m]

    Returns
    -------
    cells : (K, 2) int64
        iy, ix of all measured cells.
    lines : (K, 5) float64
        As the first five of `Line`; all NaN for a cell that is on no line.
    """
    cells = cells_of_mask(counts > 0)
    lines = np.full((len(cells), 5), np.nan)
    for radius, share in _WINDOWS:
        _fit_long(cells, places, counts, resolution, radius, share, lines)
    _fit_short(cells, places, counts, resolution, lines)
    return cells, lines


@kernel
def _fit_long(cells, places, counts, resolution, radius, share, lines):
    """Lines of a window where there is none yet."""
    near = np.empty((_MOST_PLACES, 3))
    for k in range(len(cells)):
        if lines[k, 0] == lines[k, 0]:
            continue
        iy, ix = cells[k]
        count = _gather(iy, ix, places, counts, resolution, radius, near)
        line = _long_line(near, count, radius * resolution, share)
        if line.is_found:
            lines[k, 0], lines[k, 1], lines[k, 2] = line.normal_x, line.normal_y, line.offset
            lines[k, 3], lines[k, 4] = line.normal_variance, line.scatter


@kernel
def _fit_short(cells, places, counts, resolution, lines):
    """Lines through the cells right around, where there is none yet."""
    near = np.empty((_MOST_PLACES, 3))
    for k in range(len(cells)):
        if lines[k, 0] == lines[k, 0]:
            continue
        iy, ix = cells[k]
        count = _gather(iy, ix, places, counts, resolution, _LAST_RADIUS, near)
        if count < 3:
            continue
        cos, sin, _, along, across, _, free = _principal(near, count, 1.0, 0.0, 0.0, np.inf)
        if along <= 0.0 or across >= _LAST_ASPECT * along:
            continue
        scatter = max(across * count / max(count - 2, 1), _LAST_FLOOR)
        lines[k, 0], lines[k, 1], lines[k, 2] = -sin, cos, 0.0
        lines[k, 3], lines[k, 4] = scatter / (free * along), scatter


@inlined_kernel
def _gather(iy, ix, places, counts, resolution, radius, near):
    """Places within a radius [cells] of a cell's, seen from it; how many."""
    reach, count = int(np.ceil(radius)), 0
    for y in range(max(iy - reach, 0), min(iy + reach + 1, counts.shape[0])):
        for x in range(max(ix - reach, 0), min(ix + reach + 1, counts.shape[1])):
            if counts[y, x] > 0 and count < _MOST_PLACES:
                dx = places[y, x, 0] - places[iy, ix, 0]
                dy = places[y, x, 1] - places[iy, ix, 1]
                if dx * dx + dy * dy <= (radius * resolution) ** 2:
                    near[count, 0], near[count, 1], near[count, 2] = dx, dy, counts[y, x]
                    count += 1
    return count


@inlined_kernel
def _long_line(near, count, radius, share):
    """The line through the origin's surroundings with the most inliers, fitted anew."""
    none = Line(0.0, 0.0, 0.0, 0.0, 0.0, False)
    cos, sin, inliers = _best_direction(near, count, radius)
    if inliers < _LEAST_INLIERS:
        return none
    offset = along = across = free = 0.0
    for _ in range(_REFITS):
        cos, sin, offset, along, across, inliers, free = _principal(
            near, count, cos, sin, offset, _BAND
        )
        if inliers < _LEAST_INLIERS:
            return none
    if (
        abs(offset) > _BAND
        or inliers < share * count
        or across > _MOST_RMS**2
        or along < (_LEAST_SPREAD * radius) ** 2
    ):
        return none
    return Line(-sin, cos, offset, (across + _FLOOR) / (free * along), across, True)


@inlined_kernel
def _best_direction(near, count, radius):
    """Of the lines from the origin to places not near, the one with the most inliers."""
    best, cos, sin = 0, 1.0, 0.0
    for i in range(count):
        distance = np.hypot(near[i, 0], near[i, 1])
        if distance >= 0.5 * radius:
            c, s, inliers = near[i, 0] / distance, near[i, 1] / distance, 0
            for j in range(count):
                inliers += abs(c * near[j, 1] - s * near[j, 0]) < _BAND
            if inliers > best:
                best, cos, sin = inliers, c, s
    return cos, sin, best


@inlined_kernel
def _principal(near, count, cos, sin, offset, band):
    """Direction, offset, variances along and across of the places in a line's band.

    And how many there are: all, and such that weigh the same and are as good.
    """
    inliers = 0
    total = squares = x = y = xx = xy = yy = 0.0
    for j in range(count):
        if abs(cos * near[j, 1] - sin * near[j, 0] - offset) < band:
            weight = near[j, 2]
            inliers += 1
            total += weight
            squares += weight * weight
            x += weight * near[j, 0]
            y += weight * near[j, 1]
            xx += weight * near[j, 0] ** 2
            xy += weight * near[j, 0] * near[j, 1]
            yy += weight * near[j, 1] ** 2
    if inliers == 0:
        return cos, sin, offset, 0.0, 0.0, 0, 1.0
    x, y = x / total, y / total
    xx, xy, yy = xx / total - x * x, xy / total - x * y, yy / total - y * y
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    cos, sin = np.cos(angle), np.sin(angle)
    along = xx * cos * cos + 2.0 * xy * cos * sin + yy * sin * sin
    across = max(xx + yy - along, 0.0)
    return cos, sin, cos * y - sin * x, along, across, inliers, total * total / squares
