# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ground under the robot's footprint: planes fitted under a disc, and inflation by that disc.

All sums are of integers (cells, centimetres), so that the result for a cell depends on the heights
around it alone, and not on the rectangle in which it was computed.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.terrain.steps import NEIGHBOURS, STRETCH, UNOBSERVED, cropped

CHUNK = 512
"""Cells whose sums are formed together: they stay in the first-level cache."""

PITCH = CHUNK + 16
"""Offset between rows of sums: rows a power of two apart would share few cache lines."""


@dataclass(frozen=True, slots=True, eq=False)
class Footprint:
    """The cells whose centres lie within a disc around a cell's centre.

    Attributes
    ----------
    radius : int
        In whole cells: the largest row and column offset.
    offsets : (2 K + 1, 2) int64
        (dy, dx): the centre, then pairs of opposite cells, in order of distance.
    predecessors : (2 K + 1,) int64
        Index of the next cell on the straight line to the centre.
    directions : (2 K + 1,) int64
        Index in `NEIGHBOURS` of the step from the predecessor to the cell; unused for the
        centre.
    """

    radius: int
    offsets: NDArray[np.int64]
    predecessors: NDArray[np.int64]
    directions: NDArray[np.int64]


@functools.cache
def footprint(radius_squared: int) -> Footprint:
    """The cells at a distance of at most ``sqrt(radius_squared)`` cells."""
    radius = math.isqrt(radius_squared)
    half = [
        (dy, dx)
        for dy in range(radius + 1)
        for dx in range(-radius, radius + 1)
        if (dy, dx) > (0, 0) and dy * dy + dx * dx <= radius_squared
    ]
    half.sort(key=lambda offset: max(abs(offset[0]), abs(offset[1])))
    offsets = [(0, 0), *(signed for dy, dx in half for signed in ((dy, dx), (-dy, -dx)))]
    position = {offset: row for row, offset in enumerate(offsets)}
    predecessors, directions = [0], [0]
    for dy, dx in offsets[1:]:
        steps = max(abs(dy), abs(dx))
        before = _shortened(dy, steps), _shortened(dx, steps)
        predecessors.append(position[before])
        directions.append(NEIGHBOURS.index((dy - before[0], dx - before[1])))
    return Footprint(
        radius=radius,
        offsets=np.array(offsets),
        predecessors=np.array(predecessors),
        directions=np.array(directions),
    )


def _shortened(component: int, steps: int) -> int:
    """One component of an offset of so many steps after the first step back to the centre."""
    nearest = (2 * abs(component) * (steps - 1) + steps - 1) // (2 * steps)  # halves down
    return int(math.copysign(nearest, component))


def planes(
    surface: NDArray[np.int32], blocked: NDArray[np.uint8], disc: Footprint, max_step_cm: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Gradient and roughness of the ground under a disc centred on each cell.

    The ground is what the robot could drive onto from the centre: the known cells of the disc
    to which the straight line from the centre crosses no blocked transition, and whose heights
    (where the line crosses unknown cells) differ by at most `max_step_cm` per cell of distance.
    So a wall, a kerb or a cliff beside level ground does not tilt the plane, and a steep slope
    made of open steps is measured as steep.

    A least-squares plane is fitted to it. Noise makes a gradient uncertain as one over the
    root of the ground's second moment (the sum of squared distances to the mean) in that
    direction; where it is less than a sixteenth of the whole disc's, and so the gradient more
    than four times as uncertain, the gradient in that direction is set to zero.

    Parameters
    ----------
    surface : (rows, columns) int32 [cm]
        Padded by at least the disc's radius.
    blocked : (rows, columns) uint8
    disc : Footprint
    max_step_cm : int [cm]

    Returns
    -------
    gradient : (2, rows, columns) float32 [cm per cell]
        Of the plane, along x and along y; 0 where unknown.
    roughness : (rows, columns) float32 [cm]
        Root mean square of the distances (along z) to the plane; 0 where unknown.
    """
    gradient = np.zeros((2, *surface.shape), np.float32)
    roughness = np.zeros(surface.shape, np.float32)
    largest_sum = len(disc.offsets) * (disc.radius * max_step_cm) ** 2
    sums = np.empty(10 * PITCH, np.int32 if largest_sum < 2**31 else np.int64)
    least_moment = max((disc.offsets[:, 0] ** 2).sum() / 16, 0.1)
    _planes(
        (surface.ravel(), blocked.ravel(), surface.shape[1]),
        (disc.offsets, disc.predecessors, disc.directions),
        max_step_cm,
        least_moment,
        sums,
        gradient.reshape(2, -1),
        roughness.ravel(),
    )
    return gradient, roughness


@kernel
def _planes(ground, disc, max_step, least_moment, sums, gradient, roughness):
    surface, blocked, pitch = ground
    offsets, predecessors, directions = disc
    flat_offsets = offsets[:, 0] * pitch + offsets[:, 1]
    margin = flat_offsets.max()
    reached = np.ones((len(flat_offsets), CHUNK), np.uint8)
    for start in range(margin, surface.size - margin, CHUNK):
        end = min(start + CHUNK, surface.size - margin)
        here = surface[start:end]
        if here.min() == UNOBSERVED:
            continue
        sums[:] = 0
        sums[: here.size] = 1  # the centre itself
        for i in range(1, len(flat_offsets)):
            before = predecessors[i]
            mask = blocked[start + flat_offsets[before] : end + flat_offsets[before]]
            _reach(reached[before], mask, np.uint8(directions[i]), reached[i])
            if i % 2 == 0:  # opposite cells together: half as many passes over the sums
                dy, dx = np.int32(offsets[i, 0]), np.int32(offsets[i, 1])
                _add(
                    here,
                    (surface[start + flat_offsets[i] : end + flat_offsets[i]], reached[i]),
                    (surface[start - flat_offsets[i] : end - flat_offsets[i]], reached[i - 1]),
                    (dy, dx),
                    np.int32(max(abs(dy), abs(dx)) * max_step),
                    sums,
                )
        _fit(
            sums,
            least_moment,
            (gradient[0, start:end], gradient[1, start:end]),
            roughness[start:end],
        )


@kernel
def _reach(before, blocked, direction, reached):
    for x in range(blocked.size):
        reached[x] = before[x] & ~(blocked[x] >> direction)


@kernel
def _add(here, there, opposite, offset, limit, sums):
    dy, dx = offset
    for x in range(here.size):
        p, m = np.int32(there[0][x] - here[x]), np.int32(opposite[0][x] - here[x])
        is_p = np.int32(there[1][x]) & np.int32(abs(p) <= limit)
        is_m = np.int32(opposite[1][x]) & np.int32(abs(m) <= limit)
        p *= is_p
        m *= is_m
        # Sums of 1, x, y, xx, xy, yy, h, xh, yh, hh over the cells.
        sums[x] += is_p + is_m
        sums[PITCH + x] += dx * (is_p - is_m)
        sums[2 * PITCH + x] += dy * (is_p - is_m)
        sums[3 * PITCH + x] += dx * dx * (is_p + is_m)
        sums[4 * PITCH + x] += dx * dy * (is_p + is_m)
        sums[5 * PITCH + x] += dy * dy * (is_p + is_m)
        sums[6 * PITCH + x] += p + m
        sums[7 * PITCH + x] += dx * (p - m)
        sums[8 * PITCH + x] += dy * (p - m)
        sums[9 * PITCH + x] += p * p + m * m


@kernel
def _fit(sums, least_moment, gradient, roughness):
    gradient_x, gradient_y = gradient
    for i in range(roughness.size):
        n = np.float64(sums[i])
        x, y, h = sums[PITCH + i] / n, sums[2 * PITCH + i] / n, sums[6 * PITCH + i] / n
        # Scatter about the mean: of the positions, with the heights, of the heights.
        xx = sums[3 * PITCH + i] - n * x * x
        xy = sums[4 * PITCH + i] - n * x * y
        yy = sums[5 * PITCH + i] - n * y * y
        xh = sums[7 * PITCH + i] - n * x * h
        yh = sums[8 * PITCH + i] - n * y * h
        hh = sums[9 * PITCH + i] - n * h * h
        # The largest and the least second moment: eigenvalues of [xx xy; xy yy].
        centre, half = 0.5 * (xx + yy), math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
        most, least = centre + half, centre - half
        determinant = xx * yy - xy * xy
        gx, gy = (xh * yy - yh * xy) / determinant, (yh * xx - xh * xy) / determinant
        is_plane, is_strip = least >= least_moment, most >= least_moment
        # Of a strip only the gradient along it: (xh, yh) projected on that direction.
        scale = 1.0 / (2.0 * half * most)
        along_x = ((xx - least) * xh + xy * yh) * scale
        along_y = (xy * xh + (yy - least) * yh) * scale
        gx = gx if is_plane else (along_x if is_strip else 0.0)
        gy = gy if is_plane else (along_y if is_strip else 0.0)
        gradient_x[i], gradient_y[i] = gx, gy
        explained = gx * xh + gy * yh
        roughness[i] = math.sqrt(max(hh - explained, 0.0) / n)


def inflate(
    cost: NDArray[np.int8], disc: Footprint, *, occupied: int, inflated: int
) -> NDArray[np.int8]:
    """Raise the cost of the known cells within a disc around occupied ones.

    Parameters
    ----------
    cost : (rows, columns) int8
        Negative: unknown.
    disc : Footprint
    occupied : int
        The cost of occupied cells.
    inflated : int
        The cost of the cells around them.
    """
    is_occupied = np.pad(cost == occupied, disc.radius)
    is_near = np.zeros(is_occupied.shape, np.bool_)
    offsets = disc.offsets @ (is_occupied.shape[1], 1)
    _spread(is_occupied.ravel(), offsets, is_near.ravel())
    is_near = cropped(is_near, disc.radius)
    return np.where(is_near & (cost >= 0) & (cost != occupied), np.int8(inflated), cost)


@kernel
def _spread(is_occupied, offsets, is_near):
    margin = offsets.max()
    for start in range(margin, is_near.size - margin, STRETCH):
        end = min(start + STRETCH, is_near.size - margin)
        for offset in offsets:
            _unite(is_occupied[start + offset : end + offset], is_near[start:end])


@kernel
def _unite(values, result):
    for x in range(result.size):
        result[x] |= values[x]
