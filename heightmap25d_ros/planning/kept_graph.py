# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The planner's graph of a map that comes again and again, of which little has changed.

What the graph says of a cell depends on the cells around it alone, up to a distance that the
parameters bound. So only what is nearer than that to changed cells is computed anew, from windows
that are larger by the same distance again, at whose borders the map seems to end. In the rest the
graph is kept. Of the first map, and of what a map has grown by, everything is new.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros import memory
from heightmap25d_ros.grid.height_map import Area, Cell, Geometry, HeightMap
from heightmap25d_ros.grid.map_changes import changed_blocks, part_in
from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.planning.boundary import Boundary, confined
from heightmap25d_ros.planning.graph import (
    EXTRAPOLATION,
    TransitionGraph,
    empty_graph,
    transition_graph,
)

_BLOCK = 32
"""Side of the squares [cells] in which changes are looked for."""

_PIECE = 512
"""Side of the squares [cells] that are computed together: it bounds the memory that this takes."""

_ARRAYS = "height", "gradient", "weight", "occupied", "forbidden", "enterable", "blocked"
"""Of a graph, of its cells."""

_BYTES_OF_CELL = 36  # of the graph


class KeptGraph:
    """The transition graph of the newest map, without the cells outside of a boundary.

    Parameters
    ----------
    terrain : TraversabilityParams
    planner : PlannerParams
    boundary : Boundary, optional
        That the robot's middle does not leave.
    depth : float [m]
        As of `transition_graph`.
    """

    def __init__(
        self,
        terrain: TraversabilityParams,
        planner: PlannerParams,
        boundary: Boundary | None = None,
        depth: float = EXTRAPOLATION,
    ) -> None:
        self._terrain, self._planner, self._depth = terrain, planner, depth
        self._boundary = boundary or Boundary.of([])
        self._shown: HeightMap | None = None
        self._graph: TransitionGraph | None = None
        self._is_lent = False

    def of(self, height_map: HeightMap) -> TransitionGraph:
        """The graph that `transition_graph` makes of a map.

        That of the map before becomes it, in place, unless it was lent.

        Raises
        ------
        InputError
            As `transition_graph`.
        """
        shown, graph = self._shown, self._graph
        if shown is height_map and graph is not None:
            return graph
        self._shown = self._graph = None  # nothing is kept of what fails below
        corner = None if shown is None else _corner_in(shown, height_map)
        if shown is None or graph is None or corner is None:
            graph = self._unfilled(height_map.geometry)
            changed = np.ones([-(-side // _BLOCK) for side in height_map.geometry.shape], np.bool_)
        else:
            changed = changed_blocks(shown, height_map, corner, _BLOCK)
            if self._is_lent or shown.geometry.shape != height_map.geometry.shape:
                graph = _pasted(graph, corner, self._unfilled(height_map.geometry))
        self._is_lent = False
        reach = self._reach(height_map.geometry.resolution)
        for affected in _around(changed, reach, graph.area):
            self._renew(graph, height_map, affected, reach)
        self._shown, self._graph = height_map, graph
        return graph

    def lend(self) -> None:
        """Leave the graph that was returned last as it is, whatever map comes."""
        self._is_lent = True

    def _reach(self, resolution: float) -> int:
        """So far [cells] from a changed cell the graph may change."""
        terrain, planner = self._terrain, self._planner
        gaps = planner.max_gap / resolution + 2  # which cells are filled, and with what
        ground = terrain.robot_radius / resolution + 2  # planes, and steps under them
        clearance = planner.clearance if planner.clearance_weight else 0.0
        around = max(terrain.robot_radius + clearance, planner.unknown_margin) / resolution + 2
        beyond = self._depth / resolution + 1  # heights there
        return math.ceil(max(gaps + ground + around, gaps + beyond))

    def _unfilled(self, geometry: Geometry) -> TransitionGraph:
        size = geometry.shape[0] * geometry.shape[1]
        memory.require(size * _BYTES_OF_CELL, "planning over this map")
        return empty_graph(geometry, self._planner)

    def _renew(self, graph: TransitionGraph, height_map: HeightMap, area: Area, reach: int) -> None:
        """Replace an area of a graph by that of a map."""
        window = area.grown(reach).within(graph.area)
        inside = Area(area.iy - window.iy, area.ix - window.ix, *area.shape)
        whole = transition_graph(height_map.part(window), self._terrain, self._planner, self._depth)
        anew, kept = confined(whole, self._boundary).part(inside), graph.part(area)
        for name in _ARRAYS:
            getattr(kept, name)[...] = getattr(anew, name)
        kept.incoming[1:-1, 1:-1] = anew.incoming[1:-1, 1:-1]


class KeptGraphs:
    """The graphs of the newest map with several levels: a `KeptGraph` for each of its slices.

    Parameters
    ----------
    terrain, planner, boundary, depth
        As of `KeptGraph`.
    """

    def __init__(
        self,
        terrain: TraversabilityParams,
        planner: PlannerParams,
        boundary: Boundary | None = None,
        depth: float = EXTRAPOLATION,
    ) -> None:
        self._arguments = terrain, planner, boundary, depth
        self._graphs: list[KeptGraph] = []

    def of(self, number: int, height_map: HeightMap) -> TransitionGraph:
        """The graph of a slice, by its number and its map; see `KeptGraph.of`."""
        while len(self._graphs) <= number:
            self._graphs.append(KeptGraph(*self._arguments))
        return self._graphs[number].of(height_map)

    def lend(self) -> None:
        """Leave all graphs that were returned last as they are, whatever map comes."""
        for graph in self._graphs:
            graph.lend()


def _corner_in(part: HeightMap, whole: HeightMap) -> Cell | None:
    """The cell of a map at which another one begins that is a part of it; None: it is none."""
    inside = part_in(part.geometry, whole.geometry)
    return None if inside is None or part.is_level != whole.is_level else (inside.iy, inside.ix)


def _pasted(part: TransitionGraph, corner: Cell, graph: TransitionGraph) -> TransitionGraph:
    """A graph with that of a part of its map, which begins at a cell."""
    inside = graph.part(Area(*corner, *part.area.shape))
    for name in (*_ARRAYS, "incoming"):
        getattr(inside, name)[...] = getattr(part, name)
    return graph


def _around(changed: NDArray[np.bool_], reach: int, area: Area) -> Iterator[Area]:
    """Areas that contain all cells of changed blocks and those within a reach [cells] of them."""
    near = ndimage.maximum_filter(changed, 2 * -(-reach // _BLOCK) + 1, mode="constant")
    side = max(1, _PIECE // _BLOCK)
    for row in range(0, near.shape[0], side):
        for column in range(0, near.shape[1], side):
            piece = near[row : row + side, column : column + side]
            for y, x in ndimage.find_objects(piece.astype(np.int8)):
                shape = y.stop - y.start, x.stop - x.start
                blocks = row + y.start, column + x.start, *shape
                yield Area(*(_BLOCK * number for number in blocks)).within(area)
