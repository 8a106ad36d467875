# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the robot's rectangle can get on a true surface, in any way.

The surface is sampled several times in each cell, and the rectangle is smaller on each side by
`MARGIN`, which covers the errors of the sampling: where it cannot get, the robot cannot. It may
also move sideways and turn in place, and only vertical faces stop it: no planner has more freedom.
"""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.simulation.robot import LENGTH, WIDTH

MARGIN = 0.05
"""By which the rectangle is smaller on each side [m]."""

_HEADINGS = 16  # in half a turn: the rectangle looks the same after it
_ANYWHERE = np.ones((3, 3, 3), bool)  # neighbours in x, y and heading

Mask = NDArray[np.bool_]


def faces(height: Array, max_step: float) -> Mask:
    """The upper edges of vertical faces, and what is closed.

    Parameters
    ----------
    height : (levels, rows, columns) float64 [m]
        Samples, so close to one another that a step between neighbours is a face; infinite: closed.
    max_step : float [m]
    """
    filled = np.where(np.isfinite(height), height, -np.inf)
    around = ndimage.minimum_filter(np.where(np.isfinite(height), height, np.inf), (1, 3, 3))
    with np.errstate(invalid="ignore"):
        return np.asarray(~np.isfinite(height) | (filled - around > max_step))


def reached(
    height: Array, is_closed: Mask, is_steep: Mask, spacing: float, start: tuple[int, int, int]
) -> tuple[Mask, Mask]:
    """Where the rectangle's centre may be, and where of that it gets from a start.

    Parameters
    ----------
    height : (levels, rows, columns) float64 [m]
        Where two levels have the same height, they are one ground.
    is_closed : (levels, rows, columns) bool
        What no part of the rectangle may cover; all beyond the border is closed.
    is_steep : (levels, rows, columns) bool
        Where its centre may not be.
    spacing : float [m]
        Between samples.
    start : (level, row, column)

    Returns
    -------
    stands, gets : (levels, rows, columns) bool
        At some heading.
    """
    free = np.stack([_free(level, spacing) for level in is_closed]) & ~is_steep[:, None]
    labels = np.zeros(free.shape, np.int32)
    count = 0
    for number, level in enumerate(free):
        found, here = ndimage.label(level, _ANYWHERE)
        labels[number] = np.where(found > 0, found + count, 0)
        count += here
    joined = [(labels[:, 0], labels[:, -1])]  # half a turn on, the rectangle is the same
    joined += [
        (np.where(height[i] == height[i + 1], labels[i], 0), labels[i + 1])
        for i in range(len(height) - 1)
    ]
    pairs = [
        (one[both], other[both]) for one, other in joined for both in [(one > 0) & (other > 0)]
    ]
    graph = coo_array(
        (np.ones(sum(len(one) for one, _ in pairs)), np.hstack(pairs)), (count + 1, count + 1)
    )
    _, part = connected_components(graph, directed=False)
    level, row, column = start
    begun = np.unique(part[labels[level, :, row, column]][free[level, :, row, column]])
    is_reached = free & np.isin(part, begun)[labels]
    return np.asarray(free.any(axis=1)), np.asarray(is_reached.any(axis=1))


def _free(is_closed: Mask, spacing: float) -> Mask:
    """(headings, rows, columns): whether the rectangle covers nothing that is closed."""
    reach = int(np.hypot(LENGTH, WIDTH) / 2 / spacing) + 1
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1] * spacing
    padded = np.pad(is_closed, reach, constant_values=True).astype(np.float32)
    found = []
    for heading in np.arange(_HEADINGS) * pi / _HEADINGS:
        ahead, aside = (
            np.abs(x * np.cos(heading) + y * np.sin(heading)),
            np.abs(y * np.cos(heading) - x * np.sin(heading)),
        )
        is_robot = (ahead <= LENGTH / 2 - MARGIN) & (aside <= WIDTH / 2 - MARGIN)
        covered = signal.oaconvolve(padded, is_robot.astype(np.float32), mode="valid")
        found.append(covered < 0.5)
    return np.stack(found)


def by_cell(samples: NDArray[np.bool_], each: int) -> Mask:
    """Whether any of the samples (levels, rows * each, columns * each) of a cell is true."""
    levels, rows, columns = samples.shape
    cells = samples.reshape(levels, rows // each, each, columns // each, each)
    return np.asarray(cells.any(axis=(2, 4)))
