# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The planner's graph of a map that comes again and again, of which little has changed.

What the graph says of a cell depends on the cells around it alone, up to a distance that the
parameters bound. So only what is nearer than that to changed cells is computed anew, from a window
that is larger by the same distance again, at whose borders the map seems to end. In the rest the
graph is kept.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.exploration.boundary import Boundary, confined
from heightmap25d_ros.grid.height_map import Area, Geometry, HeightMap
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.graph import TransitionGraph, transition_graph

_BLOCK = 32
"""Side of the squares [cells] in which changes are looked for: those that touch are one area."""

_ARRAYS = "height", "gradient", "weight", "occupied", "forbidden", "enterable", "blocked"
"""Of a graph, of its cells."""


class KeptGraph:
    """The transition graph of the newest map, without the cells outside of a boundary.

    Parameters
    ----------
    params : Params
    boundary : Boundary
    """

    def __init__(self, params: Params, boundary: Boundary) -> None:
        self._params, self._boundary = params, boundary
        self._shown: HeightMap | None = None
        self._graph: TransitionGraph | None = None

    def of(self, height_map: HeightMap) -> TransitionGraph:
        """The graph of a map; that of the map before becomes it, in place.

        It is the graph that `transition_graph` makes, but for the heights of unknown cells that are
        farther than ``exploration.frontier_depth`` from all known ones: theirs are of some known
        cell, not of the nearest one.

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
            graph = self._whole(height_map)
        else:
            reach = self._reach(height_map.geometry.resolution)
            if shown.geometry.shape != height_map.geometry.shape:
                graph = _pasted(graph, corner, height_map.geometry)
            for changed in _changed_areas(shown, height_map, corner):
                self._renew(graph, height_map, changed.grown(reach), reach)
        self._shown, self._graph = height_map, graph
        return graph

    def _whole(self, height_map: HeightMap) -> TransitionGraph:
        terrain, planner = self._params.traversability, self._params.planner
        return confined(transition_graph(height_map, terrain, planner), self._boundary)

    def _reach(self, resolution: float) -> int:
        """So far [cells] from a changed cell the graph may change."""
        terrain, planner = self._params.traversability, self._params.planner
        gaps = planner.max_gap / resolution + 2  # which cells are filled, and with what
        ground = terrain.robot_radius / resolution + 2  # planes, and steps under them
        clearance = planner.clearance if planner.clearance_weight else 0.0
        around = max(terrain.robot_radius + clearance, planner.unknown_margin) / resolution + 2
        beyond = self._params.exploration.frontier_depth / resolution + 1  # heights there
        return math.ceil(max(gaps + ground + around, gaps + beyond))

    def _renew(self, graph: TransitionGraph, height_map: HeightMap, area: Area, reach: int) -> None:
        """Replace an area of a graph by that of a map."""
        affected = area.within(graph.area)
        window = affected.grown(reach).within(graph.area)
        inside = Area(affected.iy - window.iy, affected.ix - window.ix, *affected.shape)
        anew, kept = self._whole(height_map.part(window)).part(inside), graph.part(affected)
        for name in _ARRAYS:
            getattr(kept, name)[...] = getattr(anew, name)
        kept.incoming[1:-1, 1:-1] = anew.incoming[1:-1, 1:-1]


def _corner_in(part: HeightMap, whole: HeightMap) -> tuple[int, int] | None:
    """The cell of a map at which another one begins that is a part of it; None: it is none."""
    inner, outer = part.geometry, whole.geometry
    is_alike = (
        inner.resolution == outer.resolution
        and inner.ground_zero == outer.ground_zero
        and part.is_level == whole.is_level
    )
    if not is_alike:
        return None
    iy, ix = (int(n) for n in outer.cell_at(np.add(inner.origin, 0.5 * inner.resolution)))
    inside = Area(iy, ix, *inner.shape)
    return (iy, ix) if inside.within(Area(0, 0, *outer.shape)) == inside else None


def _pasted(graph: TransitionGraph, corner: tuple[int, int], geometry: Geometry) -> TransitionGraph:
    """The graph of a part of a map in one of the whole; what is new is still empty."""
    arrays: dict[str, Any] = {
        name: _in_larger(getattr(graph, name), corner, geometry.shape) for name in _ARRAYS
    }
    rows, columns = geometry.shape
    arrays["incoming"] = np.zeros((rows + 2, columns + 2, 8), np.uint16)
    pasted = replace(graph, geometry=geometry, **arrays)
    pasted.part(Area(*corner, *graph.area.shape)).incoming[...] = graph.incoming
    return pasted


def _in_larger(
    array: NDArray[Any], corner: tuple[int, int], shape: tuple[int, int]
) -> NDArray[Any]:
    """An array of cells (..., rows, columns) in one of more cells; zeros around it."""
    result = np.zeros((*array.shape[:-2], *shape), array.dtype)
    y, x = Area(*corner, *array.shape[-2:]).slices(Area(0, 0, *shape))
    result[..., y, x] = array
    return result


def _changed_areas(before: HeightMap, after: HeightMap, corner: tuple[int, int]) -> list[Area]:
    """Where a map differs from one that was a part of it: areas that contain all changed cells."""
    here = Area(*corner, *before.geometry.shape).slices(Area(0, 0, *after.geometry.shape))
    changed = np.ones(after.geometry.shape, np.bool_)
    known_before, known = before.known, after.known[here]
    moved = (before.height != after.height[here]) & known
    changed[here] = moved | (known_before != known) | (before.suspected != after.suspected[here])
    iy, ix = np.nonzero(changed)
    blocks = np.zeros([side // _BLOCK + 1 for side in changed.shape], np.bool_)
    blocks[iy // _BLOCK, ix // _BLOCK] = True
    together, _ = ndimage.label(blocks, np.ones((3, 3)))
    return [
        Area(*(_BLOCK * part.start for part in parts),
             *(_BLOCK * (part.stop - part.start) for part in parts))
        for parts in ndimage.find_objects(together)
    ]  # fmt: skip
