# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node as a process, which ends cleanly; and the qualities of service of the nodes."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any, NoReturn

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.nodes.managed import ManagedNode

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of maps and plans: reliable, and who comes late gets the last one."""


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
