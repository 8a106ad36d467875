# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the commands share: how they are declared, their parameters, the figures of a map."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params import files
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.terrain.traversability import OCCUPIED, ObstacleMap

Figures = dict[str, Any]
"""What a command found, by name: printed as lines, or as JSON."""


class NegativeResultError(Exception):
    """A command did its work, and the answer is no.

    Attributes
    ----------
    figures : Figures
        What it found: printed as otherwise.
    exit_status : int
        Of the process.
    """

    def __init__(self, figures: Figures, exit_status: int) -> None:
        super().__init__()
        self.figures = figures
        self.exit_status = exit_status


def add_command(
    commands: Any, name: str, function: Callable[[argparse.Namespace], Figures], help_text: str
) -> argparse.ArgumentParser:
    """Add a command to a parser's sub-parsers, with the options that all commands have.

    Parameters
    ----------
    commands : what `argparse.ArgumentParser.add_subparsers` returns
    name : str
    function : callable
        Runs the command; its docstring is the command's description.
    help_text : str
        One line for the list of commands.
    """
    command: argparse.ArgumentParser = commands.add_parser(
        name, help=help_text, description=function.__doc__
    )
    command.set_defaults(command=function)
    command.add_argument("--params", type=Path, metavar="FILE",
                         help="ROS parameter file; see config/heightmap25d.yaml")  # fmt: skip
    command.add_argument("--json", action="store_true", help="print the figures as JSON")
    return command


def add_topics(command: argparse.ArgumentParser) -> None:
    """Add the options that name the topics of a bag."""
    command.add_argument("--odom-topic", metavar="T",
                         help="3-D poses: Odometry, PoseStamped, PoseWithCovarianceStamped, or /tf "
                         "(default: of intake.pose_source, /odom or the only one)")  # fmt: skip
    command.add_argument("--scan-topic", metavar="T", action="append", default=[],
                         help="a laser, repeatable (default: every LaserScan topic)")  # fmt: skip


def read_params(options: argparse.Namespace, node: str = "mapping") -> Params:
    """The parameters of a node in ``--params``, or the defaults.

    Raises
    ------
    InputError
        If the file cannot be read or holds an unknown or unusable parameter.
    """
    return files.read_yaml(options.params, node) if options.params else Params()


def cell_counts(height_map: HeightMap, obstacle_map: ObstacleMap) -> Figures:
    """How many cells of a map are known, and how many occupied."""
    return {
        "known cells": int(height_map.known.sum()),
        "occupied cells": int((obstacle_map.occupancy == OCCUPIED).sum()),
    }
