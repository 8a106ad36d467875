# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small worlds to plan over, and where in them the middle of a disc may be."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from literal_transitions import AROUND
from scipy import ndimage
from small_terrain import height_map

from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.planning.graph import transition_graph
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.planning.planner import Planner

CELL = 0.125
ANY_TIME = 600.0


def route_planner(height_cm, known=None, *, radius=0.5, origin=(0.0, 0.0), **values):
    terrain = TraversabilityParams(robot_radius=radius)
    params = PlannerParams(**({"timeout": ANY_TIME} | values))
    graph = transition_graph(height_map(height_cm, known, CELL, origin), terrain, params)
    return Planner(graph, terrain, params)


def center(cell, yaw=None):
    return Pose2D(x=(cell[1] + 0.5) * CELL, y=(cell[0] + 0.5) * CELL, yaw=yaw)


@dataclass
class World:
    """Level ground with boxes, a low kerb, holes; and where the middle of a disc may be."""

    height: np.ndarray
    known: np.ndarray
    radius: float
    margin: float

    @classmethod
    def random(cls, rng, side=40):
        height = np.zeros((side, side), np.int16)
        known = np.ones((side, side), bool)
        height[:, int(rng.integers(side)) :] += 5  # a kerb that the robot climbs
        for _ in range(rng.integers(0, 9)):
            iy, ix = rng.integers(0, side, 2)
            rows, columns = rng.integers(1, 4), rng.integers(1, 25)
            if rng.random() < 0.5:
                rows, columns = columns, rows
            height[iy : iy + rows, ix : ix + columns] += rng.choice([40, 150, -60])
        for _ in range(rng.integers(0, 3)):
            iy, ix = rng.integers(0, side, 2)
            known[iy : iy + rng.integers(1, 7), ix : ix + rng.integers(1, 7)] = False
        radius = float(rng.choice([0.15, 0.3, 0.45]))
        return cls(height, known, radius, float(rng.choice([0.0, 0.2])))

    @property
    def occupied(self):
        """Known cells beside a known one that is more than 10 cm lower."""
        rows, columns = self.height.shape
        around = np.pad(np.where(self.known, self.height, 30000).astype(int), 1, mode="edge")
        beside = [around[1 + dy : 1 + dy + rows, 1 + dx : 1 + dx + columns] for dy, dx in AROUND]
        return self.known & (self.height - np.min(beside, axis=0) > 10)

    @property
    def enterable(self):
        forbidden = np.pad(~self.known, 1, constant_values=True)
        away = ndimage.distance_transform_edt(~forbidden)[1:-1, 1:-1] * CELL
        result = away > self.margin + 1e-9
        if self.occupied.any():
            result &= ndimage.distance_transform_edt(~self.occupied) * CELL > self.radius + 1e-9
        return result

    def planner(self, **values):
        return route_planner(
            self.height, self.known, radius=self.radius, unknown_margin=self.margin, max_gap=0.0,
            **values,
        )  # fmt: skip


def random_place(rng, enterable, is_enterable=True):
    """In an enterable cell, somewhere; or anywhere."""
    cells = np.argwhere(enterable)
    if not len(cells) or not is_enterable:
        cells = np.argwhere(np.ones_like(enterable))
    y, x = (cells[rng.integers(len(cells))] + rng.random(2)) * CELL
    return Pose2D(x=x, y=y, yaw=rng.choice([None, rng.uniform(-math.pi, math.pi)]))
