# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node as a process, which ends cleanly; and the qualities of service of the nodes."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.nodes.lifecycle import ManagedNode

_LONGEST_WAIT = 0.1  # [s] until a signal is seen where no message comes


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
    interruption = _Interruption()
    try:
        # Signals are ours: rclpy's handlers would end ROS while a callback is using it.
        start_ros(arguments, signal_handler_options=SignalHandlerOptions.NO)
        node = _made(make_node)
        if isinstance(node, ManagedNode):
            node.begin()
        interruption.is_starting = False
        _spin(node, interruption)
    except (InputError, ParameterException, NameValidationException) as error:
        reason = " ".join(str(error).split())
        print(f"error: {reason}", file=sys.stderr)
        return 2
    finally:
        ignore_signals()
        if isinstance(node, ManagedNode):
            node.end()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def ignore_signals() -> None:
    """The process is ending: a second Ctrl-C, as a launcher sends, must not spoil that."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


class _Interruption:
    """Whether Ctrl-C or SIGTERM has come.

    While a node starts, which may take a while and leaves nothing to save, they end the process.
    Not by an exception, which would get lost in a callback of C code, or abort the executor.
    """

    def __init__(self) -> None:
        self.has_come = False
        self.is_starting = True
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._come)

    def _come(self, signal_number: int, frame: FrameType | None) -> None:
        self.has_come = True
        if self.is_starting:
            os._exit(0)


def _spin(node: Node, interruption: _Interruption) -> None:
    # A message costs a third of what it costs in the default executor.
    executor = EventsExecutor()
    executor.add_node(node)
    while not interruption.has_come:
        executor.spin_once(timeout_sec=_LONGEST_WAIT)
