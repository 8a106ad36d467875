# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Managed nodes, which configure and activate themselves or wait for a lifecycle manager."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException, ParameterNotDeclaredException
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.publisher import Publisher
from rclpy.timer import Timer

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.nodes import parameters, qos
from heightmap25d_ros.nodes.diagnostics import Diagnostics
from heightmap25d_ros.nodes.guard import GuardedCallbacks
from heightmap25d_ros.nodes.interface import Action, Input, Output, Service
from heightmap25d_ros.params import by_name
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.input_watch import Flatness, InputWatch

REPORT_PERIOD = 5.0
"""Between two log lines about dropped messages [s]."""


RESULT_TIMEOUT = 10
"""How long the result of an action is kept for its client [s]."""


class ManagedNode(GuardedCallbacks, LifecycleNode):
    """A managed node that configures and activates itself, unless ``autostart`` is false.

    A subclass names its topics, services and actions in `inputs`, `outputs`, `offered_services` and
    `offered_actions`, and makes its pipeline in `set_up`. Publishers, services and actions exist
    while the node is configured, subscriptions and timers while it is active.

    A subclass has its NAME, and the PARAMETERS that it uses: sections of `Params`, or single ones.

    Attributes
    ----------
    params : Params
    is_configured : bool
        Whether there is what `set_up` makes.
    publishers_by_topic : dict of str to Publisher
        Those of `outputs`, while the node is configured.
    exit_status : int
        Of the process: 1 where something was not kept that must be.
    """

    NAME = ""
    PARAMETERS: tuple[str, ...] = ()

    def __init__(self) -> None:
        super().__init__(self.NAME, automatically_declare_parameters_from_overrides=True)
        self.params = parameters.declare_params(self, self.PARAMETERS)
        parameters.follow_changes(self, self.params, self.PARAMETERS, self._take_params)
        self._fault = ""
        self._reported = 0
        self.is_configured = False
        self.exit_status = 0
        self.publishers_by_topic: dict[str, Publisher] = {}
        self._diagnostics = Diagnostics(self)
        self._older_than: dict[str, set[Any]] = {}
        change_state = self._service_change_state.callback
        self._service_change_state.callback = lambda request, response: _or_refused(
            change_state, request, response
        )
        for service in self.services:  # those of the life cycle are not made by `create_service`
            service.callback = self.guard.wrapped(service.callback)

    def inputs(self) -> list[Input]:
        """What the node subscribes to."""
        raise NotImplementedError

    def outputs(self) -> list[Output]:
        """What the node publishes."""
        raise NotImplementedError

    def offered_services(self) -> list[Service]:
        """What the node answers."""
        return []

    def offered_actions(self) -> list[Action]:
        """What the node does at length."""
        return []

    def set_up(self) -> None:
        """Make the pipeline, from `params`."""
        raise NotImplementedError

    def start(self) -> None:
        """Make timers, and publish what is known at the start. Subscriptions are made already."""

    @property
    def flatness(self) -> Flatness:
        """Whether all poses since the activation lie exactly in the plane."""
        return self._diagnostics.flatness

    @property
    def dropped(self) -> Drops:
        """How many messages were not used, by reason. The node is configured."""
        raise NotImplementedError

    def figures(self) -> dict[str, Any]:
        """What /diagnostics reports besides rates and drops. The node is configured."""
        raise NotImplementedError

    def trouble(self) -> str:
        """What stops the node from doing its work, or nothing. The node is configured."""
        return ""

    def take_params(self) -> None:
        """`params` have changed; the node is configured."""

    def finish(self) -> bool:
        """The pipeline is about to be given up: save what must be kept; whether that went well."""
        return True

    @property
    def state_label(self) -> str:
        """Of the lifecycle: unconfigured, inactive, active or finalized."""
        return str(self._state_machine.current_state[1])

    @property
    def is_active(self) -> bool:
        """Whether the node subscribes and publishes."""
        return self.state_label == "active"

    def publish(self, topic: str, message: Any) -> None:
        """Publish on one of the `outputs`."""
        self.publishers_by_topic[topic].publish(message)

    def count_listeners(self, topic: str) -> int:
        """How many subscribe to one of the `outputs`."""
        return int(self.publishers_by_topic[topic].get_subscription_count())

    def has_subscribers(self, topic: str) -> bool:
        """Whether anybody subscribes to one of the `outputs`."""
        return self.count_listeners(topic) > 0

    def create_wall_timer(self, period: float, callback: Callable[[], Any]) -> Timer:
        """A timer [s] of the machine's clock, however fast a bag is replayed."""
        return self.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

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
                raise InputError(" ".join(self._fault.split()))

    def end(self) -> None:
        """Give up the pipeline, whatever state the node is in; what must be kept is saved."""
        if self.is_configured:
            self.is_configured = is_kept = False
            with self.guard.catching():
                is_kept = self.finish()
            self.exit_status = self.exit_status if is_kept else 1

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive afterwards."""
        fault = self._tried(self._configure)
        self.is_configured = fault is None
        self._reported = 0
        return fault or super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Active afterwards."""
        super().on_activate(state)
        fault = self._tried(self._activate)
        if fault is not None:
            super().on_deactivate(state)
            return fault
        self.get_logger().info("active")
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Inactive afterwards."""
        self._deactivate()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Unconfigured afterwards."""
        self.end()
        self._destroy_newer("_configure")
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Finalized afterwards, from whatever state."""
        self._deactivate()
        self.end()
        self._destroy_newer("_configure")
        return super().on_shutdown(state)

    def create_subscription(
        self, kind: Any, topic: str, callback: Callable[..., Any], profile: Any, **options: Any
    ) -> Any:
        """As of `rclpy.node.Node`, guarded, and with overrides."""
        with qos.overridable(profile) as (own, overrides):
            options = overrides | options
            return super().create_subscription(kind, topic, callback, own, **options)

    def set_parameters_atomically(self, parameter_list: list[Any]) -> Any:
        """As of `rclpy.node.Node`; for an unknown name the nearest known one is suggested."""
        try:
            return super().set_parameters_atomically(parameter_list)
        except ParameterNotDeclaredException:
            known = list(self.get_parameters_by_prefix(""))
            hints = [by_name.unknown(p.name, known) for p in parameter_list if p.name not in known]
            return SetParametersResult(successful=False, reason="; ".join(hints))

    def _configure(self) -> None:
        self.set_up()
        self.publishers_by_topic = {}
        for output in self.outputs():
            with qos.overridable(output.profile) as (profile, options):
                arguments = output.kind, output.topic, profile
                publisher = self.create_lifecycle_publisher(*arguments, **options)
            self.publishers_by_topic[output.topic] = publisher
        for service in self.offered_services():
            self.create_service(service.kind, service.name, service.callback)
        for action in self.offered_actions():
            self._create_action_server(action)

    def _create_action_server(self, action: Action) -> None:
        def cancel(goal: Any) -> CancelResponse:
            action.cancel(goal)
            return CancelResponse.ACCEPT

        ActionServer(
            self,
            action.kind,
            action.name,
            execute_callback=lambda goal: None,  # goals are executed by `accept`
            goal_callback=lambda _: GoalResponse.ACCEPT if self.is_active else GoalResponse.REJECT,
            handle_accepted_callback=self.guard.wrapped(action.accept),
            cancel_callback=cancel,
            result_timeout=RESULT_TIMEOUT,
        )

    def _activate(self) -> None:
        for entry in self.inputs():
            self._diagnostics.subscribe(entry)
        self.start()
        self._diagnostics.activate()
        self.create_wall_timer(REPORT_PERIOD, self._report_drops)

    def _deactivate(self) -> None:
        self._destroy_newer("_activate")
        self._diagnostics.deactivate()

    def _report_drops(self) -> None:
        """Tell how clouds are read; warn of what was dropped, or used with a reservation."""
        watch: InputWatch | None = getattr(self, "watch", None)
        for line in watch.new_layouts() if watch is not None else ():
            self.get_logger().info(line)
        dropped = self.dropped
        for sentence in dropped.new_notices():
            self.get_logger().warning(sentence)
        if dropped.notable > self._reported:
            self.get_logger().warning(f"dropped so far: {dropped}")
        self._reported = dropped.notable

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
            (filter(_is_action_server, self.waitables), ActionServer.destroy),
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


def _is_action_server(waitable: Any) -> bool:
    return isinstance(waitable, ActionServer)


def _or_refused(change_state: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
    """A requested change of state; rclpy raises where it is not possible now, which is refused."""
    try:
        return change_state(request, response)
    except RuntimeError:
        response.success = False
        return response
