# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A path on the true surface: largest step, steepest slope and least headroom of a rectangle.

Shares no code with the planner.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.evaluation.truth import TrueGround
from heightmap25d_ros.grid.height_map import Geometry

_BETWEEN = 0.05
"""Largest distance between poses that are checked along the path [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drivability:
    """The extremes under a rectangle along a path on the true surface.

    Attributes
    ----------
    largest_step : float [m]
        Between neighbouring cells whose centres are both in the rectangle.
    steepest_slope : float [rad]
        Of the least-squares plane through the cells in the rectangle.
    lowest_ceiling : float [m]
        Least clear height above a cell in the rectangle.
    """

    largest_step: float
    steepest_slope: float
    lowest_ceiling: float

    def as_dict(self) -> dict[str, float | None]:
        """The figures by name, rounded to millimetres and milliradians; infinite ones as None."""
        return {
            name: round(value, 3) if np.isfinite(value) else None
            for name, value in asdict(self).items()
        }


def evaluate_path(
    ground: TrueGround, path: NDArray[np.float64], length: float, width: float
) -> Drivability:
    """Move a rectangle along a path on the true ground.

    Parameters
    ----------
    ground : TrueGround
    path : (N, 3) float64 [m, rad]
        x, y and heading; straight in between, with the heading of the pose before.
    length, width : float [m]
        Of the rectangle.

    Returns
    -------
    Drivability
        Infinite step and slope if the rectangle leaves the ground.
    """
    worst_step, worst_slope, lowest = 0.0, 0.0, np.inf
    for x, y, heading in _dense(path):
        iy, ix = _cells_under(ground.geometry, x, y, heading, length, width)
        rows, columns = ground.height.shape
        if not ((iy >= 0) & (ix >= 0) & (iy < rows) & (ix < columns)).all():
            return Drivability(largest_step=np.inf, steepest_slope=np.inf, lowest_ceiling=lowest)
        height = ground.height[iy, ix]
        if not height.size:  # narrower than a cell
            continue
        if not np.isfinite(height).all():
            return Drivability(largest_step=np.inf, steepest_slope=np.inf, lowest_ceiling=lowest)
        lowest = min(lowest, float(ground.clearance[iy, ix].min()))
        is_neighbour = np.maximum(abs(iy[:, None] - iy), abs(ix[:, None] - ix)) == 1
        steps = np.abs(height[:, None] - height)[is_neighbour]
        worst_step = max(worst_step, steps.max(initial=0.0))
        positions = np.column_stack([iy, ix, np.ones_like(iy)]) * ground.geometry.resolution
        plane, *_ = np.linalg.lstsq(positions, height, rcond=None)
        worst_slope = max(worst_slope, float(np.arctan(np.hypot(*plane[:2]))))
    return Drivability(
        largest_step=worst_step, steepest_slope=worst_slope, lowest_ceiling=float(lowest)
    )


def _dense(path: NDArray[np.float64]) -> NDArray[np.float64]:
    parts = [path[:1]]
    for before, after in pairwise(path):
        count = int(np.ceil(np.hypot(*(after - before)[:2]) / _BETWEEN)) + 1
        part = np.repeat(before[None], count, axis=0)
        part[:, :2] += np.linspace(0.0, 1.0, count)[:, None] * (after - before)[:2]
        parts += [part, after[None]]
    return np.concatenate(parts)


def _cells_under(
    geometry: Geometry, x: float, y: float, heading: float, length: float, width: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the cells whose centres are in the rectangle; not clipped to the map."""
    reach = int(np.hypot(length, width) / 2 / geometry.resolution) + 2
    middle = geometry.cell_at((x, y))
    offset = np.indices((2 * reach + 1, 2 * reach + 1)).reshape(2, -1).T - reach
    cells = middle + offset
    dx, dy = (geometry.cell_center(cells) - (x, y)).T
    ahead = dx * np.cos(heading) + dy * np.sin(heading)
    aside = dy * np.cos(heading) - dx * np.sin(heading)
    inside = (abs(ahead) <= length / 2) & (abs(aside) <= width / 2)
    return cells[inside, 0], cells[inside, 1]
