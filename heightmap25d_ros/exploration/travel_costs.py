# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The costs of all ways from the robot, by one search.

They are those of the way back to the robot: on slopes those of the way there differ a little, where
one of the two exists so does the other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import Area, Cell
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.level_graph import LevelGraph, Place
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.planning.search import CostToGo, cost_to_go, to_cell
from heightmap25d_ros.planning.start_clearing import ClearedStart, clear_start

_Search = Callable[[Cell], list[CostToGo]]


def travel_costs(graph: TransitionGraph, robot: Pose2D, params: Params) -> NDArray[np.float64]:
    """(rows, columns) [m of flat ground]: between the robot and each cell; infinite: no path.

    Parameters
    ----------
    graph : TransitionGraph
        It is changed meanwhile: the robot can leave from where it stands.
    robot : Pose2D
        Within the map.
    params : Params
    """

    def search(cell: Cell) -> list[CostToGo]:
        return [cost_to_go(graph.incoming, cell)]

    return np.asarray(_costs([graph], 0, robot, params, search)[0])


def travel_costs_over_levels(
    levels: LevelGraph,
    graphs: Sequence[TransitionGraph],
    start: Place,
    robot: Pose2D,
    params: Params,
) -> NDArray[np.float64]:
    """(slices, rows, columns): as `travel_costs`, over all slices of a map with several levels.

    Parameters
    ----------
    levels : LevelGraph
    graphs : sequence of TransitionGraph
        One a slice; changed meanwhile.
    start : Place
        Of the robot.
    robot : Pose2D
    params : Params
    """

    def search(cell: Cell) -> list[CostToGo]:
        return levels.cost_to_go(Place(start.slice, cell), graphs, np.inf)

    return _costs(graphs, start.slice, robot, params, search)


def _costs(
    graphs: Sequence[TransitionGraph], index: int, robot: Pose2D, params: Params, search: _Search
) -> NDArray[np.float64]:
    """The least costs in all graphs of searches from the robot, which is in one of them."""
    graph = graphs[index]
    cell = to_cell(graph.geometry.cell_at((robot.x, robot.y)))
    around = Area(*cell, 1, 1).grown(_reach(params, graph.geometry.resolution)).within(graph.area)
    terrain, planner = params.traversability, params.planner
    cleared = clear_start(graph.part(around), robot, terrain, planner, is_robot_there=True)
    costs = np.full((len(graphs), *graph.geometry.shape), np.inf)
    with _replaced(graph, around, cleared.graph):
        for cost, source in _sources(cleared, around, cell):
            # From one exit the others that are connected with it are reached as well.
            if np.isinf(costs[(index, *source)]):
                for field, lowered in zip(search(source), costs, strict=True):
                    field.lower(lowered, cost)
    costs *= graph.geometry.resolution
    return costs


def _reach(params: Params, resolution: float) -> int:
    """More than what `clear_start` looks at around the robot [cells]."""
    terrain, planner = params.traversability, params.planner
    margin = max(terrain.robot_radius, planner.unknown_margin)
    half = math.hypot(planner.robot_length, planner.robot_width) / 2.0
    return math.ceil((half + 2.0 * margin) / resolution) + 8


def _sources(cleared: ClearedStart, part: Area, robot: Cell) -> list[tuple[float, Cell]]:
    """Cells that searches begin at, and their costs: the robot's own, or its exits by worth."""
    graph = cleared.graph
    if graph.enterable[robot[0] - part.iy, robot[1] - part.ix]:
        return [(0.0, robot)]
    order = np.argsort(cleared.costs + cleared.penalties)
    exits = [(float(cleared.costs[n]), to_cell(cleared.exits[n])) for n in order]
    return [
        (cost, (iy + part.iy, ix + part.ix)) for cost, (iy, ix) in exits if graph.enterable[iy, ix]
    ]


@contextmanager
def _replaced(graph: TransitionGraph, area: Area, part: TransitionGraph) -> Iterator[None]:
    """A graph with the transitions of a part of it: not a copy, since it may be large."""
    inner = graph.incoming[1:-1, 1:-1][area.slices(graph.area)]
    before = inner.copy()
    inner[:] = part.incoming[1:-1, 1:-1]
    try:
        yield
    finally:
        inner[:] = before
