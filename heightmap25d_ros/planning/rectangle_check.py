# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the robot's rectangle passes along a path, and which cell to close where it does not."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import Cell
from heightmap25d_ros.planning.collision import first_free, first_overlap, overlapped, swept
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.plan import Pose2D, in_cells

_ROUNDING_ERROR = 1e-9
"""Of distances [cells]."""

_LONGEST = 8.0
"""Length of the pieces in which a line is checked [cells]: around long ones lie many cells."""


def fits_at(graph: TransitionGraph, pose: Pose2D, size: tuple[float, float]) -> bool:
    """Whether a rectangle (length, width) [cells] overlaps no obstacle at a pose."""
    rectangle = [*in_cells(pose, graph.geometry), 0.5 * size[0], 0.5 * size[1]]
    return first_overlap(graph.occupied, np.array([rectangle])) < 0


def line_fits(graph: TransitionGraph, size: tuple[float, float], start: Array, end: Array) -> bool:
    """Whether a rectangle (length, width) moves along a line [cells] without an overlap."""
    count = math.ceil(math.hypot(*(end - start)) / _LONGEST) + 1
    points = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
    heading = np.full(count, math.atan2(*(end - start)))
    return first_overlap(graph.occupied, swept(points, heading, *size)) < 0


def cell_to_close(
    graph: TransitionGraph,
    points: Array,
    heading: Array,
    size: tuple[float, float],
    end: Pose2D,
    *,
    is_turn_checked: bool,
) -> Cell | None:
    """The cell without which the search finds another path, or None where the rectangle passes.

    Parameters
    ----------
    graph : TransitionGraph
    points : (N, 2) float64 [cells]
    heading : (N,) float64 [rad]
    size : (length, width) [cells]
    end : Pose2D
        Where the path ends.
    is_turn_checked : bool
        Whether the turn on the spot at the first point must be free as well.

    Returns
    -------
    (row, column) or None
        The start's cell where no other one can be closed. Where the robot cannot turn at the end
        when it comes from this side, the cell before.
    """
    index = first_blocked(graph.occupied, points, heading, size, is_turn_checked=is_turn_checked)
    if index < 0:
        return None
    cells = [(int(y), int(x)) for y, x in np.floor(points)]
    start, goal = cells[0], cells[-1]
    open_cells = [
        (i, cell)
        for i, cell in enumerate(cells)
        if cell not in (start, goal) and graph.enterable[cell]
    ]
    later = [cell for i, cell in open_cells if i >= index]
    if later:
        return later[0]
    if goal == start or not open_cells or (end.yaw is not None and not fits_at(graph, end, size)):
        return goal
    return open_cells[-1][1]


def first_blocked(
    solid: NDArray[np.bool_],
    points: Array,
    heading: Array,
    size: tuple[float, float],
    *,
    is_turn_checked: bool = False,
) -> int:
    """Where along a path a robot that stands at its beginning does not pass.

    Cells that the rectangle overlaps at the first point, turned to the path, may be overlapped
    until it is free for the first time, if the robot moves away from each of them, and never
    comes nearer to the nearest one.

    Parameters
    ----------
    solid : (rows, columns) bool
    points : (N, 2) float64 [cells]
    heading : (N,) float64 [rad]
    size : (length, width) [cells]
    is_turn_checked : bool
        Whether the turn on the spot at the first point must be free as well.

    Returns
    -------
    int
        Index of the point nearest to the first rectangle of `swept` that is blocked, or -1.
    """
    if len(points) > 1 and not is_turn_checked:
        heading = np.array([math.atan2(*(points[1] - points[0])), *heading[1:]])
    rectangles = swept(points, heading, *size)
    if is_turn_checked or first_overlap(solid, rectangles[:1]) < 0:
        index = first_overlap(solid, rectangles)
    else:
        index = _first_blocked_leaving(solid, rectangles)
    if index < 0:
        return -1
    return int(np.hypot(*(points - rectangles[index, :2]).T).argmin())


def _first_blocked_leaving(solid: NDArray[np.bool_], rectangles: NDArray[np.float64]) -> int:
    """Index of the first rectangle that is blocked for a robot whose first one overlaps cells."""
    free = first_free(solid, rectangles)
    free = len(rectangles) if free < 0 else free
    cells, heading = overlapped(solid, rectangles[0]), rectangles[0, 2]
    dy, dx = _from_squares(cells, rectangles[:1, :2])[:, 0].T
    is_left = dy * math.sin(heading) + dx * math.cos(heading) >= -_ROUNDING_ERROR
    cells = cells[is_left & (np.hypot(dy, dx) > 0.0)]
    others = solid.copy()
    others[tuple(cells.T)] = False
    blocked = first_overlap(others, rectangles[:free])
    if blocked >= 0:
        return blocked
    if len(cells):
        away = np.hypot(*_from_squares(cells, rectangles[:free, :2]).T).min(axis=1)
        comes_near = np.diff(away) < -_ROUNDING_ERROR
        if comes_near.any():
            return int(comes_near.argmax()) + 1
    blocked = first_overlap(solid, rectangles[free:])
    return blocked + free if blocked >= 0 else -1


def _from_squares(cells: NDArray[np.int64], points: Array) -> Array:
    """(K, N, 2): from the nearest point of each cell's square (K, 2) to points (N, 2)."""
    offset = points[None] - (cells[:, None] + 0.5)
    return np.asarray(np.sign(offset) * np.maximum(np.abs(offset) - 0.5, 0.0))
