# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Terrain becomes a graph: where the robot's middle may be, and what each transition costs.

A transition of horizontal length L into a neighbour, over ground with slope s along it and
cross slope c (both tangents), costs

    L * (f * sqrt(1 + s^2) + climb * max(s, 0) + descent * max(-s, 0) + cross * |c|)

where f = 1 + shares for roughness, closeness to obstacles and being unknown, each with its
weight. Slopes and f are the means of the transition's two cells. The paper weighs a cell by "the
height difference between the current cell and those around it"; here it is the slope of the
plane under the footprint, so that noise of single heights costs nothing, and direction counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.footprint import footprint, inflate
from heightmap25d_ros.gaps import with_gaps_filled
from heightmap25d_ros.grid import HEIGHT_RESOLUTION, Area, Geometry, HeightMap
from heightmap25d_ros.params import PlannerParams, TraversabilityParams
from heightmap25d_ros.planner import CLOSED, DIAGONAL, LARGEST_COST, STRAIGHT
from heightmap25d_ros.terrain import NEIGHBOURS, cropped
from heightmap25d_ros.traversability import OCCUPIED, convert, survey

_FREE, _TOUCHED, _SOLID = np.int8(0), 99, 100

Weights = tuple[float, float, float]
"""Of climbing, descending and cross slopes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TransitionGraph:
    """Terrain as a planner sees it.

    Attributes
    ----------
    geometry : Geometry
    height : (rows, columns) float32 [m]
        Of the ground; where it is unknown, that of the nearest known cell.
    gradient : (2, rows, columns) float32
        Of the ground under the footprint, along x and y, as tangents.
    weight : (rows, columns) float32
        f of the module's formula.
    occupied : (rows, columns) bool
        Cells that no part of the robot may be over.
    forbidden : (rows, columns) bool
        Unknown cells, where these are forbidden.
    enterable : (rows, columns) bool
        Cells over whose centre the robot's middle may be.
    blocked : (rows, columns) uint8
        Bit k: the transition to ``NEIGHBOURS[k]`` is too high a step.
    slope_weights : (3,) float
        Of climbing, descending and cross slopes.
    incoming : (rows + 2, columns + 2, 8) uint16
        What transitions cost, for `planner.cost_to_go`.
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

    def with_part(
        self,
        area: Area,
        *,
        enterable: NDArray[np.bool_],
        occupied: NDArray[np.bool_] | None = None,
        forbidden: NDArray[np.bool_] | None = None,
        blocked: NDArray[np.uint8] | None = None,
    ) -> TransitionGraph:
        """The same terrain with another part in place of an area; the costs there follow.

        Parameters
        ----------
        area : Area
            Within the graph's.
        enterable, occupied, forbidden, blocked : (area.rows, area.columns)
            What is left out stays.
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


def transition_graph(
    height_map: HeightMap, terrain: TraversabilityParams, params: PlannerParams
) -> TransitionGraph:
    """The graph of a dense map.

    Raises
    ------
    InputError
        If the robot's radius is more than 100 cells.
    """
    resolution = height_map.geometry.resolution
    filled = with_gaps_filled(height_map, params.max_gap)
    ground = survey(filled, terrain)
    obstacles = convert(filled, terrain, ground)
    is_unknown = ~filled.known
    is_occupied = obstacles.occupancy == OCCUPIED
    is_forbidden = is_unknown if params.unknown == "forbid" else np.zeros_like(is_unknown)
    # Beyond the map all is unknown.
    margin = math.ceil(params.unknown_margin / resolution) + 1
    enterable = cropped(
        fitting(
            np.pad(is_occupied, margin),
            np.pad(is_forbidden, margin, constant_values=params.unknown == "forbid"),
            (terrain, params),
            resolution,
        ),
        margin,
    )
    closeness = _closeness(
        is_occupied | is_forbidden, terrain.robot_radius, params.clearance, resolution
    )
    max_roughness = terrain.max_roughness / HEIGHT_RESOLUTION
    weight = 1.0 + params.roughness_weight * np.minimum(ground.roughness / max_roughness, 1.0)
    weight += params.clearance_weight * closeness
    weight += params.unknown_weight * is_unknown
    weight = weight.astype(np.float32)
    gradient = ground.gradient * np.float32(HEIGHT_RESOLUTION / resolution)
    slope_weights = (params.climb_weight, params.descent_weight, params.cross_slope_weight)
    return TransitionGraph(
        geometry=height_map.geometry,
        height=_continued(filled),
        gradient=gradient,
        weight=weight,
        occupied=is_occupied,
        forbidden=is_forbidden,
        enterable=enterable,
        blocked=ground.blocked,
        slope_weights=slope_weights,
        incoming=incoming_costs(enterable, ground.blocked, gradient, weight, slope_weights),
    )


def fitting(
    occupied: NDArray[np.bool_],
    forbidden: NDArray[np.bool_],
    params: tuple[TraversabilityParams, PlannerParams],
    resolution: float,
) -> NDArray[np.bool_]:
    """Where the robot's middle may be: far enough from occupied and from forbidden cells."""
    terrain, planner = params
    return np.asarray(
        ~_near(occupied, terrain.robot_radius, resolution)
        & ~_near(forbidden, planner.unknown_margin, resolution)
    )


def _near(cells: NDArray[np.bool_], distance: float, resolution: float) -> NDArray[np.bool_]:
    """Cells whose centre is within a distance [m] of the centre of one of these."""
    disc = footprint(math.floor((distance / resolution) ** 2 + 1e-6))
    marked = np.where(cells, np.int8(_SOLID), _FREE)
    return np.asarray(inflate(marked, disc, occupied=_SOLID, inflated=_TOUCHED) != _FREE)


def _continued(height_map: HeightMap) -> NDArray[np.float32]:
    """(rows, columns) [m]: heights, everywhere; where unknown, of the nearest known cell."""
    height = height_map.height * np.float32(HEIGHT_RESOLUTION)
    known = height_map.known
    if known.all() or not known.any():
        return height
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(height[tuple(nearest)])


def _closeness(
    solid: NDArray[np.bool_], radius: float, clearance: float, resolution: float
) -> NDArray[np.float32]:
    """1 where the robot just fits beside a solid cell, falling to 0 at ``clearance`` more [m]."""
    if not clearance:
        return np.zeros(solid.shape, np.float32)
    reach = (radius + clearance) / resolution
    distance = np.full((solid.shape[0] + 2, solid.shape[1] + 2), reach, np.float32)
    distance[1:-1, 1:-1][solid] = 0.0
    _chamfer(distance)
    distance = distance[1:-1, 1:-1] * np.float32(resolution)
    return np.clip((radius + clearance - distance) / clearance, 0.0, 1.0).astype(np.float32)


@njit(cache=True)
def _chamfer(distance):
    """Distances [cells] over the 8-connected grid to the zeros, in two passes."""
    rows, columns = distance.shape
    for y in range(1, rows - 1):
        for x in range(1, columns - 1):
            straight = min(distance[y, x - 1], distance[y - 1, x]) + np.float32(1.0)
            across = min(distance[y - 1, x - 1], distance[y - 1, x + 1]) + np.float32(math.sqrt(2))
            distance[y, x] = min(distance[y, x], straight, across)
    for y in range(rows - 2, 0, -1):
        for x in range(columns - 2, 0, -1):
            straight = min(distance[y, x + 1], distance[y + 1, x]) + np.float32(1.0)
            across = min(distance[y + 1, x + 1], distance[y + 1, x - 1]) + np.float32(math.sqrt(2))
            distance[y, x] = min(distance[y, x], straight, across)


def incoming_costs(
    enterable: NDArray[np.bool_],
    blocked: NDArray[np.uint8],
    gradient: NDArray[np.float32],
    weight: NDArray[np.float32],
    slope_weights: Weights,
) -> NDArray[np.uint16]:
    """What each transition costs, by the cell it leads into and where it comes from.

    A transition is open if both of its cells are enterable and its step is; a diagonal one
    needs, besides, both cells at its corners and the steps to them.

    Parameters
    ----------
    enterable : (rows, columns) bool
    blocked : (rows, columns) uint8
        Bit k: the step to ``NEIGHBOURS[k]`` is too high.
    gradient : (2, rows, columns) float32
        Along x and y, as tangents.
    weight : (rows, columns) float32, 1 or more
    slope_weights : (3,) float, not negative

    Returns
    -------
    (rows + 2, columns + 2, 8) uint16
        At [y + 1, x + 1, k] the transition into (y, x) from its neighbour ``NEIGHBOURS[k]``:
        `planner.STRAIGHT` for the length of a cell at cost 1, at most `planner.LARGEST_COST`.
    """
    rows, columns = enterable.shape
    incoming = np.zeros((rows + 2, columns + 2, 8), np.uint16)
    closed = np.pad(~enterable, 1, constant_values=True)
    steps = np.pad(blocked, 1)
    _incoming_costs(
        closed.view(np.uint8),
        steps,
        np.pad(gradient[0], 1),
        np.pad(gradient[1], 1),
        np.pad(weight, 1),
        np.array(slope_weights, np.float32),
        incoming,
    )
    return incoming


@njit(cache=True, error_model="numpy")
def _incoming_costs(closed, blocked, slope_x, slope_y, weight, slope_weights, incoming):
    rows, columns = closed.shape
    for y in range(1, rows - 1):
        for k in range(8):
            dy, dx = NEIGHBOURS[k]
            side = np.int64(k & 1)
            length = np.float32(DIAGONAL if side else STRAIGHT)
            norm = np.float32(1.0 / math.sqrt(dy * dy + dx * dx))
            # The way leads from the neighbour into the cell: against (dx, dy).
            ux, uy = -dx * norm, -dy * norm
            before, after = (k + 7) & 7, (k + 1) & 7
            y1, x1 = NEIGHBOURS[before]
            y2, x2 = NEIGHBOURS[after]
            for x in range(1, columns - 1):
                is_closed = closed[y, x] | closed[y + dy, x + dx] | (blocked[y, x] >> k & 1)
                if side:
                    is_closed |= closed[y + y1, x + x1] | closed[y + y2, x + x2]
                    is_closed |= blocked[y, x] >> before & 1 | blocked[y, x] >> after & 1
                    there = blocked[y + dy, x + dx]
                    is_closed |= there >> ((before + 4) & 7) & 1 | there >> ((after + 4) & 7) & 1
                gx = np.float32(0.5) * (slope_x[y, x] + slope_x[y + dy, x + dx])
                gy = np.float32(0.5) * (slope_y[y, x] + slope_y[y + dy, x + dx])
                f = np.float32(0.5) * (weight[y, x] + weight[y + dy, x + dx])
                cost = length * rate(gx * ux + gy * uy, gx * uy - gy * ux, f, slope_weights)
                whole = np.uint16(
                    min(max(cost, length), np.float32(LARGEST_COST)) + np.float32(0.5)
                )
                incoming[y, x, k] = np.uint16(CLOSED) if is_closed else whole


@njit(cache=True)
def rate(along, across, f, slope_weights):
    """Cost per horizontal length."""
    one, zero = np.float32(1.0), np.float32(0.0)
    climb = slope_weights[0] * max(along, zero) + slope_weights[1] * max(-along, zero)
    return f * math.sqrt(one + along * along) + climb + slope_weights[2] * abs(across)
