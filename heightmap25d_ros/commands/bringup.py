# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d bringup``: the nodes as processes, where there is no ``ros2 launch``."""

from __future__ import annotations

import argparse
import importlib
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import yaml

from heightmap25d_ros.commands.common import Figures, add_command, read_params
from heightmap25d_ros.errors import NegativeResultError

PACKAGE = "heightmap25d_ros"
NODES = (
    "mapping", "planning", "localization", "exploration", "path_follower", "markers", "simulator",
)  # fmt: skip
EXIT_NODE_DIED = 1

ARGUMENTS = {
    "params_file": "ROS parameter file of all nodes (default: config/atrvjr.yaml)",
    "map": "map directory to begin with, and to localize in (default: none)",
    "namespace": "of nodes and topics, /tf and /tf_static as well",
    "use_sim_time": "time comes from /clock",
    "nodes": f"of {', '.join(NODES)} (default: mapping planning, and localization where there is a "
    "map)",
}
"""What can be asked of a bringup, and what it means: of the command and of the launch file."""

EXPLORATION_ARGUMENTS = {
    "use_sim": ("true", "whether the robot is simulated, with known poses"),
    "world": ("ramp", "where the simulated robot is"),
    "seed": ("1", "of the world's details and of the noise"),
    "rate": ("1.0", "times real time, of the simulator"),
    "start": ("true", "whether to explore at once; false: by action or ~/start"),
    "boundary": (
        "",
        "corners that the robot does not leave, as x,y,x,y,x,y (default: of the simulated world; "
        "else exploration.boundary)",
    ),
    "follow": ("true", "whether path_follower drives; false: a controller of yours"),
}
"""What can be asked of launch/exploration.launch.py: default and meaning."""

REMAPPINGS = (("/tf", "tf"), ("/tf_static", "tf_static"))
"""In a namespace transforms are the namespace's own, so that several robots do not mix."""

# A node whose interpreter has just begun is ended by the signal itself: without a traceback, which
# SIGINT would leave then.
_GOOD_ENDINGS = (0, -signal.SIGTERM)
_PATIENCE = 5.0  # [s] for the nodes to end; saving a large map takes a while


def default_params_file() -> Path:
    """``config/atrvjr.yaml``, in the repository or where the package is installed."""
    of_repository = Path(__file__).resolve().parents[2] / "config" / "atrvjr.yaml"
    if of_repository.exists():
        return of_repository
    share = importlib.import_module("ament_index_python").get_package_share_path(PACKAGE)
    return Path(share) / "config" / "atrvjr.yaml"


def default_nodes(map_directory: str) -> tuple[str, ...]:
    """The nodes that are started where none are named."""
    return NODES[:3] if map_directory else NODES[:2]


def map_parameters(node: str, map_directory: str) -> dict[str, str]:
    """The parameters by which a node begins with a map; none where there is no map."""
    path = Path(map_directory).resolve()
    if map_directory and node == "mapping":
        return {"mapping.map_directory": str(path.parent), "mapping.initial_map": path.name}
    if map_directory and node == "localization":
        return {"localization.map_directory": str(path)}
    return {}


def existing_file(name: str, text: str) -> str:
    """The file that an argument names: launch would only warn of one that is missing.

    Raises
    ------
    ValueError
        If there is none.
    """
    if not Path(text).is_file():
        raise ValueError(f"{name}:={text}: is not a file")
    return text


def is_true(name: str, text: str) -> bool:
    """What an argument says, as YAML has it: True, yes and on count as well.

    Raises
    ------
    ValueError
        If it says neither.
    """
    value = yaml.safe_load(text)
    if not isinstance(value, bool):
        raise ValueError(f"{name}:={text}: is neither true nor false")
    return value


def exploration_parameters(argument: dict[str, str]) -> dict[str, dict[str, Any]]:
    """The nodes besides mapping and planning that explore, and the parameters of each.

    Parameters
    ----------
    argument : dict of str to str
        Values of `EXPLORATION_ARGUMENTS`.

    Raises
    ------
    ValueError
        If one cannot be used.
    """
    is_simulated = is_true("use_sim", argument["use_sim"])
    common = {"use_sim_time": is_simulated}
    explored: dict[str, Any] = {
        **common,
        "exploration.start_at_once": is_true("start", argument["start"]),
    }
    corners = [float(number) for number in argument["boundary"].split(",") if number]
    if is_simulated and not corners:
        corners = _extent(argument["world"], int(argument["seed"]))
    if corners:
        explored["exploration.boundary"] = corners
    nodes: dict[str, dict[str, Any]] = {"exploration": explored}
    if is_true("follow", argument["follow"]):
        nodes["path_follower"] = common
    if is_simulated:
        nodes["simulator"] = {
            "simulator.world": argument["world"],
            "simulator.seed": int(argument["seed"]),
            "simulator.rate": float(argument["rate"]),
            "simulator.true_odometry": True,
        }
    return nodes


def _extent(world: str, seed: int) -> list[float]:
    """The corners of a simulated world."""
    from heightmap25d_ros.simulation import recording  # noqa: PLC0415 - needs MuJoCo

    (x0, x1), (y0, y1) = recording.world_of(world, seed).area
    return [x0, y0, x1, y0, x1, y1, x0, y1]


def add_to(commands: Any) -> None:
    """Add ``bringup``."""
    command = add_command(commands, "bringup", _bringup)
    command.set_defaults(params=default_params_file())
    command.add_argument("--nodes", nargs="+", choices=NODES, metavar="NODE",
                         help=ARGUMENTS["nodes"])  # fmt: skip
    command.add_argument("--map", default="", metavar="DIR", help=ARGUMENTS["map"])
    command.add_argument("--namespace", default="", metavar="NS", help=ARGUMENTS["namespace"])
    command.add_argument("--use-sim-time", action="store_true", help=ARGUMENTS["use_sim_time"])


def _bringup(options: argparse.Namespace) -> Figures:
    """Start the nodes, print their state whenever it changes, and end them on Ctrl-C.

    As launch/bringup.launch.py, with the same defaults. When a node ends by itself, so do the
    others.
    """
    names = options.nodes or default_nodes(options.map)
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
    values: dict[str, Any] = {"use_sim_time": options.use_sim_time}
    values |= map_parameters(name, options.map)
    arguments = ["-r", f"__ns:=/{options.namespace.strip('/')}"]
    for topic, remapped in REMAPPINGS:
        arguments += ["-r", f"{topic}:={remapped}"]
    if name != "status_printer":
        arguments += ["--params-file", str(options.params)]
        for parameter, value in values.items():
            arguments += ["-p", f"{parameter}:={json.dumps(value)}"]
    command = [sys.executable, "-m", "heightmap25d_ros.executables", name, "--ros-args", *arguments]
    return subprocess.Popen(command, start_new_session=True)


def _ending(status: int) -> str:
    return "stopped while it started" if status == -signal.SIGTERM else f"ended with {status}"


def _end(processes: dict[str, subprocess.Popen[bytes]]) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # the nodes are ending already
    for process in processes.values():
        process.send_signal(signal.SIGTERM)
    deadline = time.monotonic() + _PATIENCE
    for process in processes.values():
        try:
            process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
