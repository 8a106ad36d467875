# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An exploration under way: what the robot is at, and whether it gets on."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from heightmap25d_ros.exploration.explorer import Explorer
from heightmap25d_ros.exploration.survey import Survey
from heightmap25d_ros.pipelines.exploration_task import End, Task
from heightmap25d_ros.planning.plan import Pose2D

_MOVED = 0.1  # [m] and as many radians: less is no motion
_TRAIL = 2.0  # [m] between two places that are remembered


@dataclass(slots=True, kw_only=True, eq=False)
class Run:
    """An exploration under way."""

    task: Task
    explorer: Explorer
    home: Pose2D | None = None
    goal: Pose2D | None = None
    gain: float = 0.0
    sent_ns: int = 0
    headings: list[float] = field(default_factory=list)  # still to be turned to; the next first
    maps_at_last_heading: int | None = None
    checked_s: float = 0.0
    moved_s: float = 0.0  # when the robot moved last
    rested_at: Pose2D | None = None  # where that was
    given_up: int = 0  # goals since the robot moved last
    fault: str = ""  # of the last of them
    refused: list[Pose2D] = field(default_factory=list)  # by planning: to be tried once more
    is_last_try: bool = False
    lost_s: float = 0.0  # for how long the pose has been unknown
    is_relocating: bool = False
    trail: list[Pose2D] = field(default_factory=list)
    ending: tuple[End, str] | None = None  # while it returns
    elapsed: float = 0.0
    distance: float = 0.0

    @property
    def limit(self) -> str:
        """The limit that is reached, in words; else empty."""
        if 0.0 < self.task.time_limit <= self.elapsed:
            return f"the limit of {self.task.time_limit:g} s is reached"
        if 0.0 < self.task.distance_limit <= self.distance:
            return f"the limit of {self.task.distance_limit:g} m is reached"
        return ""

    @property
    def told_done(self) -> str:
        """That nothing is left to do, in words."""
        count = len(self.explorer.given_up)
        reason = f"no place is left that shows {self.task.min_gain:g} m^2 or more"
        return f"{reason}; {count} could not be reached" if count else reason

    @property
    def told_stuck(self) -> str:
        """That the robot does not get on, in words."""
        return f"the robot has not moved for {self.given_up} goals: {self.fault}"

    def give_up(self, goal: Pose2D, fault: str, *, is_refused: bool) -> None:
        """Be done with a goal, for a fault; what planning has refused is tried once more."""
        self.explorer.give_up(goal)
        if is_refused and self.is_last_try:
            return
        self.given_up += 1
        self.fault = fault
        if is_refused:
            self.refused.append(goal)

    def tries_again(self) -> bool:
        """Take back what planning has refused, since from elsewhere it may find a path."""
        if self.is_last_try or not self.refused:
            return False
        self.is_last_try = True
        self.explorer.take_back(self.refused)
        return True

    def forget(self) -> None:
        """The map was begun anew."""
        self.explorer.forget()
        self.home, self.refused, self.is_last_try = None, [], False

    def is_worth(self, survey: Survey, goal: Pose2D, keep_gain: float) -> bool:
        """Whether enough of a goal's gain is left, and the way to it open."""
        least = keep_gain * self.gain
        if self.gain >= self.task.min_gain:  # else it is a way to more
            least = max(least, self.task.min_gain)
        return survey.gain_of(goal) >= least and math.isfinite(survey.cost_of(goal))

    def note_motion(self, robot: Pose2D, *, is_sure: bool) -> None:
        """The robot is at a place; where its pose is sure there, it may be returned to."""
        before = self.rested_at
        if before is None or _has_moved(before, robot):
            is_away = before is not None and math.hypot(robot.x - before.x, robot.y - before.y)
            self.rested_at, self.moved_s = robot, self.elapsed
            self.given_up = 0 if is_away else self.given_up
        if is_sure and all(
            math.hypot(robot.x - place.x, robot.y - place.y) > _TRAIL for place in self.trail
        ):
            self.trail.append(robot)

    def standstill(self, timeout: float) -> str:
        """That the robot has not moved for longer than that [s], in words; else empty."""
        seconds = self.elapsed - max(self.moved_s, 0.0)
        return f"the robot has not moved for {seconds:.0f} s" if seconds > timeout else ""

    def drop_goal(self) -> None:
        """Be sent nowhere."""
        self.goal, self.gain, self.headings = None, 0.0, []
        self.maps_at_last_heading, self.is_relocating = None, False


def _has_moved(before: Pose2D, after: Pose2D) -> bool:
    turned = abs(math.remainder((after.yaw or 0.0) - (before.yaw or 0.0), 2.0 * math.pi))
    return math.hypot(after.x - before.x, after.y - before.y) + turned > _MOVED
