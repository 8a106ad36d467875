# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d bringup``: the nodes as processes, where there is no ``ros2 launch``."""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from heightmap25d_ros.commands.common import Figures, NegativeResultError, add_command, read_params

NODES = ("mapping", "planning", "localization", "markers", "simulator")
EXIT_NODE_DIED = 1

# A node that was not up yet when it was told to end is ended by the signal itself.
_GOOD_ENDINGS = (0, -signal.SIGINT)
_PATIENCE = 5.0  # [s] for the nodes to end; saving a large map takes a while


def add_to(commands: Any) -> None:
    """Add ``bringup``."""
    command = add_command(commands, "bringup", _bringup, "the nodes, until Ctrl-C")
    command.add_argument("--nodes", nargs="+", choices=NODES, metavar="NODE",
                         help=f"of {', '.join(NODES)} (default: mapping planning, and "
                         "localization where there is a map)")  # fmt: skip
    command.add_argument("--map", type=Path, metavar="DIR", help="map directory to begin with")
    command.add_argument("--namespace", default="", metavar="NS",
                         help="of nodes and topics, /tf and /tf_static as well")  # fmt: skip
    command.add_argument("--use-sim-time", action="store_true", help="time comes from /clock")


def _bringup(options: argparse.Namespace) -> Figures:
    """Start the nodes, print their state whenever it changes, and end them on Ctrl-C.

    The same as launch/bringup.launch.py. When a node ends by itself, so do the others.
    """
    names = options.nodes or NODES[: 3 if options.map else 2]
    for name in names:
        read_params(options, name)  # a wrong file is told once, and here
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)
    processes: dict[str, subprocess.Popen[bytes]] = {}
    died: list[str] = []
    try:
        for name in dict.fromkeys([*names, "status_printer"]):
            processes[name] = _started(name, options)
        while not died:
            time.sleep(0.1)
            died = [name for name, process in processes.items() if process.poll() is not None]
    except KeyboardInterrupt:
        pass
    finally:
        _end(processes)
    figures = {name: _ending(process.returncode) for name, process in processes.items()}
    if any(process.returncode not in _GOOD_ENDINGS for process in processes.values()):
        raise NegativeResultError(figures, EXIT_NODE_DIED)
    return figures


def _stop(signal_number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def _started(name: str, options: argparse.Namespace) -> subprocess.Popen[bytes]:
    """A node's process, in a session of its own: Ctrl-C in a terminal comes here only."""
    values = {"use_sim_time": options.use_sim_time}
    if options.map and name == "mapping":
        path = options.map.resolve()
        values |= {"mapping.map_directory": str(path.parent), "mapping.initial_map": path.name}
    if options.map and name == "localization":
        values["localization.map_directory"] = str(options.map.resolve())
    arguments = ["-r", f"__ns:=/{options.namespace.strip('/')}"]
    for topic in ("tf", "tf_static"):
        arguments += ["-r", f"/{topic}:={topic}"]
    if name != "status_printer":
        arguments += ["--params-file", str(options.params)] if options.params else []
        for parameter, value in values.items():
            arguments += ["-p", f"{parameter}:={json.dumps(value)}"]
    command = [sys.executable, "-m", f"heightmap25d_ros.nodes.{name}", "--ros-args", *arguments]
    return subprocess.Popen(command, start_new_session=True)


def _ending(status: int) -> str:
    return "stopped while it started" if status == -signal.SIGINT else f"ended with {status}"


def _end(processes: dict[str, subprocess.Popen[bytes]]) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # the nodes are ending already
    for process in processes.values():
        process.send_signal(signal.SIGINT)
    deadline = time.monotonic() + _PATIENCE
    for process in processes.values():
        try:
            process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
