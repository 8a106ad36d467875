# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Terrain as a graph: the cells that the robot may enter, and the cost of each transition.

`transition_graph` makes the graph of a dense height map; the costs are those of
`transition_costs`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros import memory
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, Area, Geometry, HeightMap
from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.planning.collision import closeness, collision_free
from heightmap25d_ros.planning.transition_costs import Weights, incoming_costs, line_cost
from heightmap25d_ros.terrain.gap_filling import fill_gaps
from heightmap25d_ros.terrain.steps import cropped
from heightmap25d_ros.terrain.traversability import OCCUPIED, analyse_ground, to_obstacle_map

EXTRAPOLATION = 1.0
"""So far from known cells unknown ones have a height [m], by default."""

_ROUNDING_ERROR = 1e-6
"""Of distances [cells]."""

_BYTES_OF_CELL = 64  # of the graph, and of what it is made of; measured: 54


@dataclass(frozen=True, slots=True, kw_only=True)
class TransitionGraph:
    """The cells of a map as nodes, and the transitions between neighbouring ones as edges.

    Attributes
    ----------
    geometry : Geometry
    height : (rows, columns) float32 [m] above ground zero
        Of the ground; in unknown cells that of the nearest known cell, NaN where none is near.
    gradient : (2, rows, columns) float32
        Of the ground under the footprint, along x and y, as tangents.
    weight : (rows, columns) float32
        f in the formula of `transition_costs`.
    occupied : (rows, columns) bool
        Cells that no part of the robot may cover.
    forbidden : (rows, columns) bool
        Unknown cells, if these are forbidden.
    enterable : (rows, columns) bool
        Cells that may contain the robot's centre.
    blocked : (rows, columns) uint8
        Bit k: the transition to ``NEIGHBOURS[k]`` is too high a step.
    slope_weights : (3,) float
        Of climbing, descending and cross slopes.
    incoming : (rows + 2, columns + 2, 8) uint16
        Costs of the transitions, for `search.cost_to_go`.
    """

    geometry: Geometry
    height: NDArray[np.float32]
    gradient: NDArray[np.float32]
    weight: NDArray[np.float32]
    occupied: NDArray[np.bool_]
    forbidden: NDArray[np.bool_]
    enterable: NDArray[np.bool_]
    blocked: NDArray[np.uint8]
    slope_weights: Weights
    incoming: NDArray[np.uint16]

    @property
    def area(self) -> Area:
        """All of its cells."""
        return Area(0, 0, *self.geometry.shape)

    def part(self, area: Area) -> TransitionGraph:
        """An area of the graph, by views of its arrays; transitions across its border stay."""
        here = area.slices(self.area)
        names = "height", "weight", "occupied", "forbidden", "enterable", "blocked"
        arrays: dict[str, Any] = {name: getattr(self, name)[here] for name in names}
        rows, columns = (slice(part.start, part.stop + 2) for part in here)
        return replace(
            self,
            geometry=self.geometry.part(area),
            gradient=self.gradient[:, here[0], here[1]],
            incoming=self.incoming[rows, columns],
            **arrays,
        )

    def with_part(
        self,
        area: Area,
        *,
        enterable: NDArray[np.bool_],
        occupied: NDArray[np.bool_] | None = None,
        forbidden: NDArray[np.bool_] | None = None,
        blocked: NDArray[np.uint8] | None = None,
    ) -> TransitionGraph:
        """Copy of the graph in which an area is replaced; its transition costs are updated.

        Parameters
        ----------
        area : Area
            Within the graph's.
        enterable, occupied, forbidden, blocked : (area.rows, area.columns)
            None: unchanged.
        """
        changed = {"enterable": enterable, "occupied": occupied, "forbidden": forbidden}
        arrays: dict[str, Any] = {"incoming": self.incoming.copy()}
        for name, part in {**changed, "blocked": blocked}.items():
            if part is not None:
                arrays[name] = getattr(self, name).copy()
                arrays[name][area.slices(self.area)] = part
        result = replace(self, **arrays)
        affected = area.grown(1).within(self.area)
        window = affected.grown(1).within(self.area)
        here = window.slices(self.area)
        costs = incoming_costs(
            result.enterable[here],
            result.blocked[here],
            result.gradient[(slice(None), *here)],
            result.weight[here],
            result.slope_weights,
        )[1:-1, 1:-1]
        inner = arrays["incoming"][1:-1, 1:-1]
        inner[affected.slices(self.area)] = costs[affected.slices(window)]
        return result

    def line_cost(self, start: Array, end: Array) -> float:
        """Cost of a straight line, in cells of flat ground; negative if it is blocked.

        Parameters
        ----------
        start, end : (2,) float64 [cells]
            As (y, x), within the map.
        """
        terrain = self.enterable, self.blocked, self.gradient, self.weight, self.slope_weights
        return float(line_cost(terrain, *start, *end))


def empty_graph(geometry: Geometry, params: PlannerParams) -> TransitionGraph:
    """A graph whose cells are all closed: for the parts of others."""
    rows, columns = shape = geometry.shape
    return TransitionGraph(
        geometry=geometry,
        height=np.zeros(shape, np.float32),
        gradient=np.zeros((2, *shape), np.float32),
        weight=np.zeros(shape, np.float32),
        occupied=np.zeros(shape, np.bool_),
        forbidden=np.zeros(shape, np.bool_),
        enterable=np.zeros(shape, np.bool_),
        blocked=np.zeros(shape, np.uint8),
        slope_weights=_slope_weights(params),
        incoming=np.zeros((rows + 2, columns + 2, 8), np.uint16),
    )


def transition_graph(
    height_map: HeightMap,
    terrain: TraversabilityParams,
    params: PlannerParams,
    depth: float = EXTRAPOLATION,
) -> TransitionGraph:
    """The graph of a dense map; all cells beyond the map are unknown.

    Parameters
    ----------
    height_map : HeightMap
    terrain : TraversabilityParams
    params : PlannerParams
    depth : float [m]
        So far from known cells unknown ones have a height.

    Raises
    ------
    InputError
        If the robot's radius is more than 100 cells, or the memory is not available.
    """
    resolution = height_map.geometry.resolution
    memory.require(height_map.height.size * _BYTES_OF_CELL, "planning over this map")
    filled = fill_gaps(height_map, params.max_gap)
    ground = analyse_ground(filled, terrain)
    obstacles = to_obstacle_map(filled, terrain, ground)
    is_unknown = ~filled.known
    is_occupied = obstacles.occupancy == OCCUPIED
    if terrain.drop_offs != "none":
        is_occupied |= height_map.suspected
    is_forbidden = is_unknown if params.unknown == "forbid" else np.zeros_like(is_unknown)
    margin = math.ceil(params.unknown_margin / resolution) + 1
    enterable = cropped(
        collision_free(
            np.pad(is_occupied, margin),
            np.pad(is_forbidden, margin, constant_values=params.unknown == "forbid"),
            terrain.robot_radius,
            params.unknown_margin,
            resolution,
        ),
        margin,
    )
    near = closeness(is_occupied | is_forbidden, terrain.robot_radius, params.clearance, resolution)
    max_roughness = terrain.max_roughness / HEIGHT_RESOLUTION
    weight = 1.0 + params.roughness_weight * np.minimum(ground.roughness / max_roughness, 1.0)
    weight += params.clearance_weight * near
    weight += params.unknown_weight * is_unknown
    weight = weight.astype(np.float32)
    gradient = ground.gradient * np.float32(HEIGHT_RESOLUTION / resolution)
    slope_weights = _slope_weights(params)
    return TransitionGraph(
        geometry=height_map.geometry,
        height=_extrapolated(filled, depth),
        gradient=gradient,
        weight=weight,
        occupied=is_occupied,
        forbidden=is_forbidden,
        enterable=enterable,
        blocked=ground.blocked,
        slope_weights=slope_weights,
        incoming=incoming_costs(enterable, ground.blocked, gradient, weight, slope_weights),
    )


def _slope_weights(params: PlannerParams) -> Weights:
    return params.climb_weight, params.descent_weight, params.cross_slope_weight


def _extrapolated(height_map: HeightMap, depth: float) -> NDArray[np.float32]:
    """(rows, columns) float32 [m] above ground zero: `TransitionGraph.height`."""
    # Not `HeightMap.metres`: the product in single precision differs in the last bit.
    height = height_map.height * np.float32(HEIGHT_RESOLUTION)
    known = height_map.known
    if known.all():
        return height
    if not known.any():
        return np.full_like(height, np.nan)
    away, nearest = ndimage.distance_transform_edt(~known, return_indices=True)
    reach = depth / height_map.geometry.resolution + _ROUNDING_ERROR
    return np.where(away <= reach, height[tuple(nearest)], np.float32(np.nan))
