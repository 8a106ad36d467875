# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The definitions of obstacles and cost again, as slowly and literally as they are written.

One cell after the other over a dictionary of the known heights, planes by numpy's eigenvectors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

AROUND = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))


def back_to_the_centre(dy, dx):
    """The cell before (dy, dx) on the straight line from the centre, halves towards the centre."""
    steps = max(abs(dy), abs(dx))
    exact = (Fraction(component * (steps - 1), steps) for component in (dy, dx))
    return tuple(
        math.ceil(abs(component) - Fraction(1, 2)) * (1 if component > 0 else -1)
        for component in exact
    )


@dataclass
class LiteralTerrain:
    """Heights in centimetres, the radius in cells."""

    heights: dict[tuple[int, int], int]
    max_step: int
    radius_squared: float

    @classmethod
    def of(cls, height, known, max_step, radius_squared):
        cells = {tuple(map(int, cell)): int(height[tuple(cell)]) for cell in np.argwhere(known)}
        return cls(cells, max_step, radius_squared)

    def disc(self):
        r = math.ceil(math.sqrt(self.radius_squared))
        span = range(-r, r + 1)
        return [(y, x) for y in span for x in span if y * y + x * x <= self.radius_squared]

    def is_blocked(self, a, b):
        both_known = a in self.heights and b in self.heights
        return both_known and abs(self.heights[a] - self.heights[b]) > self.max_step

    def blocked(self, cell):
        return sum(
            2**k
            for k, (dy, dx) in enumerate(AROUND)
            if self.is_blocked(cell, (cell[0] + dy, cell[1] + dx))
        )

    def neighbours(self, cell):
        around = ((cell[0] + dy, cell[1] + dx) for dy, dx in AROUND)
        return [neighbour for neighbour in around if neighbour in self.heights]

    def is_upper_end(self, cell):
        return any(
            self.is_blocked(cell, neighbour) and self.heights[cell] > self.heights[neighbour]
            for neighbour in self.neighbours(cell)
        )

    def largest_step(self, cell):
        steps = [
            abs(self.heights[cell] - self.heights[neighbour])
            for neighbour in self.neighbours(cell)
            if not self.is_blocked(cell, neighbour)
        ]
        return max(steps, default=0)

    def way_is_open(self, cell, offset):
        while offset != (0, 0):
            before = back_to_the_centre(*offset)
            here, there = ((cell[0] + dy, cell[1] + dx) for dy, dx in (before, offset))
            if self.is_blocked(here, there):
                return False
            offset = before
        return True

    def ground(self, cell):
        """(x, y, h) of the cells under the disc that belong to the ground of its centre."""
        return [
            (dx, dy, self.heights[cell[0] + dy, cell[1] + dx])
            for dy, dx in self.disc()
            if (cell[0] + dy, cell[1] + dx) in self.heights
            and abs(self.heights[cell[0] + dy, cell[1] + dx] - self.heights[cell])
            <= self.max_step * max(abs(dy), abs(dx))
            and self.way_is_open(cell, (dy, dx))
        ]

    def plane(self, cell):
        """(gradient, roughness, whether the choice of directions hangs on the last bits)."""
        ground = np.array(self.ground(cell), float)
        x = ground[:, :2] - ground[:, :2].mean(axis=0)
        h = ground[:, 2] - ground[:, 2].mean()
        least = max(sum(dy * dy for dy, _ in self.disc()) / 16, 0.1)
        moments, directions = np.linalg.eigh(x.T @ x)
        gradient = np.zeros(2)
        for moment, direction in zip(moments, directions.T, strict=True):
            if moment >= least:
                gradient += direction * (direction @ x.T @ h) / moment
        roughness = np.sqrt(np.mean((h - x @ gradient) ** 2))
        is_undecided = np.abs(moments - least).min() < 1e-9
        return math.hypot(*gradient), roughness, is_undecided
