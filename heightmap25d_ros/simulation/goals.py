# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pairs of start and goal that the robot's footprint can or cannot connect on a true surface.

Both are certain: a goal is reachable if a disc around the robot that is wider by a cell gets there,
and unreachable if its rectangle does not, whatever it does (see `footprint`). What is between the
two depends on cells and margins, and is no goal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import tan
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.simulation import footprint

RADIUS, MAX_STEP, MAX_SLOPE = 0.5, 0.10, 0.44
"""Radius of the disc that covers the robot [m]; limits of what it climbs [m], [rad]."""

WANTED = 20
"""Largest number of pairs of either kind."""

_CELL = 0.125
_MARGIN = 0.125
_THINNED = 2  # samples in a row of the surface, of which one counts for the rectangle
_EVERYWHERE = np.ones((3, 3), bool)

Mask = NDArray[np.bool_]
Cells = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Pairs:
    """Cells (N, 3) as (level, row, column) of starts and goals, and whether paths connect them.

    ``observed``: cells that the lasers
    measured connect them; ``footprint_observed``: so do cells whose whole disc was measured.
    """

    start: Cells
    goal: Cells
    reachable: Mask
    observed: Mask
    footprint_observed: Mask


def choose(
    height: Array, samples: Array, seen: Mask, driven: Cells, z: Array, rng: np.random.Generator
) -> Pairs:
    """Draw pairs.

    Parameters
    ----------
    height : (levels, rows, columns) float64 [m]
        Of the ground, as a robot on each level has it around itself; infinite: closed. Where two
        levels have the same height in a cell, it is the same ground.
    samples : (levels, rows * n, columns * n) float64 [m]
        The same at n x n points in each cell, of which the cell is the highest.
    seen : (levels, rows, columns) bool
    driven : (N, 2) int64
        Cells of the robot's trajectory, from which starts are drawn.
    z : (N,) float64 [m]
        The robot's height there.
    rng : numpy.random.Generator
    """
    wide, exact = (_each(free, height, RADIUS + d) for d in (_MARGIN, 0.0))
    off = np.abs(height[:, driven[:, 0], driven[:, 1]] - z)
    driven = np.column_stack([off.argmin(axis=0), driven])
    driven = driven[wide[tuple(driven.T)]]
    parts = _parts(wide, height)
    main = np.bincount(parts[tuple(driven.T)]).argmax()
    driven = driven[parts[tuple(driven.T)] == main]
    stands, is_joined = _reached(height, samples, tuple(driven[0]))
    is_same = np.zeros_like(seen)
    is_same[1:] = height[1:] == height[:-1]  # the same ground counts once
    is_joined[:-1] |= is_same[1:] & is_joined[1:]  # beside an edge that it does not have above
    apart = seen & np.isfinite(height) & ~is_same & ~is_joined
    reachable = _drawn(np.argwhere(seen & ~is_same & (parts == main)), rng)
    # Where the robot can stand first; cells beside and on obstacles if there are too few.
    unreachable = np.concatenate(
        [_drawn(np.argwhere(apart & is_free), rng) for is_free in (stands, ~stands)]
    )[:WANTED]
    goal = np.concatenate([reachable, unreachable])
    start = driven[rng.integers(0, len(driven), len(goal))]
    is_reachable = np.arange(len(goal)) < len(reachable)
    seen_cells = _parts(exact & seen, height)
    whole = _each(_whole_discs, seen)
    seen_discs = _parts(exact & whole, height)
    return Pairs(
        start,
        goal,
        is_reachable,
        is_reachable & _connected(seen_cells, start, goal),
        is_reachable & _connected(seen_discs, start, goal),
    )


def _reached(height: Array, samples: Array, start: tuple[int, int, int]) -> tuple[Mask, Mask]:
    """Cells in whose middle the robot can stand, and those of them that it reaches from a start."""
    each = samples.shape[1] // height.shape[1]
    faces = footprint.faces(samples, MAX_STEP)
    is_near = _each(_near, footprint.by_cell(faces, each))
    is_steep = _each(_steep, height) & ~is_near
    sides = each // _THINNED
    level, *cell = start
    middle = np.s_[:, sides // 2 :: sides, sides // 2 :: sides]
    found = footprint.reached(
        samples[:, ::_THINNED, ::_THINNED],
        footprint.by_cell(faces, _THINNED),
        is_steep.repeat(sides, axis=1).repeat(sides, axis=2),
        _CELL / sides,
        (level, *(index * sides + sides // 2 for index in cell)),
    )
    return found[0][middle], found[1][middle]


def _near(faces: Mask) -> Mask:
    """Cells in whose disc the ground is not all that a plane would be laid through."""
    return np.asarray(ndimage.distance_transform_edt(~faces) * _CELL <= RADIUS + _CELL)


def _whole_discs(seen: Mask) -> Mask:
    """Cells around which all cells of a disc are seen."""
    return np.asarray(ndimage.distance_transform_edt(seen) * _CELL > RADIUS)


def _each(function: Callable[..., Mask], levels: NDArray[Any], *arguments: float) -> Mask:
    return np.stack([np.asarray(function(level, *arguments)) for level in levels])


def _parts(is_open: Mask, height: Array) -> NDArray[np.int64]:
    """Numbers of the connected parts of all levels, 0 where closed."""
    labels = np.zeros(is_open.shape, np.int64)
    for number, level in enumerate(is_open):
        found, count = ndimage.label(level, _EVERYWHERE)
        labels[number] = np.where(found > 0, found + labels.max(), 0)
    shared = is_open[1:] & is_open[:-1] & (height[1:] == height[:-1])
    pairs = labels[1:][shared], labels[:-1][shared]
    count = int(labels.max()) + 1
    graph = coo_array((np.ones(len(pairs[0])), pairs), (count, count))
    _, joined = connected_components(graph, directed=False)
    return np.where(labels > 0, joined[labels] + 1, 0)


def free(height: Array, radius: float) -> Mask:
    """Cells that may contain the centre of a disc: no step within it, no steep slope below it.

    Parameters
    ----------
    height : (rows, columns) float64 [m]
    radius : float [m]
    """
    is_far = np.asarray(ndimage.distance_transform_edt(~_beside_steps(height)) * _CELL > radius)
    return is_far & ~_steep(height)


def _steep(height: Array) -> Mask:
    return np.asarray(_slope(height, RADIUS) > tan(MAX_SLOPE))


def _beside_steps(height: Array) -> Mask:
    """Cells with a step to a neighbour, or at the border."""
    closed = np.where(np.isfinite(height), height, 1e6)
    padded = np.pad(closed, 1, constant_values=1e6)
    rows, columns = height.shape
    result = ~np.isfinite(height)
    for dy in range(3):
        for dx in range(3):
            result |= np.abs(padded[dy : dy + rows, dx : dx + columns] - closed) > MAX_STEP
    return result


def _slope(height: Array, radius: float) -> Array:
    """Slope of the least-squares plane over the disc around each cell, as a tangent."""
    reach = int(radius / _CELL)
    dy, dx = np.mgrid[-reach : reach + 1, -reach : reach + 1] * _CELL
    disc = np.hypot(dy, dx) <= radius
    weight = (dx * disc) / (dx**2 * disc).sum()
    filled = np.where(np.isfinite(height), height, 0.0)
    along_x = ndimage.correlate(filled, weight, mode="nearest")
    along_y = ndimage.correlate(filled, weight.T, mode="nearest")
    return np.asarray(np.hypot(along_x, along_y))


def _drawn(cells: Cells, rng: np.random.Generator) -> Cells:
    return rng.permutation(cells)[:WANTED]


def _connected(parts: NDArray[np.int64], start: Cells, goal: Cells) -> Mask:
    here, there = parts[tuple(start.T)], parts[tuple(goal.T)]
    return np.asarray((here == there) & (here > 0))
