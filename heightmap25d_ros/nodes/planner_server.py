# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What Nav2's planner_server offers, offered by the planning node where nav2_msgs is installed."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from threading import Event
from typing import Any

from builtin_interfaces.msg import Duration
from nav_msgs.msg import Path

from heightmap25d_ros.errors import printable
from heightmap25d_ros.io import encode
from heightmap25d_ros.nodes import qos
from heightmap25d_ros.nodes.interface import Action, Output, Service
from heightmap25d_ros.nodes.lifecycle import ManagedNode
from heightmap25d_ros.pipelines.path_requests import PathRequest
from heightmap25d_ros.pipelines.planning import Planning
from heightmap25d_ros.planning.plan import Plan, Status

try:
    from nav2_msgs.action import ComputePathThroughPoses, ComputePathToPose
    from nav2_msgs.msg import SpeedLimit
    from nav2_msgs.srv import ClearEntireCostmap, IsPathValid
except ImportError:
    ComputePathToPose = None

IS_AVAILABLE = ComputePathToPose is not None
"""Whether nav2_msgs is installed."""

_SPEED_LIMIT = "speed_limit"
_STEP = 5  # percent

_LONGEST_TOLD = 100  # characters of a name that may be anybody's

_CANCELLED = Plan(status=Status.UNKNOWN, reason="cancelled")
_PREEMPTED = Plan(status=Status.UNKNOWN, reason="preempted by a newer goal")
_FAILED = Plan(status=Status.UNKNOWN, reason="the planner failed; its log tells why")


@dataclass(slots=True, eq=False)
class _Goal:
    """A goal of one of the actions that has no result yet."""

    action: Any
    handle: Any
    given_up: Event = field(default_factory=Event)


class PlannerServer:
    """Actions and services of Nav2's planner_server, over the map of `Planning`.

    Paths are planned in a thread of their own, one after another, so that the node still answers
    within the few milliseconds that bt_navigator waits. A goal that is cancelled, or preempted by
    a newer one of the same action, has its result at once.

    Parameters
    ----------
    node : ManagedNode
    planning : Planning
    show : callable
        Publishes a plan with a path, and returns its message.
    """

    def __init__(self, node: ManagedNode, planning: Planning, show: Callable[[Plan], Path]) -> None:
        self._node = node
        self._planning = planning
        self._show = show
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="planner")
        self._goals: dict[Any, _Goal] = {}  # the newest of each action
        self._percent = 100

    def close(self) -> None:
        """Give all goals up."""
        for goal in self._goals.values():
            goal.given_up.set()
        self._goals.clear()
        self._worker.shutdown(wait=True, cancel_futures=True)

    def actions(self) -> list[Action]:
        """Paths to a pose, and through several ones."""
        return [
            Action(kind, name, partial(self._accept, kind), partial(self._cancel, kind))
            for kind, name in (
                (ComputePathToPose, "compute_path_to_pose"),
                (ComputePathThroughPoses, "compute_path_through_poses"),
            )
        ]

    def services(self) -> list[Service]:
        """What behaviour trees of Nav2 ask for besides paths."""
        return [
            Service(IsPathValid, "is_path_valid", self._is_path_valid),
            Service(ClearEntireCostmap, "global_costmap/clear_entirely_global_costmap", _cleared),
        ]

    def outputs(self) -> list[Output]:
        """What controllers of Nav2 want to know of the ground."""
        return [Output(SpeedLimit, _SPEED_LIMIT, qos.LATCHED)]

    def limit_speed(self, plan: Plan) -> None:
        """Publish how fast a robot on the path should be, where that has changed."""
        percent = _STEP * math.floor(100.0 * self._planning.speed_share(plan) / _STEP + 1e-9)
        if percent == self._percent:
            return
        self._percent = percent
        message = SpeedLimit(percentage=True, speed_limit=float(percent) if percent < 100 else 0.0)
        stamp = self._node.get_clock().now().nanoseconds
        encode.fill_header(message.header, stamp, self._node.params.mapping.map_frame)
        self._node.publish(_SPEED_LIMIT, message)

    def _accept(self, action: Any, handle: Any) -> None:
        """Plan to a new goal, in place of the one before."""
        before = self._goals.get(action)
        if before is not None:
            self._end(before, _PREEMPTED)
        goal = self._goals[action] = _Goal(action, handle)
        try:
            request = self._request(handle.request)
        except _RefusedError as refused:
            self._end(goal, Plan(status=Status.UNKNOWN, reason=str(refused)), refused.code)
        except Exception:
            self._end(goal, _FAILED)
            raise
        else:
            if isinstance(request, Plan):
                self._end(goal, request)
            else:
                self._worker.submit(self._work, goal, request)

    def _request(self, wanted: Any) -> PathRequest | Plan:
        """What a goal's message asks for."""
        known = self._node.params.planning.planner_ids
        if wanted.planner_id and wanted.planner_id not in known:
            names = ", ".join(known)
            planner = printable(repr(wanted.planner_id), _LONGEST_TOLD)
            raise _RefusedError("INVALID_PLANNER", f"there is no planner {planner}, but {names}")
        goals = wanted.goals if hasattr(wanted, "goals") else [wanted.goal]
        if not goals:
            raise _RefusedError("NO_VIAPOINTS_GIVEN", "no goals are given")
        return self._planning.request(goals, wanted.start if wanted.use_start else None)

    def _work(self, goal: _Goal, request: PathRequest) -> None:
        """Plan, in the thread of the planner."""
        plan = _FAILED
        with self._node.guard.catching():
            plan = request.plan(goal.given_up.is_set)
        executor = self._node.executor
        if executor is not None and not goal.given_up.is_set():
            executor.create_task(self._node.guard.wrapped(self._end), goal, plan)

    def _cancel(self, action: Any, handle: Any) -> None:
        """End a goal as soon as its handle knows that it is cancelled."""
        goal, executor = self._goals.get(action), self._node.executor
        if goal is not None and goal.handle == handle and executor is not None:
            executor.create_task(self._node.guard.wrapped(self._end), goal, _CANCELLED)

    def _end(self, goal: _Goal, plan: Plan, code: str = "") -> None:
        """Send the result of a goal, unless it has one already."""
        if goal.given_up.is_set():
            return
        goal.given_up.set()
        if self._goals.get(goal.action) is goal:
            del self._goals[goal.action]
        goal.handle.execute(partial(self._result, goal.action, plan, code or plan.status.name))

    def _result(self, action: Any, plan: Plan, code: str, handle: Any) -> Any:
        result = action.Result(error_msg=plan.reason)
        seconds, part = divmod(plan.seconds, 1.0)
        result.planning_time = Duration(sec=int(seconds), nanosec=int(part * 1e9))
        if handle.is_cancel_requested:
            handle.canceled()
        elif plan.found:
            result.path = self._show(plan)
            handle.succeed()
        else:
            result.error_code = getattr(action.Result, code)
            handle.abort()
            self._node.get_logger().warning(f"no path: {plan.reason}")
        return result

    def _is_path_valid(self, request: Any, response: Any) -> Any:
        invalid = self._planning.first_invalid(request.path)
        response.is_valid = invalid is None
        is_named = invalid is not None and len(request.path.poses) > 0
        response.invalid_pose_indices = [invalid] if is_named else []
        return response


def _cleared(_: Any, response: Any) -> Any:
    """There is no costmap besides the map: it holds nothing that could be cleared."""
    return response


class _RefusedError(Exception):
    """A goal cannot be planned to, for a reason that only the action has a code for."""

    def __init__(self, code: str, reason: str) -> None:
        super().__init__(reason)
        self.code = code
