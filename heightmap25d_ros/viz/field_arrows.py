# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The planner's field as arrows; without matplotlib, which a planning node need not import."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.search import UNREACHABLE, CostToGo
from heightmap25d_ros.terrain.steps import NEIGHBOURS

MAX_ARROWS = 1500
"""Largest number of arrows; larger fields are shown by every second, third, ... cell."""

ARROW_SPACING = 0.5
"""Least distance between arrows [m]."""


def field_arrows(graph: TransitionGraph, cost_to_go: CostToGo) -> NDArray[np.float64]:
    """Poses (N, 4, 4) [m], map, of cells, in the direction of their cheapest path.

    Parameters
    ----------
    graph : TransitionGraph
    cost_to_go : CostToGo
        In that graph.
    """
    reached = cost_to_go.dense() != UNREACHABLE
    every = max(1, round(ARROW_SPACING / graph.geometry.resolution))
    while reached[::every, ::every].sum() > MAX_ARROWS:
        every += 1
    cells = np.argwhere(reached[::every, ::every]) * every
    steps = np.array([cost_to_go.direction((int(iy), int(ix))) for iy, ix in cells], np.int64)
    cells, steps = cells[steps >= 0], steps[steps >= 0]  # the goal has no direction
    dy, dx = np.array(NEIGHBOURS)[steps].T
    poses = np.zeros((len(cells), 6))
    poses[:, :2] = graph.geometry.cell_center(cells)
    # Where no known cell is near they are at ground zero.
    poses[:, 2] = np.nan_to_num(graph.height[tuple(cells.T)]) + graph.geometry.ground_zero
    poses[:, 5] = np.arctan2(dy, dx)
    return se3.from_xyz_rpy(poses)
