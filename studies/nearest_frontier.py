# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The nearest frontier by the rule of explore_lite (m-explore-ros2), with its defaults.

A frontier is a connected set of unknown cells that border on free ones which a flood fill from the
robot reaches; it is worth ``gain_scale`` times its size less ``potential_scale`` times its distance
from the robot. The goal is its centroid, chosen anew every three seconds; one towards which the
robot does not come nearer for 30 s, or to which there is no path, is put on a list.
"""

import math

import numpy as np
from scipy import ndimage

from heightmap25d_ros.pipelines.exploration import Exploration
from heightmap25d_ros.pipelines.exploration_task import End, State
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.terrain.traversability import to_obstacle_map

PERIOD, TIMEOUT = 1 / 0.33, 30.0  # [s] of planner_frequency, progress_timeout
POTENTIAL_SCALE, GAIN_SCALE, LEAST_SIZE = 3.0, 1.0, 0.75  # [1], [1], [m]
SAME = 5  # [cells]: nearer goals to one of the list are not chosen


class NearestFrontier(Exploration):
    """An `Exploration` that chooses as explore_lite does."""

    def __init__(self, params) -> None:
        super().__init__(params)
        self._next_s, self._seconds, self._begin_ns = 0.0, 0.0, None
        self._listed: list[Pose2D] = []
        self._progress = (math.inf, 0.0)  # nearest that it came to its goal, and when
        self._target: Pose2D | None = None

    def advance(self, now_ns):
        self._begin_ns = self._begin_ns or now_ns
        self._seconds = (now_ns - self._begin_ns) * 1e-9
        self._run.elapsed = self._seconds
        robot = self._robot()
        if not self.is_running or robot is None or self._map is None:
            return None
        if 0.0 < self._run.task.distance_limit <= self.distance:
            return self._finish(End.LIMIT, "the limit of distance is reached")
        if 0.0 < self._run.task.time_limit <= self._seconds:
            return self._finish(End.LIMIT, "the limit of time is reached")
        if self._target is not None:
            away = math.hypot(self._target.x - robot.x, self._target.y - robot.y)
            if away < self._progress[0] - 0.05:
                self._progress = away, self._seconds
            if self._refusal or self._seconds - self._progress[1] > TIMEOUT:
                self._listed.append(self._target)
                self._refusal, self._next_s = "", 0.0
        if self._seconds < self._next_s:
            return None
        self._next_s = self._seconds + PERIOD
        return self._nearest(robot)

    def _nearest(self, robot):
        target = self._best(robot)
        if target is None:
            return self._finish(End.DONE, "no frontier is left")
        before = self._target
        if before is None or math.hypot(before.x - target.x, before.y - target.y) > 0.01:
            self._target, self._progress = target, (math.inf, self._seconds)
            self.state = State.DRIVING
            return target
        return None

    def _best(self, robot):
        shown, side = self._map, self._map.geometry.resolution
        free = to_obstacle_map(shown, self._params.traversability).occupancy == 0
        iy, ix = shown.geometry.cell_at((robot.x, robot.y))
        parts, _ = ndimage.label(free)
        around = parts[max(iy - 3, 0) : iy + 4, max(ix - 3, 0) : ix + 4]
        reached = np.isin(parts, np.unique(around[around > 0]))
        inside = self._run.task.boundary.mask(shown.geometry)
        border = ~shown.known & ndimage.binary_dilation(reached) & inside
        frontiers, count = ndimage.label(border, np.ones((3, 3)))
        best, least = None, math.inf
        for n in range(1, count + 1):
            cells = np.argwhere(frontiers == n)
            if len(cells) * side < LEAST_SIZE:
                continue
            x, y = shown.geometry.cell_center(cells).mean(axis=0)
            if any(max(abs(x - g.x), abs(y - g.y)) < SAME * side for g in self._listed):
                continue
            distance = np.hypot(*(cells - (iy, ix)).T).min() * side
            cost = POTENTIAL_SCALE * distance - GAIN_SCALE * len(cells) * side
            if cost < least:
                best, least = Pose2D(float(x), float(y), yaw=robot.yaw), cost
        return best
