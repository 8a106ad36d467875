# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The planning node: a height grid and a goal in, a path out."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
from geometry_msgs.msg import (
    PolygonStamped,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovarianceStamped,
)
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan
from tf2_msgs.msg import TFMessage

from heightmap25d_msgs.msg import HeightGrid, PlanStatus, UpperSurfaces
from heightmap25d_ros.io import encode
from heightmap25d_ros.nodes import qos, runtime
from heightmap25d_ros.nodes.interface import Action, Input, Output, Service
from heightmap25d_ros.nodes.lifecycle import ManagedNode
from heightmap25d_ros.nodes.map_source import map_inputs
from heightmap25d_ros.nodes.planner_server import IS_AVAILABLE, PlannerServer
from heightmap25d_ros.nodes.pose_source import pose_inputs
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.planning import Planning
from heightmap25d_ros.pipelines.silence import CHECKS
from heightmap25d_ros.planning.plan import Plan, Status
from heightmap25d_ros.planning.planner import compile_kernels
from heightmap25d_ros.viz.field_arrows import field_arrows

_FIELD_PERIOD = 1.0  # [s] between two fields at the least
_SPEED_PERIOD = 0.2  # [s] between two limits of the speed at the least


class PlanningNode(ManagedNode):
    """Hands messages to `Planning`, and publishes the plans that it returns."""

    NAME = "planning"
    PARAMETERS = (
        "traversability", "planner", "planning", "levels", "mapping.map_frame", "intake.base_frame",
        "intake.pose_source", "intake.odom_frame", "intake.odom_gap",
        "intake.timeout",
    )  # fmt: skip

    def inputs(self) -> list[Input]:
        """The map, the robot and its goals."""
        return [
            *map_inputs(self, self._on_map, self._on_map_update, self._on_upper_surfaces),
            *pose_inputs(
                self.params.intake, self._on_odometry, self._on_transforms, self.flatness
            ),
            Input(PoseStamped, "goal_pose", self._on_goal, qos.QUEUE),
            Input(
                PoseWithCovarianceStamped, "pose_correction", self._planning.take_correction,
                qos.QUEUE,
            ),
            Input(PolygonStamped, "boundary", self._on_boundary, qos.LATCHED),
        ]  # fmt: skip

    def outputs(self) -> list[Output]:
        """The plan, how it came about, and the best directions over the map."""
        return [
            Output(Path, "plan", qos.LATCHED),
            Output(PlanStatus, "~/status", qos.LATCHED),
            Output(PoseArray, "~/field", qos.LATCHED),
            *([] if self._server is None else self._server.outputs()),
        ]

    def offered_services(self) -> list[Service]:
        """Plans between any two poses."""
        of_nav2 = [] if self._server is None else self._server.services()
        return [Service(GetPlan, "~/get_plan", self._get_plan), *of_nav2]

    def offered_actions(self) -> list[Action]:
        """Paths, as Nav2 asks for them."""
        return [] if self._server is None else self._server.actions()

    def set_up(self) -> None:
        """Make the planner."""
        self._planning = Planning(self.params)
        self._server = PlannerServer(self, self._planning, self._show) if IS_AVAILABLE else None
        self._plan: Plan | None = None
        self._is_stale = False
        self._unshown: Plan | None = None  # whose field has not been published
        compile_kernels()

    def finish(self) -> bool:
        """Give up the goals that are planned to; there is nothing to save."""
        if self._server is not None:
            self._server.close()
        return True

    def start(self) -> None:
        """Publish the field now and then; look for silence by the node's clock."""
        self.create_timer(self.params.intake.timeout / CHECKS, self._pass_time)
        self.create_wall_timer(_FIELD_PERIOD, self._publish_field)
        if self._server is not None:
            self.create_wall_timer(_SPEED_PERIOD, self._limit_speed)

    def take_params(self) -> None:
        """Apply new parameters; the goal is kept, and planned to again where they ask for it."""
        self._publish(self._planning.set_params(self.params))

    @property
    def dropped(self) -> Drops:
        """How many messages were not used, by reason."""
        return self._planning.dropped

    def trouble(self) -> str:
        """Why nobody should follow the plan."""
        return self._planning.trouble

    def figures(self) -> dict[str, Any]:
        """What /diagnostics reports of the last plan."""
        if self._plan is None:
            return {"last plan": "none"}
        return {
            "last plan": "found" if self._plan.found else self._plan.status.name,
            "last plan: reason": self._plan.reason,
            "last plan: length [m]": round(self._plan.length, 2),
            "last plan: took [ms]": round(1e3 * self._plan.seconds, 1),
        }

    def _on_goal(self, message: PoseStamped) -> None:
        self._publish(self._planning.take_goal(message))

    def _on_boundary(self, message: PolygonStamped) -> None:
        self._publish(self._planning.take_boundary(message))

    def _on_map(self, message: HeightGrid) -> None:
        self._publish(self._planning.take_map(message))

    def _on_map_update(self, message: HeightGrid) -> None:
        self._publish(self._planning.take_map_update(message))

    def _on_upper_surfaces(self, message: UpperSurfaces) -> None:
        self._publish(self._planning.take_upper_surfaces(message))

    def _on_odometry(self, message: Any) -> None:
        self._publish(self._planning.take_odometry(message))

    def _on_transforms(self, message: TFMessage, is_static: bool) -> None:
        self._publish(self._planning.take_transforms(message, is_static=is_static))

    def _publish(self, plan: Plan | None) -> None:
        if plan is None:
            return
        self._show(plan)
        if plan.found:
            milliseconds = 1e3 * plan.seconds
            self.get_logger().info(f"path of {plan.length:.1f} m found in {milliseconds:.0f} ms")
        else:
            self.get_logger().warning(f"no path: {plan.reason}")

    def _show(self, plan: Plan) -> Path:
        """Publish a plan and its status; the message of its path."""
        self._plan = self._unshown = plan
        stamp = self.get_clock().now().nanoseconds
        path = Path()
        self._fill_path(path, plan, stamp)
        self.publish("plan", path)
        self._publish_status(plan, stamp)
        return path

    def _publish_status(self, plan: Plan, stamp: int) -> None:
        """Of a plan; a stale one has TF_ERROR and its figures."""
        staleness = self._planning.staleness
        self._is_stale = bool(staleness)
        if staleness:
            plan = replace(plan, status=Status.TF_ERROR, reason=staleness)
        status = PlanStatus()
        encode.fill_plan_status(status, plan)
        encode.fill_header(status.header, stamp, self.params.mapping.map_frame)
        self.publish("~/status", status)

    def _pass_time(self) -> None:
        """Publish the status again where the plan becomes stale, and where it is not any more."""
        now = self.get_clock().now().nanoseconds
        self._planning.pass_time(now)
        if self._plan is not None and bool(self._planning.staleness) != self._is_stale:
            self._publish_status(self._plan, now)

    def _limit_speed(self) -> None:
        if self._server is not None and self._plan is not None:
            self._server.limit_speed(self._plan)

    def _publish_field(self) -> None:
        """The newest plan's field, if somebody wants to see it."""
        plan = self._unshown
        if plan is None or not self.has_subscribers("~/field"):
            return
        self._unshown = None
        poses = np.empty((0, 4, 4))
        if plan.graph is not None and plan.cost_to_go is not None:
            poses = field_arrows(plan.graph, plan.cost_to_go)
        field, stamp = PoseArray(), self.get_clock().now().nanoseconds
        encode.fill_poses(field, Pose, poses, stamp, self.params.mapping.map_frame)
        self.publish("~/field", field)

    def _fill_path(self, path: Path, plan: Plan, stamp: int) -> None:
        frame = self.params.mapping.map_frame
        encode.fill_path(path, PoseStamped, plan.poses, stamp, frame)

    def _get_plan(self, request: GetPlan.Request, response: GetPlan.Response) -> GetPlan.Response:
        plan = self._planning.answer(request.start, request.goal, request.tolerance)
        self._fill_path(response.plan, plan, self.get_clock().now().nanoseconds)
        if not plan.found:
            self.get_logger().warning(f"get_plan: no path: {plan.reason}")
        return response


def main() -> int:
    """Run the node."""
    return runtime.run(PlanningNode)


if __name__ == "__main__":
    sys.exit(main())
