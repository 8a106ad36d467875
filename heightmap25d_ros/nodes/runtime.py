# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node as a process, which ends cleanly; and the qualities of service of the nodes."""

from __future__ import annotations

import gc
import os
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import Any

import rclpy
from rclpy.exceptions import InvalidHandle, NameValidationException, ParameterException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.nodes import parameters
from heightmap25d_ros.nodes.guard import GuardedCallbacks
from heightmap25d_ros.nodes.lifecycle import ManagedNode
from heightmap25d_ros.params.sections import Params

_LONGEST_WAIT = 0.1  # [s] until a signal is seen where no message comes


def _made(node_class: Any) -> Any:
    try:
        return node_class()
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


def _help(node_class: Any) -> str:
    """What ``--help`` prints: what the node does, how it is started, and its parameters."""
    name, used = node_class.NAME, node_class.PARAMETERS
    summary = (sys.modules[node_class.__module__].__doc__ or "").strip().partition("\n")[0]
    lines = [
        summary,
        "",
        f"usage: ros2 run heightmap25d_ros {name} --ros-args [--params-file FILE] [-p NAME:=VALUE]",
        "         [-r TOPIC:=OTHER] [-r __ns:=/NAMESPACE]",
        "",
        f"example: ros2 run heightmap25d_ros {name} --ros-args -r odom:=/my/odom",
        "",
        "parameters (docs/interface.md has topics and services as well):",
    ]
    for parameter, (spec, value) in parameters.used_by(Params(), used).items():
        facts = ", ".join(filter(None, [spec.unit, spec.range_text]))
        shown = list(value) if isinstance(value, tuple) else value
        lines.append(f"  {parameter} = {shown}{f' [{facts}]' if facts else ''}: {spec.meaning}")
    return "\n".join(lines)


def run(node_class: Any, arguments: list[str] | None = None) -> int:
    """Spin a node until Ctrl-C or SIGTERM; the exit status of the process.

    Parameters
    ----------
    node_class : a class of nodes, with its NAME and the PARAMETERS that it uses
        Made without arguments; ``InputError`` ends the process with status 2 and one line.
    arguments : list of str, optional
        Of the command line; by default the process's own.
    """
    own_arguments = sys.argv[1:] if arguments is None else arguments
    if "--help" in own_arguments or "-h" in own_arguments:
        with suppress(BrokenPipeError):  # `| head`
            print(_help(node_class), flush=True)
        return 0
    node = None
    interruption = _Interruption()
    try:
        # Signals are ours: rclpy's handlers would end ROS while a callback is using it.
        start_ros(arguments, signal_handler_options=SignalHandlerOptions.NO)
        node = _made(node_class)
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
    return node.exit_status if isinstance(node, ManagedNode) else 0


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


def _spin(node: GuardedCallbacks, interruption: _Interruption) -> None:
    # Modules and kernels stay: without looking at them again, garbage is collected in no time.
    gc.freeze()
    # A message costs a third of what it costs in the default executor.
    executor = EventsExecutor()
    executor.add_node(node)
    while not interruption.has_come:
        # An answer that cannot be sent fails outside of its callback. What waits for a subscription
        # or a timer that was destroyed meanwhile is for nobody any more.
        with node.guard.catching(), suppress(InvalidHandle):
            executor.spin_once(timeout_sec=_LONGEST_WAIT)
