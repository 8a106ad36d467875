# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The exploration node: maps and poses in, goals for the planner out, until the map is complete."""

from __future__ import annotations

import math
import sys
from functools import partial
from typing import Any

from geometry_msgs.msg import Point, Point32, PolygonStamped, PoseStamped, PoseWithCovarianceStamped
from std_msgs.msg import ColorRGBA
from std_srvs.srv import SetBool, Trigger
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from heightmap25d_msgs.action import Explore
from heightmap25d_msgs.msg import (
    ExplorationStatus,
    LocalizationStatus,
    PlanStatus,
)
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.exploration.explorer import Choice, compile_kernels
from heightmap25d_ros.io import encode
from heightmap25d_ros.nodes import qos, runtime
from heightmap25d_ros.nodes.interface import Action, Input, Output, Service
from heightmap25d_ros.nodes.lifecycle import ManagedNode
from heightmap25d_ros.nodes.map_source import map_inputs
from heightmap25d_ros.nodes.pose_source import pose_inputs
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.exploration import Exploration
from heightmap25d_ros.pipelines.exploration_task import End, State, Task, requested
from heightmap25d_ros.planning.boundary import Boundary
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.viz import palette

_PERIOD = 0.2  # [s] between two turns
_SHOWN_PERIOD = 1.0  # [s] between two pictures, and two statuses in which nothing new is said
_MARK = 0.3  # [m] diameter of a place
_LIFT = 0.1  # [m] of markers above ground zero
_ENDINGS = (End.DONE, End.LIMIT)  # of an action that has succeeded


class ExplorationNode(ManagedNode):
    """Hands messages to `Exploration`, and publishes the goals that it returns.

    An exploration is started by the action, by ``~/start``, or at once by a parameter. There is one
    at a time: a new one ends the one before.
    """

    NAME = "exploration"
    PARAMETERS = (
        "exploration", "traversability", "levels", "planner", "mapping.map_frame",
        "intake.base_frame", "intake.pose_source", "intake.odom_frame", "intake.odom_gap",
    )  # fmt: skip

    def inputs(self) -> list[Input]:
        """The map, the robot, and what planning and localization say."""
        exploration = self._exploration
        return [
            *map_inputs(
                self, exploration.take_map, exploration.take_map_update,
                exploration.take_upper_surfaces,
            ),
            *pose_inputs(
                self.params.intake, exploration.take_odometry, self._on_transforms, self.flatness
            ),
            Input(
                PoseWithCovarianceStamped, "pose_correction", exploration.take_correction, qos.QUEUE
            ),
            Input(
                LocalizationStatus, "localization/status", exploration.take_localization_status,
                qos.LATCHED,
            ),
            Input(PlanStatus, "planning/status", exploration.take_plan_status, qos.LATCHED),
        ]  # fmt: skip

    def outputs(self) -> list[Output]:
        """Goals, the boundary for the planner, and what is going on."""
        return [
            Output(PoseStamped, "goal_pose", qos.QUEUE),
            Output(PolygonStamped, "boundary", qos.LATCHED),
            Output(ExplorationStatus, "~/status", qos.LATCHED),
            Output(MarkerArray, "~/markers", qos.LATCHED),
        ]

    def offered_services(self) -> list[Service]:
        """For people: start, stop, pause."""
        return [
            Service(Trigger, "~/start", self._on_start),
            Service(Trigger, "~/stop", self._on_stop),
            Service(SetBool, "~/pause", self._on_pause),
        ]

    def offered_actions(self) -> list[Action]:
        """For programs."""
        return [Action(Explore, "explore", self._accept, self._cancel)]

    def set_up(self) -> None:
        """Make the pipeline; nothing is explored before it is asked for."""
        Boundary.of(self.params.exploration.boundary)
        self._exploration = Exploration(self.params)
        self._goal: Any = None  # of the action that runs
        self._told: tuple[State, str] | None = None
        compile_kernels()

    def start(self) -> None:
        """Take turns by the node's clock."""
        self.create_timer(_PERIOD, self._turn)
        self.create_timer(_SHOWN_PERIOD, self._show)
        self._publish_status()
        own = self.params.exploration
        if own.start_at_once and not own.frontiers_only:
            self._begin(None)

    def finish(self) -> bool:
        """End what runs; there is nothing to save."""
        self._exploration.stop("the node ends")
        self._end_action()
        return True

    def take_params(self) -> None:
        """Apply new parameters, from the next start on."""
        self._exploration.set_params(self.params)

    @property
    def dropped(self) -> Drops:
        """How many messages were not used, by reason."""
        return self._exploration.dropped

    def trouble(self) -> str:
        """Why it cannot go on."""
        explored = self._exploration
        is_bad = explored.end in (End.STUCK, End.LOST)
        return f"{explored.end.name}: {explored.reason}" if is_bad else ""

    def figures(self) -> dict[str, Any]:
        """What /diagnostics reports of the exploration."""
        explored = self._exploration
        return {
            "state": explored.state.name,
            "reason": explored.reason,
            "distance [m]": round(explored.distance, 1),
            "covered [m^2]": round(explored.survey.covered_area, 1) if explored.survey else 0.0,
            "places given up": len(explored.given_up),
        }

    def _on_transforms(self, message: TFMessage, is_static: bool) -> None:
        self._exploration.take_transforms(message, is_static=is_static)

    def _turn(self) -> None:
        """Let the exploration go on, and tell what is new."""
        now = self.get_clock().now().nanoseconds
        self._send(self._exploration.advance(now))
        self._tell()

    def _tell(self) -> None:
        explored = self._exploration
        if (explored.state, explored.reason) == self._told:
            return
        self._told = explored.state, explored.reason
        end = f"{explored.end.name}: " if explored.end is not End.NONE else ""
        self.get_logger().info(f"{explored.state.name.lower()}: {end}{explored.reason}")
        self._publish_status()
        if explored.state is State.ENDED:
            self._end_action()

    def _send(self, goal: Pose2D | None) -> None:
        """Publish a goal for the planner."""
        if goal is None:
            return
        message = PoseStamped()
        self._fill_header(message.header)
        message.pose.position.x, message.pose.position.y = goal.x, goal.y
        message.pose.position.z = goal.z or 0.0  # which level
        half = (goal.yaw or 0.0) / 2.0
        message.pose.orientation.z, message.pose.orientation.w = math.sin(half), math.cos(half)
        self.publish("goal_pose", message)

    def _fill_header(self, header: Any) -> None:
        stamp = self.get_clock().now().nanoseconds
        encode.fill_header(header, stamp, self.params.mapping.map_frame)

    def _begin(self, task: Task | None) -> None:
        """Start an exploration, in place of one that runs."""
        task = task or Task.of(self.params)
        if self._exploration.is_running:
            self._send(self._exploration.stop("a new exploration was started"))
        self._end_action()
        self._exploration.start(task)
        polygon = PolygonStamped()
        self._fill_header(polygon.header)
        polygon.polygon.points = [Point32(x=x, y=y) for x, y in task.boundary.corners.tolist()]
        self.publish("boundary", polygon)
        self._tell()

    def _refusal(self) -> str:
        """Why no exploration can be started now; else empty."""
        if not self.is_active:
            return "the node is not active"
        if self.params.exploration.frontiers_only:
            return "parameter exploration.frontiers_only is true"
        return ""

    def _on_start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = self._refusal()
        if not response.message:
            self._begin(None)
        response.success = not response.message
        return response

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self.is_active and self._exploration.is_running
        response.message = "" if response.success else "no exploration is running"
        if response.success:
            self._send(self._exploration.stop())
            self._tell()
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success = self.is_active and self._exploration.is_running
        response.message = "" if response.success else "no exploration is running"
        if response.success:
            self._exploration.pause(request.data)
        return response

    def _accept(self, handle: Any) -> None:
        """Begin what an action asks for."""
        try:
            if self._refusal():
                raise InputError(self._refusal())
            task = requested(handle.request, self.params)
        except InputError as error:
            self.get_logger().warning(f"explore: {error}")
            handle.execute(partial(self._refused, str(error)))
            return
        self._begin(task)
        self._goal = handle

    def _cancel(self, handle: Any) -> None:
        """End as soon as the action's handle knows that it is cancelled."""
        if handle == self._goal and self.executor is not None:
            stop = self.guard.wrapped(self._stop_cancelled)
            self.executor.create_task(stop)

    def _stop_cancelled(self) -> None:
        self._send(self._exploration.stop("the action was cancelled"))
        self._tell()

    def _end_action(self) -> None:
        """Send the result of the action that has ended; there is nobody to send it at the end."""
        handle, self._goal = self._goal, None
        if handle is not None and self.executor is not None:
            handle.execute(self._result)

    def _result(self, handle: Any) -> Explore.Result:
        explored = self._exploration
        result = Explore.Result(has_returned=explored.has_returned)
        self._fill_status(result.status)
        if handle.is_cancel_requested:
            handle.canceled()
        elif explored.end in _ENDINGS:
            handle.succeed()
        else:
            handle.abort()
        return result

    def _refused(self, reason: str, handle: Any) -> Explore.Result:
        result = Explore.Result()
        self._fill_header(result.status.header)
        result.status.state, result.status.end = State.ENDED.value, End.STOPPED.value
        result.status.reason = f"refused: {reason}"
        handle.abort()
        return result

    def _fill_status(self, status: ExplorationStatus) -> None:
        self._fill_header(status.header)
        explored = self._exploration
        status.state, status.end = explored.state.value, explored.end.value
        status.reason = explored.reason
        if explored.survey is not None:
            status.covered_area = explored.survey.covered_area
            status.remaining_area = explored.survey.wanted_area
        status.distance, status.elapsed = explored.distance, explored.elapsed
        if explored.goal is not None:
            status.goal_x, status.goal_y = explored.goal.x, explored.goal.y
            status.goal_gain = explored.gain

    def _publish_status(self) -> None:
        status = ExplorationStatus()
        self._fill_status(status)
        self.publish("~/status", status)
        if self._goal is not None and self._goal.is_active:
            self._goal.publish_feedback(Explore.Feedback(status=status))

    def _show(self) -> None:
        """The status, and for those who look the places, now and then."""
        if self._exploration.is_running:
            self._publish_status()
        elif self.params.exploration.frontiers_only:
            self._exploration.look_over()
        if self.has_subscribers("~/markers"):
            self.publish("~/markers", self._markers())

    def _markers(self) -> MarkerArray:
        """Places by their gain, those that were given up, the goal and the boundary."""
        explored = self._exploration
        choice, goal = explored.choice, explored.goal
        places = self._marker("places", Marker.SPHERE_LIST, palette.FRONTIER, _MARK)
        if choice is not None:
            self._fill_places(places, choice)
        given_up = self._marker("given up", Marker.CUBE_LIST, palette.OCCUPIED, 0.2)
        given_up.points = [Point(x=p.x, y=p.y, z=_LIFT) for p in explored.given_up]
        star = self._marker("goal", Marker.SPHERE_LIST, palette.FREE, 0.3)
        star.points = [] if goal is None else [Point(x=goal.x, y=goal.y, z=_LIFT)]
        line = self._marker("boundary", Marker.LINE_STRIP, palette.ODOMETRY, 0.05)
        corners = explored.corners.tolist()
        line.points = [Point(x=x, y=y, z=_LIFT) for x, y in [*corners, *corners[:1]]]
        markers = [places, given_up, star, line]
        for marker in markers:
            marker.action = Marker.ADD if marker.points else Marker.DELETE
        return MarkerArray(markers=markers)

    def _fill_places(self, marker: Marker, choice: Choice) -> None:
        """The more a place shows, the more opaque it is."""
        worth = choice.gains >= self._exploration.min_gain
        largest = float(choice.gains.max(initial=1e-9))
        colour = marker.color
        marker.points = [Point(x=x, y=y, z=_LIFT) for x, y in choice.places[worth].tolist()]
        marker.colors = [
            ColorRGBA(r=colour.r, g=colour.g, b=colour.b, a=0.2 + 0.8 * gain / largest)
            for gain in choice.gains[worth].tolist()
        ]

    def _marker(self, name: str, kind: int, colour: str, size: float) -> Marker:
        marker = Marker(ns=name, type=kind)
        self._fill_header(marker.header)
        marker.pose.orientation.w = 1.0
        marker.scale.x = marker.scale.y = marker.scale.z = size
        red, green, blue = (part / 255.0 for part in palette.rgb(colour))
        marker.color = ColorRGBA(r=red, g=green, b=blue, a=1.0)
        return marker


def main() -> int:
    """Run the node."""
    return runtime.run(ExplorationNode)


if __name__ == "__main__":
    sys.exit(main())
