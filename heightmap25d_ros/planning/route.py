# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cheapest routes over the cells, from a start that may lie within the inflation of obstacles."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import Area, Cell
from heightmap25d_ros.planning.plan import Pose2D, in_cells
from heightmap25d_ros.planning.search import (
    STRAIGHT,
    CostToGo,
    SearchTimeoutError,
    cost_to_go,
    to_cell,
)
from heightmap25d_ros.planning.start_clearing import ClearedStart, offsets


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Route:
    """A cheapest path over the cells.

    Attributes
    ----------
    cost_to_go : CostToGo
    cells : (N, 2) int64
    cost : float [cells of flat ground]
        With the line to the first cell, where it is an exit.
    is_exit : bool
        Whether it begins at one of `ClearedStart.exits` in place of the start.
    """

    cost_to_go: CostToGo
    cells: NDArray[np.int64]
    cost: float
    is_exit: bool


def cheapest_route(
    cleared: ClearedStart, start: Cell, goal: Cell, deadline: float, is_field_wanted: bool
) -> Route | None:
    """The cheapest route from a start, or from one of its exits; None where there is none.

    Parameters
    ----------
    cleared : ClearedStart
    start, goal : (row, column)
    deadline : float [s]
        Of `time.monotonic`.
    is_field_wanted : bool
        Whether the cost to go is needed everywhere; otherwise the search is A* where it can be.

    Raises
    ------
    SearchTimeoutError
    """
    graph = cleared.graph
    is_outside = bool(graph.enterable[start])
    is_guided = is_outside and not is_field_wanted
    field = cost_to_go(graph.incoming, goal, start=start if is_guided else None, deadline=deadline)
    if time.monotonic() > deadline:  # a small map is searched within one slice
        raise SearchTimeoutError
    first, cost = start, 0.0
    if not is_outside and not len(cleared.exits):
        return None
    if not is_outside:
        remaining = np.array([field[to_cell(cell)] for cell in cleared.exits])
        costs = np.where(remaining >= 0, cleared.costs + remaining / STRAIGHT, np.inf)
        best = int((costs + cleared.penalties).argmin())
        first, cost = to_cell(cleared.exits[best]), float(cleared.costs[best])
    cells = field.cheapest_path(first)
    if not len(cells):
        return None
    cost += field[first] / STRAIGHT
    return Route(cost_to_go=field, cells=cells, cost=cost, is_exit=not is_outside)


def nearest_reachable(
    cleared: ClearedStart, start: Cell, goal: Pose2D, tolerance: float, deadline: float
) -> Cell | None:
    """The cell nearest to a goal, within a tolerance [m], that is connected with the start."""
    if not tolerance:
        return None
    graph = cleared.graph
    resolution = graph.geometry.resolution
    row, column = graph.geometry.cell_at((goal.x, goal.y))
    area = Area(int(row), int(column), 1, 1).grown(math.ceil(tolerance / resolution) + 1)
    area = area.within(graph.area)
    *_, distance = offsets(area, *in_cells(goal, graph.geometry))
    is_connected = np.zeros(graph.geometry.shape, np.bool_)
    # Every transition can be driven in both directions, at different costs.
    for first in [start] if graph.enterable[start] else map(to_cell, cleared.exits):
        if graph.enterable[first] and not is_connected[first]:
            field = cost_to_go(graph.incoming, first, deadline=deadline)
            is_connected |= field.remaining[1:-1, 1:-1] != 0
    is_candidate = is_connected[area.slices(graph.area)]
    is_candidate &= distance * resolution <= tolerance
    if not is_candidate.any():
        return None
    iy, ix = np.unravel_index(np.where(is_candidate, distance, np.inf).argmin(), area.shape)
    return int(iy) + area.iy, int(ix) + area.ix
