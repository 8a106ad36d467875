# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The start of a path: the ground under the robot is free, whatever the map contains there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import Area
from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.planning.collision import collision_free
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.plan import Pose2D, in_cells
from heightmap25d_ros.terrain.steps import NEIGHBOURS


def clear_start(
    graph: TransitionGraph,
    start: Pose2D,
    terrain: TraversabilityParams,
    planner: PlannerParams,
    *,
    is_robot_there: bool,
) -> TransitionGraph:
    """The graph with the robot's footprint at the start cleared, so that a path can begin there.

    Parameters
    ----------
    graph : TransitionGraph
    start : Pose2D
        In the map.
    terrain : TraversabilityParams
    planner : PlannerParams
    is_robot_there : bool
        Whether the robot is at the start: then occupied cells under its rectangle are noise and
        cleared. Unknown cells there are cleared in any case.
    """
    resolution = graph.geometry.resolution
    length, width = planner.robot_length / resolution, planner.robot_width / resolution
    margin = max(terrain.robot_radius, planner.unknown_margin) / resolution
    reach = math.ceil(math.hypot(length, width) / 2 + margin) + 1
    y, x, yaw = in_cells(start, graph.geometry)
    cell = Area(math.floor(y), math.floor(x), 1, 1)
    area = cell.grown(reach).within(graph.area)
    outer = cell.grown(reach + math.ceil(margin)).within(graph.area)
    around = outer.slices(graph.area)
    occupied, forbidden = graph.occupied[around].copy(), graph.forbidden[around].copy()
    blocked = graph.blocked[around]
    ahead, aside, distance = offsets(outer, y, x, yaw)
    is_under = (np.abs(ahead) <= length / 2) & (np.abs(aside) <= width / 2)
    is_on_noise = is_robot_there and bool(occupied[is_under].any())
    if graph.enterable[cell.iy, cell.ix] and not is_on_noise:
        return graph
    forbidden[is_under] = False
    if is_robot_there:
        occupied[is_under] = False
        blocked = _without_steps(blocked, is_under)
    enterable = collision_free(
        occupied, forbidden, terrain.robot_radius, planner.unknown_margin, resolution
    )
    # A robot beside an obstacle may move away from it.
    enterable |= (distance <= terrain.robot_radius / resolution) & ~occupied & ~forbidden
    inside = area.slices(outer)
    return graph.with_part(
        area,
        enterable=enterable[inside] | graph.enterable[area.slices(graph.area)],
        occupied=occupied[inside],
        forbidden=forbidden[inside],
        blocked=blocked[inside],
    )


def offsets(area: Area, y: float, x: float, yaw: float) -> tuple[Array, Array, Array]:
    """Offsets of the cells of an area from a pose [cells, rad]: ahead, to the left, distance."""
    iy, ix = np.indices(area.shape)
    dy, dx = iy + area.iy + 0.5 - y, ix + area.ix + 0.5 - x
    ahead = dx * math.cos(yaw) + dy * math.sin(yaw)
    aside = dy * math.cos(yaw) - dx * math.sin(yaw)
    return ahead, aside, np.hypot(dy, dx)


def _without_steps(blocked: NDArray[np.uint8], cells: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Blocked transitions without those from and to some cells."""
    padded = np.pad(cells, 1)
    rows, columns = cells.shape
    opened = np.where(cells, np.uint8(255), np.uint8(0))
    for k, (dy, dx) in enumerate(NEIGHBOURS):
        there = padded[1 + dy : 1 + dy + rows, 1 + dx : 1 + dx + columns]
        opened |= there.astype(np.uint8) << np.uint8(k)
    return np.asarray(blocked & ~opened)
