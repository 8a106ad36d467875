# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps between neighbouring cells: arrays of heights in, blocked transitions and obstacles out.

The inner loops run along rows, in forms that the compiler vectorizes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.kernels import kernel

NEIGHBOURS = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))
"""(dy, dx) of the neighbour behind bit k of a mask of transitions; k and k ^ 4 are opposites."""

UNOBSERVED = 1 << 20
"""Height of unknown cells: farther from every height than two heights can be."""

LARGEST_STEP = (1 << 16) - 1
"""Largest difference between two heights of 16 bits [cm]."""

HIGHEST = np.int16(32767)
"""Height of unknown cells in a minimum: above every stored height (`HEIGHT_LIMIT`)."""

LINE = 32
"""Heights of 16 bits per cache line: vectors across two lines are read at half speed."""

STRETCH = 4096
"""Cells that several passes process before the next ones: they stay in the cache."""


def padded_surface(
    height: NDArray[np.int16], known: NDArray[np.bool_], margin: int
) -> NDArray[np.int32]:
    """Heights [cm] as int32, `UNOBSERVED` in unknown cells and in a margin all around.

    In a flat padded array the neighbours of every cell lie at the same offsets, and the rows of
    a small map form long vectors.
    """
    return np.pad(np.where(known, height, np.int32(UNOBSERVED)), margin, constant_values=UNOBSERVED)


def cropped(padded: NDArray[Any], margin: int) -> NDArray[Any]:
    """Contiguous copy of a padded array without its margin."""
    rows, columns = padded.shape
    return padded[margin : rows - margin, margin : columns - margin].copy()


def transitions(
    surface: NDArray[np.int32], max_step_cm: int
) -> tuple[NDArray[np.uint8], NDArray[np.int16]]:
    """Blocked transitions and the largest open step of each cell.

    Parameters
    ----------
    surface : (rows, columns) int32 [cm]
        Padded by at least 1.
    max_step_cm : int [cm]

    Returns
    -------
    blocked : (rows, columns) uint8
        Bit k: the step to ``NEIGHBOURS[k]`` is too high, up or down. Unknown cells have no
        transitions.
    step : (rows, columns) int16 [cm]
        Largest difference to a neighbour that is not too high.
    """
    blocked, step = np.zeros(surface.shape, np.uint8), np.zeros(surface.shape, np.int16)
    offsets = np.array(NEIGHBOURS) @ (surface.shape[1], 1)
    _transitions(surface.ravel(), offsets, max_step_cm, blocked.ravel(), step.ravel())
    return blocked, step


@kernel
def _transitions(surface, offsets, max_step, blocked, step):
    margin = offsets.max()
    for start in range(margin, surface.size - margin, STRETCH):
        end = min(start + STRETCH, surface.size - margin)
        for k in range(8):
            there = surface[start + offsets[k] : end + offsets[k]]
            _compare(
                (surface[start:end], there),
                np.int32(max_step),
                np.uint8(1 << k),
                blocked[start:end],
                step[start:end],
            )


@kernel
def _compare(pair, max_step, bit, blocked, step):
    here, there = pair
    for x in range(here.size):
        difference = abs(there[x] - here[x])
        is_blocked = (difference > max_step) & (difference <= LARGEST_STEP)
        blocked[x] |= bit if is_blocked else np.uint8(0)
        step[x] = max(step[x], np.int16(difference) if difference <= max_step else np.int16(0))


def step_obstacles(
    height: NDArray[np.int16], known: NDArray[np.bool_], max_step_cm: int
) -> NDArray[np.int8]:
    """Obstacles by steps: the cells at the upper end of a blocked transition are occupied.

    Every blocked transition has its upper end in an occupied cell, so that no path over free
    cells crosses one; and a wall occupies only its own cells, not the ground in front of it.

    Parameters
    ----------
    height : (rows, columns) int16 [cm], within +-`HEIGHT_LIMIT`
    known : (rows, columns) bool
    max_step_cm : int [cm]

    Returns
    -------
    (rows, columns) int8
        -1: unknown, 0: free, 100: occupied.

    Examples
    --------
    A wall and a cliff, seen from the ground between them:

    >>> height = np.array([[200, 0, 0, -80]], np.int16)
    >>> step_obstacles(height, np.ones((1, 4), bool), 10)
    array([[100,   0, 100,   0]], dtype=int8)
    """
    occupancy = np.empty(height.shape, np.int8)
    _step_obstacles(
        np.require(height, np.int16, ("C", "W")),
        np.require(known, np.bool_, ("C", "W")),
        np.uint16(max_step_cm),
        occupancy,
    )
    return occupancy


@kernel
def _step_obstacles(height, known, max_step, occupancy):
    rows, columns = height.shape
    # Three rows at a time, with unknown cells all around.
    ring = np.full((3, columns + 2 * LINE), HIGHEST, np.int16)
    for y in range(rows + 1):
        below = ring[y % 3]
        if y < rows:
            _known_heights(height[y], known[y], below[LINE : LINE + columns])
        else:
            below[:] = HIGHEST
        if y > 0:
            above, here = ring[(y + 1) % 3, LINE - 1 :], ring[(y + 2) % 3, LINE - 1 :]
            _upper_ends(above, here, below[LINE - 1 :], max_step, occupancy[y - 1])


@kernel
def _known_heights(height, known, result):
    for x in range(result.size):
        value = height[x]
        result[x] = value if known[x] else HIGHEST


@kernel
def _upper_ends(above, here, below, max_step, occupancy):
    # Two separable passes of three would compare less, but load and store more: slower.
    for x in range(occupancy.size):
        height = here[x + 1]
        lowest = min(above[x], above[x + 1], above[x + 2], here[x], height, here[x + 2])
        lowest = min(lowest, below[x], below[x + 1], below[x + 2])
        drop = np.uint16(height - lowest)  # up to 65400: not an int16
        value = np.int8(100) if drop > max_step else np.int8(0)
        occupancy[x] = np.int8(-1) if height == HIGHEST else value
