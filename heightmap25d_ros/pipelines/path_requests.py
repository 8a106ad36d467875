# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Paths that are asked for, through any number of goals; planned by whichever thread."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params.sections import Params, PlannerParams
from heightmap25d_ros.planning.boundary import Boundary
from heightmap25d_ros.planning.kept_graph import KeptGraphs
from heightmap25d_ros.planning.level_planner import LevelPlanner, planner_over
from heightmap25d_ros.planning.plan import Plan, Pose2D, Status, joined, pose_2d
from heightmap25d_ros.planning.planner import Planner


class KeptPlanner:
    """The planner over the newest of many maps, whose graph is kept, see `KeptGraph`.

    Any thread may use it. A map is converted by the first one that needs it; what others plan over
    meanwhile does not change.

    Parameters
    ----------
    params : Params
    boundary : Boundary
        That the robot's middle does not leave.
    """

    def __init__(self, params: Params, boundary: Boundary) -> None:
        self._params = params
        self._graphs = KeptGraphs(params.traversability, params.planner, boundary)
        self._newest: _Lent | None = None
        self._lock = threading.Lock()

    @contextmanager
    def over(self, height_map: HeightMap) -> Iterator[Planner | LevelPlanner]:
        """The planner over a map, as long as it is used.

        Raises
        ------
        InputError
            If the map cannot be converted.
        """
        lent = self._lent(height_map)
        try:
            yield lent.planner
        finally:
            with self._lock:
                lent.users -= 1

    def _lent(self, height_map: HeightMap) -> _Lent:
        with self._lock:
            lent = self._newest
            if lent is None or lent.height_map is not height_map:
                if lent is not None and lent.users:
                    self._graphs.lend()
                params, self._newest = self._params, None  # nothing is kept of what fails
                planner = planner_over(
                    height_map,
                    params.levels,
                    params.traversability,
                    params.planner,
                    self._graphs.of,
                )
                lent = self._newest = _Lent(height_map, planner)
            lent.users += 1
            return lent


@dataclass(slots=True, eq=False)
class _Lent:
    """A planner, and how many use it at the moment."""

    height_map: HeightMap
    planner: Planner | LevelPlanner
    users: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class MapPlanner:
    """The planner over one map, which is converted when it is needed.

    Attributes
    ----------
    height_map : HeightMap
    kept : KeptPlanner
    """

    height_map: HeightMap
    kept: KeptPlanner

    @property
    def problem(self) -> str:
        """Why nothing can be planned on the map; empty where something can be."""
        if not self.height_map.is_level:
            return ""
        return "the map was made by level lasers, its ground is unknown: nothing can be planned"

    @contextmanager
    def planner(self) -> Iterator[Planner | LevelPlanner]:
        """The planner, as long as it is used.

        Raises
        ------
        InputError
            If the map cannot be converted, or has no ground.
        """
        if self.problem:
            raise InputError(self.problem)
        with self.kept.over(self.height_map) as planner:
            yield planner


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
            with self.over.planner() as own:
                planner = own if self.params is None else own.with_params(self.params)
                return self._planned(planner, is_cancelled)
        except InputError as error:
            return Plan(status=Status.UNKNOWN, reason=str(error))

    def _planned(self, planner: Planner | LevelPlanner, is_cancelled: Callable[[], bool]) -> Plan:
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
