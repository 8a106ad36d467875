# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all nodes share: a life that begins by itself or at a manager's word, and ends cleanly."""

from __future__ import annotations

import signal
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterable
from types import FrameType
from typing import Any, NoReturn

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.nodes import parameters
from heightmap25d_ros.params import Params

REPORT_PERIOD = 5.0
"""Between two lines about dropped messages [s]."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of maps and plans: reliable, and who comes late gets the last one."""


class ManagedNode(LifecycleNode):
    """A managed node that configures and activates itself, unless ``autostart`` is false.

    A subclass makes its core, its publishers and services in `set_up`, its subscriptions and
    timers in `start`. Whatever these make is destroyed when the node is cleaned up or
    deactivated, so that an inactive node hears nothing.

    Attributes
    ----------
    params : Params
    """

    def __init__(self, name: str) -> None:
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        self.params = parameters.declare_params(self)
        parameters.follow_changes(self, self.params, self._take_params)
        self._is_configured = False
        self._fault = ""
        self._older_than: dict[str, set[Any]] = {}
        # rclpy lets the exception of a transition that is not possible now end the process.
        change_state = self._service_change_state.callback
        self._service_change_state.callback = lambda request, response: _or_refused(
            change_state, request, response
        )

    def set_up(self) -> None:
        """Make what there is while the node is configured: core, publishers, services."""
        raise NotImplementedError

    def start(self) -> None:
        """Make what there is while the node is active: subscriptions, timers."""
        raise NotImplementedError

    def take_params(self) -> None:
        """`params` have changed; the node is configured."""

    def finish(self) -> None:
        """The core is about to be given up: keep what must be kept. The node is configured."""

    def begin(self) -> None:
        """Configure and activate, unless that is left to a manager.

        Raises
        ------
        InputError
            If that is not possible.
        """
        if not self.params.autostart:
            return
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != TransitionCallbackReturn.SUCCESS:
                raise InputError(self._fault)

    def end(self) -> None:
        """Give up the core, whatever state the node is in; what must be kept is kept."""
        if self._is_configured:
            self._is_configured = False
            self.finish()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive afterwards."""
        fault = self._tried(self.set_up)
        self._is_configured = fault is None
        return fault or super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Active afterwards."""
        enabled = super().on_activate(state)
        return self._tried(self.start) or enabled

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive afterwards."""
        self._destroy_newer("start")
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Unconfigured afterwards."""
        self.end()
        self._destroy_newer("set_up")
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Finalized afterwards, from whatever state."""
        self.end()
        self._destroy_newer("set_up")
        return super().on_shutdown(state)

    def _tried(self, step: Callable[[], None]) -> TransitionCallbackReturn | None:
        """Take a step; what it made is destroyed where it fails."""
        self._older_than[step.__name__] = set(self._destroyers())
        try:
            step()
        except (InputError, NameValidationException) as error:
            self._fault = " ".join(str(error).split())
        except Exception:  # rclpy would drop it without a word
            self._fault = traceback.format_exc()
        else:
            return None
        self._destroy_newer(step.__name__)
        self.get_logger().error(f"{step.__name__}: {self._fault}")
        return TransitionCallbackReturn.FAILURE

    def _destroyers(self) -> dict[Any, Callable[[Any], Any]]:
        """All that belongs to the node, and what destroys it."""
        kinds: list[tuple[Iterable[Any], Callable[[Any], Any]]] = [
            (self.timers, self.destroy_timer),
            (self.subscriptions, self.destroy_subscription),
            (self.services, self.destroy_service),
            (self.publishers, self.destroy_lifecycle_publisher),
        ]
        return {entity: destroy for entities, destroy in kinds for entity in entities}

    def _destroy_newer(self, step: str) -> None:
        """Destroy what was made in a step and after it."""
        older = self._older_than.pop(step, None)
        if older is None:
            return
        for entity, destroy in self._destroyers().items():
            if entity not in older:
                destroy(entity)

    def _take_params(self, params: Params) -> None:
        self.params = params
        if self._is_configured:
            self.take_params()


def _or_refused(change_state: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
    try:
        return change_state(request, response)
    except RuntimeError:
        response.success = False
        return response


def report_drops(node: Node, dropped: Counter[str], reported: int) -> int:
    """Warn of messages that were dropped since the last time; how many there are now.

    Parameters
    ----------
    node : Node
    dropped : Counter of str
        How many, by reason.
    reported : int
        What the last call returned; at first 0.
    """
    if dropped.total() > reported:
        reasons = ", ".join(f"{reason} ({count})" for reason, count in dropped.most_common())
        node.get_logger().warning(f"dropped so far: {reasons}")
    return dropped.total()


def _made(make_node: Callable[[], Node]) -> Node:
    try:
        return make_node()
    except ValueError as error:
        if "PARAMETER_NOT_SET" not in str(error):
            raise
        raise InputError("a parameter is an empty list; ROS wants it left out") from None


def start_ros(arguments: list[str] | None, **options: Any) -> None:
    """``rclpy.init``; bad ROS arguments are bad input.

    Raises
    ------
    InputError
        If a remapping or a parameter of the arguments cannot be read.
    """
    try:
        rclpy.init(args=arguments, **options)
    except RuntimeError as error:
        raise InputError(f"ROS arguments: {' '.join(str(error).split())}") from None


def run(make_node: Callable[[], Node], arguments: list[str] | None = None) -> int:
    """Spin a node until Ctrl-C or SIGTERM; the exit status of the process.

    Parameters
    ----------
    make_node : callable
        Makes the node; ``InputError`` ends the process with status 2 and one line.
    arguments : list of str, optional
        Of the command line; by default the process's own.
    """
    node = None
    _on_signals(_stop)
    try:
        start_ros(arguments)
        node = _made(make_node)
        _spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (InputError, ParameterException, NameValidationException) as error:
        reason = " ".join(str(error).split())
        print(f"error: {reason}", file=sys.stderr)
        return 2
    except Exception:
        if rclpy.ok():  # else a signal ended ROS while a callback was using it
            raise
    finally:
        _on_signals(_ignore)
        if isinstance(node, ManagedNode):
            node.end()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _spin(node: Node) -> None:
    # A message costs a third of what it costs in the default executor. Its spin() does not
    # end on a signal; spin_once() does.
    executor = EventsExecutor()
    executor.add_node(node)
    if isinstance(node, ManagedNode):
        node.begin()
    while rclpy.ok():
        executor.spin_once(timeout_sec=0.5)


def _on_signals(handler: Callable[[int, FrameType | None], None]) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handler)


def _stop(signal_number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def _ignore(signal_number: int, frame: FrameType | None) -> None:
    """A second Ctrl-C must not interrupt the saving of a map."""
