# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tour of a robot that knows the world beforehand: what an exploration is held against."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from heightmap25d_ros.simulation import goals, truth
from heightmap25d_ros.simulation.robot import HEIGHT
from heightmap25d_ros.simulation.worlds import World

SPACING = 6  # [cells] between the places
SIGHT, BLIND, SENSOR, START_RADIUS = 5.0, 1.4, 0.6, 1.5  # [m]
CELL = truth.RESOLUTION

Heights = NDArray[np.float64]
Mask = NDArray[np.bool_]
Cell = tuple[int, int, int]
"""Level, row and column."""


def reachable_ground(world: World) -> tuple[Heights, Mask, Cell]:
    """Where the robot's middle may be, on all levels.

    Returns
    -------
    height : (levels, rows, columns) float64 [m]
        Infinite: closed.
    reachable : (levels, rows, columns) bool
        Ground that two levels share counts on the lower one.
    start : (level, row, column)
    """
    surface = truth.Surface(world)
    top, ground, clearance = surface.heights(0.0)
    if world.has_decks:
        height = truth.Levels(ground, ground + clearance).drivable(top, HEIGHT)
    else:
        height = np.where(clearance < HEIGHT, np.inf, ground)[None]
    free = np.stack([goals.free(level, goals.RADIUS) for level in height])
    cell = np.floor(-np.array(surface.origin[::-1]) / CELL).astype(int)
    near = np.argwhere(free[0])
    start = (0, *map(int, near[np.hypot(*(near - cell).T).argmin()]))
    graph, index = ways(free, height)
    _, parts = connected_components(graph, directed=False)
    reachable = free & (parts[index] == parts[index[start]])
    reachable[1:] &= ~(reachable[:-1] & (height[1:] == height[:-1]))
    return height, reachable, start


def tour_length(world: World, share: float) -> tuple[float, int]:
    """Length [m] of the way to places that show a share of the ground, and their number."""
    height, reachable, start = reachable_ground(world)
    lattice = np.zeros_like(reachable)
    lattice[:, ::SPACING, ::SPACING] = True
    cells = [start, *map(tuple, np.argwhere(reachable & lattice))]
    shown = np.array([shown_from(height, cell)[reachable] for cell in cells])
    ground = np.argwhere(reachable)
    is_near = np.hypot(*(ground[:, 1:] - start[1:]).T) * CELL < START_RADIUS
    covered = shown[0] | (is_near & (ground[:, 0] == start[0]))
    chosen = [0]
    while covered.mean() < share:
        gain = (shown & ~covered).sum(axis=1)
        if not gain.any():
            break
        chosen.append(int(gain.argmax()))
        covered |= shown[chosen[-1]]
    distance = distances(height, reachable, [cells[n] for n in chosen])
    return two_opt(distance), len(chosen)


def shown_from(height: Heights, cell: Cell) -> Mask:
    """(levels, rows, columns): cells of its level, and shared ones, that a full turn shows."""
    level, *there = cell
    shown = seen(height[level], tuple(there))
    return shown & (height == height[level])


def seen(height: Heights, cell: tuple[int, int]) -> Mask:
    """(rows, columns): cells that a full turn at a cell shows, each by its own line of sight."""
    iy, ix = np.indices(height.shape)
    away = np.hypot(iy - cell[0], ix - cell[1]) * CELL
    there = np.argwhere((away <= SIGHT) & (away >= BLIND) & np.isfinite(height))
    share = np.linspace(0.0, 1.0, math.ceil(1.4 * SIGHT / CELL) + 1)[1:]
    steps = (there - cell)[:, :, None] * share
    y, x = (np.floor(cell[n] + 0.5 + steps[:, n]).astype(int) for n in (0, 1))
    eye = height[cell] + SENSOR
    line = eye + share * (height[tuple(there.T)] - eye)[:, None]
    is_there = (y == there[:, :1]) & (x == there[:, 1:])
    result = np.zeros(height.shape, bool)
    result[tuple(there.T)] = ((height[y, x] <= line + 0.02) | is_there).all(axis=1)
    return result


def distances(height: Heights, reachable: Mask, cells: list[Cell]) -> NDArray[np.float64]:
    """(N, N) [m]: shortest ways between cells over the ground, on all levels."""
    shared = np.zeros_like(reachable)
    shared[1:] = reachable[:-1] & (height[1:] == height[:-1])
    graph, index = ways(reachable | shared, height)
    nodes = [int(index[cell]) for cell in cells]
    return dijkstra(graph, directed=False, indices=nodes)[:, nodes]


def ways(free: Mask, height: Heights) -> tuple[csr_matrix, NDArray[np.int64]]:
    """The graph of neighbouring free cells [m], and the node of each cell (-1: none).

    From level to level a way is so short as to be none, where both have the same ground.
    """
    index = np.full(free.shape, -1)
    index[free] = np.arange(free.sum())
    rows, columns = free.shape[1:]
    pairs = [(index[1:][height[1:] == height[:-1]], index[:-1][height[1:] == height[:-1]], 1e-9)]
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = index[:, : rows - dy, max(0, -dx) : columns - max(0, dx)]
        there = index[:, dy:, max(0, dx) : columns - max(0, -dx)]
        pairs.append((here.ravel(), there.ravel(), CELL * math.hypot(dy, dx)))
    one, other, length = (
        np.concatenate(part)
        for part in zip(*[(a, b, np.full(len(a), metres)) for a, b, metres in pairs], strict=True)
    )
    is_way = (one >= 0) & (other >= 0)
    entries = length[is_way], (one[is_way], other[is_way])
    return coo_matrix(entries, shape=(free.sum(),) * 2).tocsr(), index


def two_opt(distance: NDArray[np.float64]) -> float:
    """Length of an open way from place 0 through all others: nearest next one, then 2-opt."""
    order, left = [0], set(range(1, len(distance)))
    while left:
        order.append(min(left, key=lambda n: distance[order[-1], n]))
        left.remove(order[-1])

    def length(way):
        return float(distance[way[:-1], way[1:]].sum())

    is_better = True
    while is_better:
        is_better = False
        for i in range(1, len(order) - 1):
            for j in range(i + 1, len(order)):
                new = order[:i] + order[i : j + 1][::-1] + order[j + 1 :]
                if length(new) < length(order) - 1e-9:
                    order, is_better = new, True
    return length(order)
