# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rules of transitions again, as slowly and literally as they are written.

One transition after the other, plain Python numbers; lines by exact fractions; shortest ways by
scipy. Imports nothing that is tested.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

AROUND = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))


def steps_closed(shape, pairs):
    """Masks of transitions of which those between the cells of some pairs are blocked."""
    blocked = np.zeros(shape, np.uint8)
    for a, b in pairs:
        for here, there in ((a, b), (b, a)):
            k = AROUND.index((there[0] - here[0], there[1] - here[1]))
            blocked[here] |= np.uint8(1 << k)
    return blocked


def random_steps(rng, shape, share):
    """Symmetric masks of transitions of which about a share is blocked."""
    pairs = [
        (cell, (cell[0] + dy, cell[1] + dx))
        for cell in np.ndindex(shape)
        for dy, dx in AROUND[:4]
        if 0 <= cell[0] + dy < shape[0] and 0 <= cell[1] + dx < shape[1]
    ]
    return steps_closed(shape, [pair for pair in pairs if rng.random() < share])


def matrix(incoming):
    """The weighted graph, from cell to cell, of costs by the cell that a transition leads into."""
    rows, columns = incoming.shape[0] - 2, incoming.shape[1] - 2
    number = np.arange(rows * columns).reshape(rows, columns)
    padded = np.pad(number, 1, constant_values=-1)
    froms, intos, costs = [], [], []
    for k, (dy, dx) in enumerate(AROUND):
        before = padded[1 + dy : 1 + dy + rows, 1 + dx : 1 + dx + columns]
        cost = incoming[1:-1, 1:-1, k].astype(float)
        is_there = cost > 0
        assert (before[is_there] >= 0).all(), "a transition leads into the map from outside"
        froms.append(before[is_there])
        intos.append(number[is_there])
        costs.append(cost[is_there])
    graph = sparse.coo_matrix(
        (np.concatenate(costs), (np.concatenate(froms), np.concatenate(intos))),
        shape=(rows * columns, rows * columns),
    )
    return graph.tocsr()


def distances(incoming, goal):
    """(rows, columns): least cost from each cell to the goal by Dijkstra's search; -1: no way."""
    rows, columns = incoming.shape[0] - 2, incoming.shape[1] - 2
    away = csgraph.dijkstra(matrix(incoming).T, indices=goal[0] * columns + goal[1])
    return np.where(np.isinf(away), -1, away).reshape(rows, columns).astype(int)


def components(incoming):
    """(rows, columns): numbers of the parts that transitions connect, whatever their direction."""
    rows, columns = incoming.shape[0] - 2, incoming.shape[1] - 2
    _, labels = csgraph.connected_components(matrix(incoming), directed=False)
    return labels.reshape(rows, columns)


def rectangle_holds(pose, size, points):
    """Whether points (N, 2) as (y, x) are in a rectangle, behind all four of its edges; and
    whether that hangs on the last bits.

    The pose is y, x and heading, the size length (along the heading) and width.
    """
    y, x, heading = pose
    ahead = np.array([math.sin(heading), math.cos(heading)])
    left = np.array([math.cos(heading), -math.sin(heading)])
    corners = [
        np.array([y, x]) + sign_a * size[0] / 2 * ahead + sign_l * size[1] / 2 * left
        for sign_a, sign_l in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    inside, undecided = np.ones(len(points), bool), np.zeros(len(points), bool)
    for corner, after in zip(corners, corners[1:] + corners[:1], strict=True):
        edge = after - corner
        side = edge[1] * (points[:, 0] - corner[0]) - edge[0] * (points[:, 1] - corner[1])
        inside &= side >= 0
        undecided |= abs(side) < 1e-9
    return inside, undecided


def squares_overlap(pose, size, cells):
    """(N,) whether cells' squares overlap a rectangle: no axis of either separates their corners.

    The pose is y, x and heading, the size length (along the heading) and width.
    """
    y, x, heading = pose
    ahead = np.array([math.sin(heading), math.cos(heading)])
    left = np.array([math.cos(heading), -math.sin(heading)])
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    rectangle = [y, x] + signs[:, :1] * size[0] / 2 * ahead + signs[:, 1:] * size[1] / 2 * left
    squares = cells[:, None] + 0.5 + 0.5 * signs
    overlap = np.ones(len(cells), bool)
    for axis in (np.array([1.0, 0.0]), np.array([0.0, 1.0]), ahead, left):
        shadow, shadows = rectangle @ axis, squares @ axis
        overlap &= shadows.max(axis=1) > shadow.min() + 1e-6
        overlap &= shadows.min(axis=1) < shadow.max() - 1e-6
    return overlap


@dataclass
class LiteralGround:
    """Ground of cells, addressed by (row, column)."""

    enterable: Any
    blocked: Any
    gradient: Any
    weight: Any
    slope_weights: tuple[float, float, float]

    @classmethod
    def of(cls, graph):
        names = ("enterable", "blocked", "gradient", "weight", "slope_weights")
        return cls(*(getattr(graph, name) for name in names))

    def is_enterable(self, cell):
        rows, columns = self.enterable.shape
        return 0 <= cell[0] < rows and 0 <= cell[1] < columns and bool(self.enterable[cell])

    def is_step_blocked(self, a, b):
        k = AROUND.index((b[0] - a[0], b[1] - a[1]))
        return bool(int(self.blocked[a]) & 2**k)

    def is_open(self, a, b):
        """Both cells, and the step; across also both corners, and the steps to and from them."""
        if not (self.is_enterable(a) and self.is_enterable(b)) or self.is_step_blocked(a, b):
            return False
        if a[0] == b[0] or a[1] == b[1]:
            return True
        return all(
            self.is_enterable(corner)
            and not self.is_step_blocked(a, corner)
            and not self.is_step_blocked(b, corner)
            for corner in ((a[0], b[1]), (b[0], a[1]))
        )

    def rate(self, cells, dy, dx):
        """Cost per horizontal length in the direction (dy, dx), over the mean of some cells."""
        norm = math.hypot(dy, dx)
        slope_x, slope_y = (
            sum(float(self.gradient[axis][cell]) for cell in cells) / len(cells) for axis in (0, 1)
        )
        f = sum(float(self.weight[cell]) for cell in cells) / len(cells)
        s = (slope_x * dx + slope_y * dy) / norm
        c = (slope_x * dy - slope_y * dx) / norm
        climb, descent, cross = self.slope_weights
        up, down = max(s, 0.0), max(-s, 0.0)
        return f * math.sqrt(1 + s * s) + climb * up + descent * down + cross * abs(c)

    def cost(self, a, b):
        """Of a transition, in cells of flat ground."""
        dy, dx = b[0] - a[0], b[1] - a[1]
        return math.hypot(dy, dx) * self.rate([a, b], dy, dx)

    def pieces(self, start, end):
        """Cells that a line passes through, in order, each with its share of the line.

        Starts in the cell whose square [iy, iy + 1) x [ix, ix + 1) holds the start, and ends in
        the one that holds the end.
        """
        (y, x), (end_y, end_x) = ([Fraction(float(value)) for value in p] for p in (start, end))
        dy, dx = end_y - y, end_x - x
        crossings = {Fraction(0), Fraction(1)}
        for at, far in ((y, dy), (x, dx)):
            if far:
                low, high = sorted((at, at + far))
                borders = range(math.ceil(low), math.floor(high) + 1)
                crossings |= {(border - at) / far for border in borders}
        pieces = [((math.floor(y), math.floor(x)), Fraction(0))]
        for t, next_t in pairwise(sorted(crossings)):
            middle = (t + next_t) / 2
            cell = math.floor(y + middle * dy), math.floor(x + middle * dx)
            pieces.append((cell, next_t - t))
        pieces.append(((math.floor(end_y), math.floor(end_x)), Fraction(0)))
        return pieces

    def line_is_open(self, start, end):
        """Whether a line crosses open transitions between enterable cells only."""
        cells = [cell for cell, _ in self.pieces(start, end)]
        return self.is_enterable(cells[0]) and all(
            self.is_open(a, b) for a, b in pairwise(cells) if a != b
        )

    def line_cost(self, start, end):
        """Of a straight line, in cells of flat ground."""
        dy, dx = np.subtract(end, start)
        length = math.hypot(dy, dx)
        if not length:
            return 0.0
        return sum(
            float(share) * length * self.rate([cell], dy, dx)
            for cell, share in self.pieces(start, end)
            if share
        )
