# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tour of a robot that knows the world beforehand: what an exploration is held against."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from heightmap25d_ros.simulation import goals, truth
from heightmap25d_ros.simulation.robot import HEIGHT
from heightmap25d_ros.simulation.worlds import World

SPACING = 6  # [cells] between the places
SIGHT, BLIND, SENSOR, START_RADIUS = 5.0, 1.4, 0.6, 1.5  # [m]
CELL = truth.RESOLUTION


def reachable_ground(world: World) -> tuple[NDArray[np.float64], NDArray[np.bool_], tuple]:
    """True heights (infinite: closed), where the robot's middle may be, and the start's cell."""
    surface = truth.Surface(world)
    _, ground, clearance = surface.heights(0.0)
    height = np.where(clearance < HEIGHT, np.inf, ground)
    free = goals.free(height, goals.RADIUS)
    start = tuple(np.floor(-np.array(surface.origin[::-1]) / CELL).astype(int))
    parts, _ = ndimage.label(free, np.ones((3, 3)))
    near = np.argwhere(free)
    nearest = tuple(near[np.hypot(*(near - start).T).argmin()])
    return height, parts == parts[nearest], nearest


def tour_length(world: World, share: float) -> tuple[float, int]:
    """Length [m] of the way to places that show a share of the ground, and their number."""
    height, reachable, start = reachable_ground(world)
    lattice = np.zeros_like(reachable)
    lattice[::SPACING, ::SPACING] = True
    cells = [start, *map(tuple, np.argwhere(reachable & lattice))]
    shown = np.array([seen(height, cell)[reachable] for cell in cells])
    ground = np.argwhere(reachable)
    covered = shown[0] | (np.hypot(*(ground - start).T) * CELL < START_RADIUS)
    chosen = [0]
    while covered.mean() < share:
        gain = (shown & ~covered).sum(axis=1)
        if not gain.any():
            break
        chosen.append(int(gain.argmax()))
        covered |= shown[chosen[-1]]
    distance = distances(reachable, [cells[n] for n in chosen])
    return two_opt(distance), len(chosen)


def seen(height: NDArray[np.float64], cell: tuple) -> NDArray[np.bool_]:
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


def distances(reachable: NDArray[np.bool_], cells: list) -> NDArray[np.float64]:
    """(N, N) [m]: shortest ways between cells over the reachable ones."""
    index = np.full(reachable.shape, -1)
    index[reachable] = np.arange(reachable.sum())
    rows, columns, lengths = [], [], []
    height, width = reachable.shape
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = index[: height - dy, max(0, -dx) : width - max(0, dx)]
        there = index[dy:, max(0, dx) : width - max(0, -dx)]
        both = (here >= 0) & (there >= 0)
        rows.append(here[both])
        columns.append(there[both])
        lengths.append(np.full(both.sum(), CELL * math.hypot(dy, dx)))
    entries = np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))
    graph = coo_matrix(entries, shape=(reachable.sum(),) * 2).tocsr()
    nodes = [int(index[cell]) for cell in cells]
    return dijkstra(graph, directed=False, indices=nodes)[:, nodes]


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
