# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated robot explores a world: mapping, planning, exploration and control in one process.

The pipelines of the nodes, driven by simulated time: the same run each time, faster than real time.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.io.decode import Odometry
from heightmap25d_ros.localization.tracking_state import State as LocalizationState
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.exploration import Exploration
from heightmap25d_ros.pipelines.exploration_task import Task
from heightmap25d_ros.pipelines.localization import Localizer, Pose
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.path_following import PathFollowing
from heightmap25d_ros.pipelines.planning import Planning
from heightmap25d_ros.planning.plan import Plan, Pose2D
from heightmap25d_ros.simulation import messages
from heightmap25d_ros.simulation.messages import stamp_ns
from heightmap25d_ros.simulation.simulation import Simulation, TimedMessage
from heightmap25d_ros.viz.exploration_figures import Snapshot

_ADVANCE = 0.2  # [s] between two turns of the exploration
_SNAPSHOT = 2.0  # [s] between two pictures of the animation


@dataclass(slots=True, kw_only=True, eq=False)
class Record:
    """What was seen of a run.

    Attributes
    ----------
    trajectory : list of (int, (4, 4) float64)
        Stamps [ns] and true poses.
    snapshots : list of Snapshot
    contacts : int
        How often something stopped the robot.
    plans, refused : int
        Paths, and goals that planning refused.
    decision_s : list of float [s]
        CPU time of each turn of the exploration that looked over the map.
    told : list of (Pose, State)
        The poses that localization told, and how sure it was of them.
    submap_starts : list of (4, 4) float64
        The true poses of the robot where localization began its submaps.
    """

    trajectory: list[tuple[int, se3.Matrix]] = field(default_factory=list)
    snapshots: list[Snapshot] = field(default_factory=list)
    contacts: int = 0
    plans: int = 0
    refused: int = 0
    decision_s: list[float] = field(default_factory=list)
    told: list[tuple[Pose, LocalizationState]] = field(default_factory=list)
    submap_starts: list[se3.Matrix] = field(default_factory=list)


class SimulatedExploration:
    """All of a robot that explores, in steps of the simulation.

    Parameters
    ----------
    simulation : Simulation
        Its odometry is taken for true, if there is no localization.
    params : Params
    task : Task
    exploration : Exploration, optional
        One that chooses otherwise.
    localizer : Localizer, optional
        Tells the pose.

    Attributes
    ----------
    mapping : Mapping
    exploration : Exploration
    record : Record
    """

    def __init__(
        self,
        simulation: Simulation,
        params: Params,
        task: Task,
        exploration: Exploration | None = None,
        localizer: Localizer | None = None,
    ) -> None:
        self.mapping = Mapping(params)
        self.exploration = exploration or Exploration(params)
        self.record = Record()
        self._simulation = simulation
        self._params = params
        self._localizer = localizer
        self._map_version = (0, 0, 0)
        self._planning = Planning(params)
        self._following = PathFollowing(params)
        self._planning.set_boundary(task.boundary)
        self._velocity = (0.0, 0.0)
        self._path = np.empty((0, 2))
        self._was_blocked = False
        self._due = {"map": 0.0, "advance": 0.0, "snapshot": 0.0}
        self.exploration.start(task)
        self._take(simulation.begin())

    def run(self, time_limit: float) -> None:
        """Run until the exploration has ended, or for so long [s], simulated."""
        while self.exploration.is_running and self._simulation.seconds < time_limit:
            self.step()
        self._take_snapshot()

    def step(self) -> None:
        """Advance by a step of the simulation."""
        self._take(self._simulation.step(*self._velocity))
        is_blocked = self._simulation.robot.is_blocked
        self.record.contacts += is_blocked and not self._was_blocked
        self._was_blocked = is_blocked
        if self._is_due("map", 1.0 / self._params.mapping.publish_rate):
            self._publish_map()
        if self._is_due("advance", _ADVANCE):
            self._advance()
        if self._is_due("snapshot", _SNAPSHOT):
            self._take_snapshot()

    def _is_due(self, what: str, period: float) -> bool:
        if self._simulation.seconds < self._due[what]:
            return False
        self._due[what] = self._simulation.seconds + period - 1e-9
        return True

    def _take(self, events: list[TimedMessage]) -> None:
        for _, topic, message in events:
            if topic == "/odom":
                self._localize(message)
                self.mapping.take_odometry(message)
                self._follow(self._planning.take_odometry(message))
                self.exploration.take_odometry(message)
                velocity = self._following.take_odometry(message)
                self._velocity = velocity.speed, velocity.turn_rate
                now = stamp_ns(self._simulation.seconds)
                self.record.trajectory.append((now, self._simulation.robot.T))
            elif topic == "/tf_static":
                for pipeline in self._with_scans:
                    pipeline.take_transforms(message, is_static=True)
            elif topic in self._params.intake.scan_topics:
                for pipeline in self._with_scans:
                    pipeline.take_scan(topic, message)

    @property
    def _with_scans(self) -> tuple[Mapping | Localizer, ...]:
        return (self.mapping,) if self._localizer is None else (self._localizer, self.mapping)

    def _localize(self, odometry: Any) -> None:
        """Correct the pose of all by that of localization."""
        localizer = self._localizer
        if localizer is None:
            return
        localizer.take_odometry(odometry)
        if localizer.pose is None:
            return
        frame, seconds = self._params.mapping.map_frame, self._simulation.seconds
        if localizer.map_version != self._map_version:
            self._map_version = localizer.map_version
            begun_ns, poses = self._map_version[0], localizer.submap_poses()
            self.mapping.take_submaps(messages.path(begun_ns, frame, poses))
            # A submap began some moments ago, and the robot has hardly moved since.
            T_true_map = self._simulation.robot.T @ se3.inverse(localizer.pose.T_map_base)
            newest = poses[len(self.record.submap_starts) :]
            self.record.submap_starts += list(T_true_map @ newest)
        correction = messages.correction(seconds, frame, localizer.pose.T_map_odom)
        for pipeline in (self.mapping, self._planning, self._following, self.exploration):
            pipeline.take_correction(correction)
        self.exploration.take_localization_status(
            SimpleNamespace(
                state=localizer.state,
                LOST=LocalizationState.LOST,
                position_deviation=localizer.deviation[0],
            )
        )
        self.record.told.append((localizer.pose, localizer.state))

    def _publish_map(self) -> None:
        if not self.mapping.merged["scans"]:
            return
        height_map, _ = self.mapping.maps()
        self._follow(self._planning.set_map(height_map))
        self._following.set_map(height_map)
        self.exploration.set_map(height_map)

    def _advance(self) -> None:
        before, began = self.exploration.survey, time.process_time()
        goal = self.exploration.advance(stamp_ns(self._simulation.seconds))
        if self.exploration.survey is not before:
            self.record.decision_s.append(time.process_time() - began)
        if goal is not None:
            frame = self._params.mapping.map_frame
            stamped = Odometry(stamp_ns=0, frame_id=frame, child_frame_id="goal", T=_pose(goal))
            self._follow(self._planning.set_goal(stamped))

    def _follow(self, plan: Plan | None) -> None:
        if plan is None:
            return
        self.record.plans += plan.found
        self.record.refused += not plan.found
        poses = plan.poses
        heading = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
        self._path = poses[:, :2, 3]
        self._following.set_path(np.column_stack([self._path, heading]))
        self.exploration.set_plan_refusal("" if plan.found else plan.reason)

    def _take_snapshot(self) -> None:
        if not self.mapping.merged["scans"]:
            return
        exploration = self.exploration
        choice = exploration.choice
        self.record.snapshots.append(
            Snapshot(
                seconds=self._simulation.seconds,
                distance=exploration.distance,
                covered_area=exploration.survey.covered_area if exploration.survey else 0.0,
                height_map=self.mapping.maps()[0],
                robot=self._simulation.robot.T,
                goal=exploration.goal,
                places=np.empty((0, 2)) if choice is None else choice.places,
                gains=np.empty(0) if choice is None else choice.gains,
                path=self._path,
            )
        )


def _pose(place: Pose2D) -> se3.Matrix:
    yaw = place.yaw or 0.0
    T = np.eye(4)
    T[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    T[:3, 3] = place.x, place.y, place.z or 0.0
    return T
