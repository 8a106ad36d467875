# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Paths that are asked for, through any number of goals; planned by whichever thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.exploration.boundary import Boundary, confined
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params.sections import Params, PlannerParams
from heightmap25d_ros.planning.level_planner import LevelPlanner, planner_over
from heightmap25d_ros.planning.plan import Plan, Pose2D, Status, joined, pose_2d
from heightmap25d_ros.planning.planner import Planner


class MapPlanner:
    """The planner over one map, which is converted when it is first needed, by one thread.

    Parameters
    ----------
    height_map : HeightMap
    params : Params
    boundary : Boundary, optional
        That the robot's middle does not leave.

    Attributes
    ----------
    height_map : HeightMap
    """

    def __init__(
        self, height_map: HeightMap, params: Params, boundary: Boundary | None = None
    ) -> None:
        self.height_map = height_map
        self._params = params
        self._boundary = boundary
        self._planner: Planner | LevelPlanner | None = None
        self._lock = threading.Lock()

    @property
    def problem(self) -> str:
        """Why nothing can be planned on the map; empty where something can be."""
        if not self.height_map.is_level:
            return ""
        return "the map was made by level lasers, its ground is unknown: nothing can be planned"

    def get(self, params: PlannerParams | None = None) -> Planner | LevelPlanner:
        """The planner; with other parameters of the search, where some are given.

        Raises
        ------
        InputError
            If the map cannot be converted, or has no ground.
        """
        if self.problem:
            raise InputError(self.problem)
        with self._lock:
            if self._planner is None:
                settings, boundary = self._params, self._boundary
                self._planner = planner_over(
                    self.height_map,
                    settings.levels,
                    settings.traversability,
                    settings.planner,
                    None if boundary is None else partial(confined, boundary=boundary),
                )
            own = self._planner
        return own if params is None else own.with_params(params)


@dataclass(frozen=True, slots=True, kw_only=True)
class PathRequest:
    """A start, and the goals that the path leads through in this order.

    Attributes
    ----------
    over : MapPlanner
    start : Pose2D
    goals : tuple of Pose2D
        At least one.
    is_robot_there : bool
        Whether the robot is at the start, see `Planner.plan`.
    params : PlannerParams or None
        In place of the map's own.
    """

    over: MapPlanner
    start: Pose2D
    goals: tuple[Pose2D, ...]
    is_robot_there: bool = False
    params: PlannerParams | None = None

    def plan(self, is_cancelled: Callable[[], bool] = lambda: False) -> Plan:
        """The path, or the reason why there is none: that of the first goal without one.

        Parameters
        ----------
        is_cancelled : callable, optional
            Asked before each goal.
        """
        try:
            planner = self.over.get(self.params)
        except InputError as error:
            return Plan(status=Status.UNKNOWN, reason=str(error))
        start, legs = self.start, list[Plan]()
        for number, goal in enumerate(self.goals, 1):
            if is_cancelled():
                return Plan(status=Status.UNKNOWN, reason="cancelled")
            leg = planner.plan(start, goal, is_robot_there=self.is_robot_there and not legs)
            if not leg.found:
                where = f"goal {number} of {len(self.goals)}: " if len(self.goals) > 1 else ""
                return replace(leg, reason=where + leg.reason)
            legs.append(leg)
            start = pose_2d(leg.poses[-1])
        return joined(legs)
