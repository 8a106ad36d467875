# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The cost of a transition between neighbouring cells, and of a straight line over many cells.

A transition of horizontal length L into a neighbour, over ground with slope s along it and
cross slope c (both tangents), costs

    L * (f * sqrt(1 + s^2) + climb * max(s, 0) + descent * max(-s, 0) + cross * |c|)

where f = 1 + terms for roughness, closeness to obstacles and being unknown, each with its
weight. Slopes and f are the means of the transition's two cells. The paper weighs a cell by "the
height difference between the current cell and those around it"; here it is the slope of the
plane under the footprint, so that noise of single heights costs nothing, and direction counts.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.planning.search import CLOSED, DIAGONAL, LARGEST_COST, STRAIGHT
from heightmap25d_ros.terrain.steps import NEIGHBOURS

Weights = tuple[float, float, float]
"""Of climbing, descending and cross slopes."""


def incoming_costs(
    enterable: NDArray[np.bool_],
    blocked: NDArray[np.uint8],
    gradient: NDArray[np.float32],
    weight: NDArray[np.float32],
    slope_weights: Weights,
) -> NDArray[np.uint16]:
    """The cost of each transition, by the cell that it leads into and the direction it comes from.

    A transition is open if both of its cells are enterable and its step is; a diagonal one
    needs, besides, both cells at its corners and the steps to them.

    Parameters
    ----------
    enterable : (rows, columns) bool
    blocked : (rows, columns) uint8
        Bit k: the step to ``NEIGHBOURS[k]`` is too high.
    gradient : (2, rows, columns) float32
        Along x and y, as tangents.
    weight : (rows, columns) float32, 1 or more
    slope_weights : (3,) float, not negative

    Returns
    -------
    (rows + 2, columns + 2, 8) uint16
        At [y + 1, x + 1, k] the transition into (y, x) from its neighbour ``NEIGHBOURS[k]``:
        `search.STRAIGHT` for the length of a cell at cost 1, at most `search.LARGEST_COST`.
    """
    rows, columns = enterable.shape
    incoming = np.zeros((rows + 2, columns + 2, 8), np.uint16)
    closed = np.pad(~enterable, 1, constant_values=True)
    steps = np.pad(blocked, 1)
    _incoming_costs(
        closed.view(np.uint8),
        steps,
        np.pad(gradient[0], 1),
        np.pad(gradient[1], 1),
        np.pad(weight, 1),
        np.array(slope_weights, np.float32),
        incoming,
    )
    return incoming


@kernel
def _incoming_costs(closed, blocked, slope_x, slope_y, weight, slope_weights, incoming):
    rows, columns = closed.shape
    for y in range(1, rows - 1):
        for k in range(8):
            dy, dx = NEIGHBOURS[k]
            side = np.int64(k & 1)
            length = np.float32(DIAGONAL if side else STRAIGHT)
            norm = np.float32(1.0 / math.sqrt(dy * dy + dx * dx))
            # The transition leads from the neighbour into the cell: against (dx, dy).
            ux, uy = -dx * norm, -dy * norm
            before, after = (k + 7) & 7, (k + 1) & 7
            y1, x1 = NEIGHBOURS[before]
            y2, x2 = NEIGHBOURS[after]
            for x in range(1, columns - 1):
                is_closed = closed[y, x] | closed[y + dy, x + dx] | (blocked[y, x] >> k & 1)
                if side:
                    is_closed |= closed[y + y1, x + x1] | closed[y + y2, x + x2]
                    is_closed |= blocked[y, x] >> before & 1 | blocked[y, x] >> after & 1
                    there = blocked[y + dy, x + dx]
                    is_closed |= there >> ((before + 4) & 7) & 1 | there >> ((after + 4) & 7) & 1
                gx = np.float32(0.5) * (slope_x[y, x] + slope_x[y + dy, x + dx])
                gy = np.float32(0.5) * (slope_y[y, x] + slope_y[y + dy, x + dx])
                f = np.float32(0.5) * (weight[y, x] + weight[y + dy, x + dx])
                cost = length * rate(gx * ux + gy * uy, gx * uy - gy * ux, f, slope_weights)
                whole = np.uint16(
                    min(max(cost, length), np.float32(LARGEST_COST)) + np.float32(0.5)
                )
                incoming[y, x, k] = np.uint16(CLOSED) if is_closed else whole


@kernel
def rate(along, across, f, slope_weights):
    """Cost per horizontal length."""
    one, zero = np.float32(1.0), np.float32(0.0)
    climb = slope_weights[0] * max(along, zero) + slope_weights[1] * max(-along, zero)
    return f * math.sqrt(one + along * along) + climb + slope_weights[2] * abs(across)


_CLOSED = -1.0

_TINY = 1e-9
"""Borders within this distance of one another [cells] are crossed together."""


@kernel
def line_cost(terrain, y, x, end_y, end_x):
    """Cost of a straight line [cells] in cells of flat ground; negative if it is blocked."""
    enterable, blocked, gradient, weight, slope_weights = terrain
    iy, ix = math.floor(y), math.floor(x)
    last_y, last_x = math.floor(end_y), math.floor(end_x)
    length = math.hypot(end_y - y, end_x - x)
    if not enterable[iy, ix]:
        return _CLOSED
    if length == 0.0:
        return 0.0
    uy, ux = (end_y - y) / length, (end_x - x) / length
    # Distance along the line to the next border, and from one border to the next.
    next_y, gap_y = _borders(y, uy)
    next_x, gap_x = _borders(x, ux)
    cost, at = 0.0, 0.0
    while True:
        border = min(next_y, next_x)
        until = min(border, length)
        slope_y, slope_x = gradient[1, iy, ix], gradient[0, iy, ix]
        along, across = slope_x * ux + slope_y * uy, slope_x * uy - slope_y * ux
        cost += (until - at) * rate(along, across, weight[iy, ix], slope_weights)
        at = until
        # A line that ends on a border ends in the cell behind it.
        if (iy == last_y and ix == last_x) or border > length + _TINY:
            return cost
        is_corner = abs(next_y - next_x) < _TINY
        dy = (1 if uy > 0 else -1) if next_y <= next_x or is_corner else 0
        dx = (1 if ux > 0 else -1) if next_x <= next_y or is_corner else 0
        if not _is_open(enterable, blocked, iy, ix, dy, dx):
            return _CLOSED
        iy, ix = iy + dy, ix + dx
        next_y += gap_y if dy else 0.0
        next_x += gap_x if dx else 0.0


@kernel
def _borders(coordinate, speed):
    """Distances along a line to the first border of cells across an axis, and between borders."""
    if speed == 0.0:
        return math.inf, math.inf
    inside = coordinate - math.floor(coordinate)
    return (1.0 - inside if speed > 0.0 else inside) / abs(speed), 1.0 / abs(speed)


@kernel
def _is_open(enterable, blocked, iy, ix, dy, dx):
    """Whether the step from a cell to its neighbour at (dy, dx) can be taken."""
    if not enterable[iy + dy, ix + dx]:
        return False
    if dy == 0 or dx == 0:
        return blocked[iy, ix] >> _direction(dy, dx) & 1 == 0
    if not (enterable[iy, ix + dx] and enterable[iy + dy, ix]):
        return False
    here, there = blocked[iy, ix], blocked[iy + dy, ix + dx]
    along_x, along_y = _direction(0, dx), _direction(dy, 0)
    steps = here >> _direction(dy, dx) | here >> along_x | here >> along_y
    steps |= there >> (along_x ^ 4) | there >> (along_y ^ 4)
    return steps & 1 == 0


@kernel
def _direction(dy, dx):
    """Index in `NEIGHBOURS` of (dy, dx)."""
    if dy == 0:
        return 0 if dx > 0 else 4
    if dy > 0:
        return 2 - dx
    return 6 + dx
