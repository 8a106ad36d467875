# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Managed nodes: their life begins by itself or at a manager's word, and can begin again."""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.nodes import parameters
from heightmap25d_ros.nodes.diagnostics import Diagnostics
from heightmap25d_ros.params.sections import Params

REPORT_PERIOD = 5.0
"""Between two lines about dropped messages [s]."""


class ManagedNode(LifecycleNode):
    """A managed node that configures and activates itself, unless ``autostart`` is false.

    A subclass makes its core, its publishers and services in `set_up`, its subscriptions and
    timers in `start`. Whatever these make is destroyed when the node is cleaned up or
    deactivated, so that an inactive node hears nothing.

    Attributes
    ----------
    params : Params
    is_configured : bool
        Whether there is what `set_up` makes.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        self.params = parameters.declare_params(self)
        parameters.follow_changes(self, self.params, self._take_params)
        self._fault = ""
        self._reported = 0
        self.is_configured = False
        self._diagnostics = Diagnostics(self)
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

    @property
    def dropped(self) -> Counter[str]:
        """How many messages were not used, by reason. The node is configured."""
        raise NotImplementedError

    def figures(self) -> dict[str, Any]:
        """What /diagnostics shall tell besides rates and drops. The node is configured."""
        raise NotImplementedError

    def trouble(self) -> str:
        """What stops the node from doing its work, or nothing. The node is configured."""
        return ""

    def take_params(self) -> None:
        """`params` have changed; the node is configured."""

    def finish(self) -> None:
        """The core is about to be given up: keep what must be kept. The node is configured."""

    def subscribe(
        self,
        kind: Any,
        topic: str,
        callback: Callable[[Any], Any],
        profile: QoSProfile | int,
        *,
        is_needed: bool = False,
    ) -> None:
        """Subscribe in `start`; the self-check complains where a needed topic is silent."""
        self._diagnostics.subscribe(kind, topic, callback, profile, is_needed=is_needed)

    @property
    def state_label(self) -> str:
        """Of the lifecycle: unconfigured, inactive, active or finalized."""
        return str(self._state_machine.current_state[1])

    @property
    def is_active(self) -> bool:
        """Whether there is what `start` makes."""
        return self.state_label == "active"

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
        if self.is_configured:
            self.is_configured = False
            self.finish()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive afterwards."""
        fault = self._tried(self.set_up)
        self.is_configured = fault is None
        self._reported = 0
        return fault or super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Active afterwards."""
        super().on_activate(state)
        fault = self._tried(self._start)
        if fault is not None:
            super().on_deactivate(state)
        return fault or TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive afterwards."""
        self._stop()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Unconfigured afterwards."""
        self.end()
        self._destroy_newer("set_up")
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Finalized afterwards, from whatever state."""
        self._stop()
        self.end()
        self._destroy_newer("set_up")
        return super().on_shutdown(state)

    def _start(self) -> None:
        self.start()
        self._diagnostics.activate()
        wall_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(REPORT_PERIOD, self._report_drops, clock=wall_clock)

    def _stop(self) -> None:
        self._destroy_newer("_start")
        self._diagnostics.deactivate()

    def _report_drops(self) -> None:
        """Warn of messages that were dropped since the last time."""
        dropped = self.dropped
        if dropped.total() > self._reported:
            reasons = ", ".join(f"{reason} ({count})" for reason, count in dropped.most_common())
            self.get_logger().warning(f"dropped so far: {reasons}")
        self._reported = dropped.total()

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
        self.get_logger().error(self._fault)
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
        if self.is_configured:
            self.take_params()


def _or_refused(change_state: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
    try:
        return change_state(request, response)
    except RuntimeError:
        response.success = False
        return response
