# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The goal that is driven to, and the direction in which its path leads."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.planning.plan import Plan, Pose2D
from heightmap25d_ros.planning.search import UNREACHABLE

AHEAD = 1.0
"""The best direction is that to the point so far along the cheapest path [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mission:
    """A goal and the plan to it.

    Attributes
    ----------
    goal : Pose2D
    plan : Plan
        With a path, or the reason why there is none now: then it is planned to again.
    moved_from : (2,) float64 [m], map
        Where the robot was when the direction of its motion was last looked at.
    """

    goal: Pose2D
    plan: Plan
    moved_from: Array


def best_direction(plan: Plan, point: Array) -> float | None:
    """Heading [rad] of the cheapest path from a point (2,) [m]; None where there is none."""
    field, graph = plan.cost_to_go, plan.graph
    if field is None or graph is None:
        return None
    iy, ix = graph.geometry.cell_at(point)
    if not graph.geometry.contains((iy, ix)):
        return None
    if field[iy, ix] == UNREACHABLE:  # it still leaves the obstacle beside which it stood
        path = plan.poses[:, :2, 3]
        first = int(np.hypot(*(path - point).T).argmin())
        ahead_x, ahead_y = path[min(first + 1, len(path) - 1)] - path[first]
        return math.atan2(ahead_y, ahead_x) if ahead_x or ahead_y else None
    cells = field.cheapest_path((int(iy), int(ix)))
    ahead = cells[min(len(cells) - 1, round(AHEAD / graph.geometry.resolution))]
    step = ahead - (iy, ix)
    return math.atan2(*step) if step.any() else None
