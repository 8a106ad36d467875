# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map with several levels as a few graphs that are joined where they are the same place.

A `TransitionGraph` has one surface per cell. A map with several levels is a few slices of that
kind (`terrain.slices`), each with its own graph: so obstacles, inflation, gaps and slopes are those
of the slice, and never of a level above or below, and a map of one level stays what it is. Where
two slices hold the same surface of a cell, a path may change between them at no cost. For a search
the graphs are laid one below the other in one array, with these links.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import Cell, HeightMap
from heightmap25d_ros.params.sections import LevelsParams, PlannerParams, TraversabilityParams
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.kept_graph import KeptGraphs
from heightmap25d_ros.planning.search import LARGEST_SIDE, CostToGo, cost_to_go, to_cell
from heightmap25d_ros.terrain.slices import SurfaceStack


@dataclass(frozen=True, slots=True)
class Place:
    """A cell of a slice."""

    slice: int
    cell: Cell


class LevelGraph:
    """The transition graphs of the slices of a map.

    Parameters
    ----------
    height_map : HeightMap
    levels : LevelsParams, optional
    terrain : TraversabilityParams, optional
    params : PlannerParams, optional
    graph_of : function, optional
        Makes the graph of a slice, by its number and its map; `KeptGraphs.of` by default.

    Attributes
    ----------
    stack : SurfaceStack
    graphs : list of TransitionGraph
        One a slice.
    layers : list of (rows, columns) int8
        Which surface of the stack each of their cells is.
    maps : list of HeightMap
        Of the slices.

    Raises
    ------
    InputError
        If the robot's radius is more than 100 cells, the memory is not available, or all slices
        together have too many rows.
    """

    def __init__(
        self,
        height_map: HeightMap,
        levels: LevelsParams | None = None,
        terrain: TraversabilityParams | None = None,
        params: PlannerParams | None = None,
        graph_of: Callable[[int, HeightMap], TransitionGraph] | None = None,
    ) -> None:
        terrain, params = terrain or TraversabilityParams(), params or PlannerParams()
        self.stack = SurfaceStack(height_map, levels, terrain)
        slices = self.stack.slices(self.stack.footprint_cells)
        self.layers = [found.layer for found in slices]
        self.maps = [found.height_map for found in slices]
        if len(slices) * (height_map.geometry.shape[0] + 2) > LARGEST_SIDE:
            raise InputError(f"a map with {len(slices)} levels is too large to be planned over")
        made = graph_of or KeptGraphs(terrain, params).of
        self.graphs = [made(number, found.height_map) for number, found in enumerate(slices)]
        self._links = _links(self.layers)

    def holding(self, surface: tuple[int, int, int]) -> Place:
        """The place of a surface (layer, iy, ix), where possible one that the robot may enter."""
        layer, cell = surface[0], (surface[1], surface[2])
        held = [i for i, layers in enumerate(self.layers) if layers[cell] == layer]
        enterable = [i for i in held if self.graphs[i].enterable[cell]]
        return Place((enterable or held or [0])[0], cell)

    def cost_to_go(
        self, goal: Place, graphs: Sequence[TransitionGraph], deadline: float
    ) -> list[CostToGo]:
        """The field around a goal in each slice; `search.cost_to_go` over all of them.

        Parameters
        ----------
        goal : Place
        graphs : sequence of TransitionGraph
            In place of ``graphs``: with one that is cleared at the start.
        deadline : float [s]
        """
        rows = self.layers[0].shape[0] + 2
        incoming = np.concatenate([graph.incoming for graph in graphs])
        cell = goal.slice * rows + goal.cell[0], goal.cell[1]
        found = cost_to_go(incoming, cell, deadline=deadline, links=self._links)
        parts = (np.s_[i * rows : (i + 1) * rows] for i in range(len(graphs)))
        return [CostToGo(incoming[part], found.remaining[part]) for part in parts]

    def route(self, fields: Sequence[CostToGo], start: Place) -> list[Place]:
        """Where the cheapest path from a start changes slices, and where it ends; empty: nowhere.

        Each place is in the slice that leads to it. A change is in the middle of the part of the
        path that both slices hold: far from the seams of both.
        """
        places: list[Place] = []
        index, cell = start.slice, start.cell
        while True:
            cells = fields[index].cheapest_path(cell)
            if not len(cells):
                return []
            last = to_cell(cells[-1])
            if fields[index][last] == 0:
                return [*places, Place(index, last)]
            following = next(
                i
                for i in range(len(fields))
                if i != index and self._is_same(i, index, last) and _leads_on(fields[i], last)
            )
            cell = self._change(cells, index, following, fields)
            places.append(Place(index, cell))
            index = following

    def _change(
        self, cells: NDArray[np.int64], index: int, following: int, fields: Sequence[CostToGo]
    ) -> Cell:
        """Where a path over cells of a slice, which ends there, changes to the following one.

        In the middle of the cells at its end that both hold, if from there it leads as far.
        """
        last = to_cell(cells[-1])
        both = 1
        while both < len(cells) and self._is_shared(following, index, to_cell(cells[-both - 1])):
            both += 1
        middle = to_cell(cells[-1 - (both - 1) // 2])
        end = fields[following].cheapest_path(middle)
        is_as_far = len(end) and fields[following][to_cell(end[-1])] < fields[index][last]
        return middle if is_as_far else last

    def _is_same(self, one: int, other: int, cell: Cell) -> bool:
        return bool(self.layers[one][cell] == self.layers[other][cell])

    def _is_shared(self, one: int, other: int, cell: Cell) -> bool:
        return self._is_same(one, other, cell) and bool(self.graphs[one].enterable[cell])


def _leads_on(field: CostToGo, cell: Cell) -> bool:
    return field[cell] == 0 or field.direction(cell) >= 0


def _links(layers: Sequence[NDArray[np.int8]]) -> NDArray[np.int32]:
    """Rings of the cells of different slices that are the same surface, as of `cost_to_go`."""
    count, (rows, columns) = len(layers), layers[0].shape
    links = np.zeros((count, rows + 2, columns + 2), np.int32)
    index = np.arange(links.size, dtype=np.int32).reshape(links.shape)[:, 1:-1, 1:-1]
    inner = links[:, 1:-1, 1:-1]
    for i in range(count):
        for step in range(1, count):
            j = (i + step) % count
            is_next = (inner[i] == 0) & (layers[i] >= 0) & (layers[i] == layers[j])
            inner[i][is_next] = index[j][is_next]
    return links.reshape(-1, columns + 2)
