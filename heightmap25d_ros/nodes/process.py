# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all nodes share: parameters declared from `Params`, and a life that ends cleanly."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from typing import Any

import rclpy
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.params import Params, Spec, Value, flatten, with_values

REPORT_PERIOD = 5.0
"""Between two lines about dropped messages [s]."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of maps and plans: reliable, and who comes late gets the last one."""

# Parameters that rclpy brings along in every node.
_RCLPY_PARAMETERS = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def declare_params(node: Node) -> Params:
    """The parameters of a node, declared with descriptors; a wrong one is an error.

    The node must have been made with ``automatically_declare_parameters_from_overrides``: only
    so can a name that nobody knows be found and refused.

    Raises
    ------
    InputError
        For an unknown name (the nearest right one is suggested), a wrong type or value.
    """
    given = {
        name: parameter.value
        for name, parameter in node.get_parameters_by_prefix("").items()
        if not name.startswith(_RCLPY_PARAMETERS)
    }
    params = with_values(Params(), given)
    for name, (spec, value) in flatten(params).items():
        if name in given:
            node.undeclare_parameter(name)
        # ROS has no empty lists: such a parameter is declared by its type and not set.
        stored = Parameter.Type.DOUBLE_ARRAY if value == () else value
        node.declare_parameter(name, stored, _descriptor(spec, value))
    return params


def _descriptor(spec: Spec, value: Value) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=spec.meaning + (f" [{spec.unit}]" if spec.unit else ""),
        additional_constraints=spec.range_text,
        read_only=True,
    )
    if isinstance(value, float):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=spec.low, to_value=spec.high)
        ]
    return descriptor


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
    try:
        start_ros(arguments)
        node = _made(make_node)
        # A message costs a third of what it costs in the default executor. Its spin() does not
        # end on a signal; spin_once() does.
        executor = EventsExecutor()
        executor.add_node(node)
        while rclpy.ok():
            executor.spin_once(timeout_sec=0.5)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (InputError, ParameterException, NameValidationException) as error:
        reason = " ".join(str(error).split())
        print(f"error: {reason}", file=sys.stderr)
        return 2
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0
