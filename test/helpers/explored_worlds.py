# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot without wheels in small worlds: it appears where it is sent, and sees what it must."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from heightmap25d_ros.exploration.explorer import Choice, Explorer
from heightmap25d_ros.exploration.survey import Survey
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.boundary import Boundary
from heightmap25d_ros.planning.plan import Pose2D

CELL = 0.125
START_RADIUS, SIGHT, SENSOR = 1.6, 5.0, 0.6  # [m]


def seen(height, cell, *, blind=0.0):
    """Cells of a true surface that a full turn at a cell shows: each one's own line of sight."""
    iy, ix = np.indices(height.shape)
    away = np.hypot(iy - cell[0], ix - cell[1])
    eye = height[cell] + SENSOR
    result = np.zeros(height.shape, bool)
    there = np.argwhere((away <= SIGHT / CELL) & (away >= blind / CELL))
    share = np.linspace(0.0, 1.0, math.ceil(2 * SIGHT / CELL) + 1)[1:]
    steps = (there - cell)[:, :, None] * share
    y, x = (np.floor(cell[n] + 0.5 + steps[:, n]).astype(int) for n in (0, 1))
    line = eye + share * (height[tuple(there.T)] - eye)[:, None]
    is_there = (y == there[:, :1]) & (x == there[:, 1:])
    result[tuple(there.T)] = ((height[y, x] <= line + 1e-6) | is_there).all(axis=1)
    return result


@dataclass
class Visit:
    """What became of an exploration."""

    explorer: Explorer
    known: np.ndarray
    places: list[Pose2D] = field(default_factory=list)
    survey: Survey | None = None
    choice: Choice | None = None

    @property
    def has_ended(self):
        return self.choice is not None and self.choice.goal is None


def explore(height, start, *, boundary=(), hidden=None, params=None, most=40):
    """Explore a true surface (rows, columns) [m] from (x, y) [m].

    ``hidden`` cells are never seen.
    """
    height = np.asarray(height, float)
    hidden = np.zeros(height.shape, bool) if hidden is None else hidden
    iy, ix = np.indices(height.shape)
    x, y = (ix + 0.5) * CELL, (iy + 0.5) * CELL
    robot = Pose2D(*start, yaw=0.0)
    known = np.hypot(x - robot.x, y - robot.y) <= START_RADIUS
    known &= np.abs(height - height[int(robot.y / CELL), int(robot.x / CELL)]) < 0.05
    visit = Visit(Explorer(params or Params(), Boundary.of(boundary)), known)
    for _ in range(most):
        visit.places.append(robot)
        cell = int(robot.y / CELL), int(robot.x / CELL)
        visit.known |= seen(height, cell) & ~hidden
        shown = HeightMap.from_metres(np.where(visit.known, height, np.nan), resolution=CELL)
        survey = visit.explorer.survey(shown, robot)
        visit.explorer.note_look(survey)
        visit.survey = visit.explorer.survey(shown, robot)
        visit.choice = visit.explorer.choose(visit.survey)
        if visit.choice.goal is None:
            break
        robot = Pose2D(visit.choice.goal.x, visit.choice.goal.y, yaw=0.0)
    return visit


def at(height, x, y):
    """The cells (rows, columns) of a surface between two x and two y [m], as an index."""
    columns, rows = (slice(round(low / CELL), round(high / CELL)) for low, high in (x, y))
    return rows, columns
