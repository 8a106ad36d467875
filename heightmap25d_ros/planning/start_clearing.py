# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The start of a path: what is under the robot is no obstacle, and it may leave those beside it.

Where a robot stands, it may also leave, however near to obstacles that is. From within their
inflation it drives straight to a cell outside of it, along a line on which its clearance does not
decrease. Cells that its rectangle overlaps at the start are not held against it while it moves
away from them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import Area
from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.planning.collision import collision_free
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.plan import Pose2D, in_cells
from heightmap25d_ros.planning.rectangle_check import first_blocked
from heightmap25d_ros.terrain.steps import NEIGHBOURS

_ROUNDING_ERROR = 1e-9
"""Of clearances along a line [cells]."""

_TURN_PENALTY = 1e6
"""Of exits to which the robot cannot turn freely [cells of flat ground]."""

_SAMPLES_PER_CELL = 10
"""Positions along a line at which its clearance is measured."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClearedStart:
    """A map in which a path can begin at a start.

    Attributes
    ----------
    graph : TransitionGraph
        Cleared of what is noise under the robot. Where the robot stands within the inflation of
        obstacles, its cell is not enterable.
    leaving : TransitionGraph
        The same with the free cells around the robot enterable: the first line of the path crosses
        these.
    exits : (K, 2) int64
        Cells outside of the inflation to whose centres the robot can drive straight; none where it
        stands outside of it, and needs none.
    costs : (K,) float64 [cells of flat ground]
        Of the straight lines there.
    penalties : (K,) float64 [cells of flat ground]
        So much is an exit worse than others: those to which the robot cannot turn without touching
        obstacles come last.
    """

    graph: TransitionGraph
    leaving: TransitionGraph
    exits: NDArray[np.int64]
    costs: NDArray[np.float64]
    penalties: NDArray[np.float64]


def clear_start(
    graph: TransitionGraph,
    start: Pose2D,
    terrain: TraversabilityParams,
    planner: PlannerParams,
    *,
    is_robot_there: bool,
) -> ClearedStart:
    """Clear the robot's footprint at the start, and find where the robot can leave to.

    Parameters
    ----------
    graph : TransitionGraph
    start : Pose2D
        In the map.
    terrain : TraversabilityParams
    planner : PlannerParams
    is_robot_there : bool
        Whether the robot is at the start: then occupied cells that lie wholly under its rectangle
        are noise and cleared. One that reaches out from under it may be a wall beside the robot.
        Unknown cells there are cleared in any case.
    """
    resolution = graph.geometry.resolution
    size = planner.robot_length / resolution, planner.robot_width / resolution
    radius = terrain.robot_radius / resolution
    margin = math.ceil(max(radius, planner.unknown_margin / resolution))
    reach = math.ceil(math.hypot(*size) / 2 + margin) + 2
    y, x, yaw = in_cells(start, graph.geometry)
    cell = Area(math.floor(y), math.floor(x), 1, 1)
    area = cell.grown(reach).within(graph.area)
    outer = cell.grown(reach + margin).within(graph.area)
    around = outer.slices(graph.area)
    ahead, aside, distance = offsets(outer, y, x, yaw)
    is_under = (np.abs(ahead) <= size[0] / 2) & (np.abs(aside) <= size[1] / 2)
    is_noise = np.zeros_like(is_under)
    if is_robot_there:
        half_cell = 0.5 * (abs(math.cos(yaw)) + abs(math.sin(yaw)))
        is_noise = np.abs(ahead) + half_cell <= size[0] / 2
        is_noise &= np.abs(aside) + half_cell <= size[1] / 2
        is_noise[cell.slices(outer)] = True
    occupied = graph.occupied[around]
    if graph.enterable[cell.iy, cell.ix] and not (occupied & is_noise).any():
        return _without_exits(graph)
    forbidden = graph.forbidden[around] & ~is_under
    blocked = _without_steps(graph.blocked[around], occupied & is_noise)
    occupied = occupied & ~is_noise
    disc = terrain.robot_radius, planner.unknown_margin, resolution
    enterable = collision_free(occupied, forbidden, *disc)
    # Among unknown cells it may drive over those that are known.
    is_near = (distance <= radius) & ~forbidden
    enterable |= is_near & collision_free(occupied, np.zeros_like(forbidden), *disc)
    inside = area.slices(outer)
    cleared = graph.with_part(
        area,
        enterable=enterable[inside] | graph.enterable[area.slices(graph.area)],
        occupied=occupied[inside],
        forbidden=forbidden[inside],
        blocked=blocked[inside],
    )
    if cleared.enterable[cell.iy, cell.ix]:
        return _without_exits(cleared)
    return _with_exits(cleared, area, start, size, radius)


def leaving_straight(
    cleared: ClearedStart, start: Pose2D, terrain: TraversabilityParams, planner: PlannerParams
) -> ClearedStart:
    """The same for a robot that has to drive straight on before it turns, as in a narrow gap.

    Its rectangle fits where it stands, but along no path over the cells around it: the robot is
    beside the centre of its cell, and no more of them is open.

    Parameters
    ----------
    cleared : ClearedStart
        In which the start's cell is enterable.
    start : Pose2D
    terrain : TraversabilityParams
    planner : PlannerParams
    """
    resolution = cleared.graph.geometry.resolution
    size = planner.robot_length / resolution, planner.robot_width / resolution
    radius = terrain.robot_radius / resolution
    y, x, _ = in_cells(start, cleared.graph.geometry)
    cell = Area(math.floor(y), math.floor(x), 1, 1)
    area = cell.grown(math.ceil(radius) + 2).within(cleared.graph.area)
    closed = cleared.graph.with_part(cell, enterable=np.zeros((1, 1), np.bool_))
    return _with_exits(closed, area, start, size, radius, is_free=True)


def _without_exits(graph: TransitionGraph) -> ClearedStart:
    nothing = np.empty(0)
    return ClearedStart(
        graph=graph,
        leaving=graph,
        exits=np.empty((0, 2), np.int64),
        costs=nothing,
        penalties=nothing,
    )


def _with_exits(
    graph: TransitionGraph,
    area: Area,
    start: Pose2D,
    size: tuple[float, float],
    radius: float,
    *,
    is_free: bool = False,
) -> ClearedStart:
    """The straight lines away from a start in an area, for a rectangle [cells].

    Out of the inflation; or, for one that is free of it, to wherever the rectangle fits.
    """
    y, x, yaw = in_cells(start, graph.geometry)
    here = area.slices(graph.area)
    *_, distance = offsets(area, y, x, yaw)
    is_near = distance <= radius + 2.0
    is_passable = is_near & ~graph.occupied[here] & ~graph.forbidden[here]
    leaving = graph.with_part(area, enterable=graph.enterable[here] | is_passable)
    candidates = np.argwhere(is_near & graph.enterable[here]) + (area.iy, area.ix)
    exits, costs, penalties = [], [], []
    for cell in candidates:
        line = np.array([(y, x), cell + 0.5])
        cost = leaving.line_cost(*line)
        if cost < 0.0:
            continue
        if not is_free and not _clearance_grows(graph.occupied, *line[0], *line[1], radius):
            continue
        along = math.atan2(*(line[1] - line[0]))
        heading = np.array([along if start.yaw is None else yaw, along])
        if first_blocked(graph.occupied, line, heading, size) < 0:
            turn = first_blocked(graph.occupied, line, heading, size, is_turn_checked=True)
            exits.append(cell)
            costs.append(cost)
            penalties.append(_TURN_PENALTY if turn >= 0 else 0.0)
    return ClearedStart(
        graph=graph,
        leaving=leaving,
        exits=np.array(exits, np.int64).reshape(-1, 2),
        costs=np.array(costs, np.float64),
        penalties=np.array(penalties, np.float64),
    )


@kernel
def _clearance_grows(solid, y, x, end_y, end_x, enough):
    """Whether the distance from solid cells' squares never decreases along a line, up to enough."""
    count = math.ceil(math.hypot(end_y - y, end_x - x) * _SAMPLES_PER_CELL) + 1
    before = 0.0
    for i in range(count + 1):
        at_y, at_x = y + (end_y - y) * i / count, x + (end_x - x) * i / count
        clearance = enough
        for iy in range(
            max(math.floor(at_y - enough), 0), min(math.floor(at_y + enough) + 1, len(solid))
        ):
            for ix in range(
                max(math.floor(at_x - enough), 0),
                min(math.floor(at_x + enough) + 1, solid.shape[1]),
            ):
                if solid[iy, ix]:
                    dy = max(abs(iy + 0.5 - at_y) - 0.5, 0.0)
                    dx = max(abs(ix + 0.5 - at_x) - 0.5, 0.0)
                    clearance = min(clearance, math.hypot(dy, dx))
        if clearance < before - _ROUNDING_ERROR or clearance == 0.0:
            return False
        before = clearance
    return True


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
