# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Why there is no path, in one sentence that names the start or the goal where it is theirs."""

from __future__ import annotations

import math

import numpy as np

from heightmap25d_ros.grid.height_map import Area, Cell
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.plan import Plan, Status


def no_way_out(graph: TransitionGraph, start: Cell, robot_radius: float) -> Plan:
    """The robot does not get away from where it stands.

    Parameters
    ----------
    graph : TransitionGraph
        Cleared of noise under the robot.
    start : (row, column)
    robot_radius : float [m]
    """
    problem = "cannot be left: obstacles are too near to the robot's rectangle"
    if not graph.enterable[start]:
        problem = _problem(graph, start, robot_radius)
    return Plan(status=Status.START_OCCUPIED, reason=f"the start {problem}")


def no_path(
    original: TransitionGraph, graph: TransitionGraph, goal: Cell, robot_radius: float
) -> Plan:
    """The search has not found the goal.

    Parameters
    ----------
    original : TransitionGraph
    graph : TransitionGraph
        The same without the cells in which the rectangle does not fit.
    goal : (row, column)
    robot_radius : float [m]
    """
    if not original.enterable[goal]:
        problem = _problem(original, goal, robot_radius)
        return Plan(status=Status.GOAL_OCCUPIED, reason=f"the goal {problem}")
    beside = Area(*goal, 1, 1).grown(1).within(graph.area).slices(graph.area)
    if (original.enterable[beside] & ~graph.enterable[beside]).any():
        reason = "the robot's rectangle does not fit at the goal"
        return Plan(status=Status.GOAL_OCCUPIED, reason=reason)
    reason = "no drivable path connects start and goal"
    return Plan(status=Status.NO_VALID_PATH, reason=reason)


def _problem(graph: TransitionGraph, cell: Cell, robot_radius: float) -> str:
    """Why a cell cannot contain the robot's centre."""
    if graph.forbidden[cell]:
        return "is on unknown ground"
    if graph.occupied[cell]:
        return "is on an obstacle: a step or a slope that is too high"
    resolution = graph.geometry.resolution
    area = Area(cell[0], cell[1], 1, 1).grown(math.ceil(robot_radius / resolution) + 1)
    area = area.within(graph.area)
    iy, ix = np.nonzero(graph.occupied[area.slices(graph.area)])
    distance = np.hypot(iy + area.iy - cell[0], ix + area.ix - cell[1]) * resolution
    if len(distance) and distance.min() <= robot_radius + 1e-6:
        return f"is {distance.min():.2f} m from an obstacle: the robot does not fit there"
    return "is too near to unknown ground"
