# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the commands share: how they are declared, their parameters, the figures of a map."""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from heightmap25d_ros.commands import SUMMARIES
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params import files
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.replay import with_sources
from heightmap25d_ros.terrain.traversability import OCCUPIED, ObstacleMap

Figures = dict[str, Any]
"""What a command found, by name: printed as lines, or as JSON."""


def add_command(
    commands: Any, name: str, function: Callable[[argparse.Namespace], Figures]
) -> argparse.ArgumentParser:
    """Add a command to a parser's sub-parsers, with the options that all commands have.

    Parameters
    ----------
    commands : what `argparse.ArgumentParser.add_subparsers` returns
    name : str
    function : callable
        Runs the command; its docstring is the command's description.
    """
    command: argparse.ArgumentParser = commands.add_parser(
        name, help=SUMMARIES[name], description=function.__doc__
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
                         help="a laser, repeatable (default: intake.scan_topics of --params, or "
                              "every LaserScan topic)")  # fmt: skip
    command.add_argument("--cloud-topic", metavar="T", action="append", default=[],
                         help="a 3-D lidar or depth camera, repeatable (default: "
                              "intake.cloud_topics of --params, or every PointCloud2 topic of a "
                              "bag without LaserScan topics)")  # fmt: skip


def check_output(directory: Path) -> None:
    """Refuse an output directory that cannot be written, before any work is done.

    Raises
    ------
    InputError
        If it is a file, or the nearest existing directory above it is not writable.
    """
    if directory.exists() and not directory.is_dir():
        raise InputError(f"{directory}: is a file, not a directory to write to")
    existing = next(path for path in (directory, *directory.absolute().parents) if path.exists())
    if not (existing.is_dir() and os.access(existing, os.W_OK)):
        raise InputError(f"{directory}: cannot be written, {existing} is not a writable directory")


def require_map(path: Path) -> None:
    """Refuse what is not a map directory, and say what it is.

    Raises
    ------
    InputError
        If there is no height_grid.npz in it.
    """
    if (path / map_directory.HEIGHT_GRID).is_file():
        return
    if not path.exists():
        raise InputError(f"{path}: does not exist")
    is_bag = path.suffix in (".mcap", ".db3", ".bag") or any(
        path.glob(pattern) for pattern in ("metadata.yaml", "*.mcap", "*.db3")
    )
    kind = (
        "a bag" if is_bag else "a file" if path.is_file() else "a directory without height_grid.npz"
    )
    hint = f"; `heightmap25d map {path} -o DIR` makes a map of it" if is_bag else ""
    raise InputError(f"{path}: is {kind}, not a map directory{hint}")


def read_params(options: argparse.Namespace, node: str = "mapping") -> Params:
    """The parameters of a node in ``--params``, or the defaults.

    Raises
    ------
    InputError
        If the file cannot be read or holds an unknown or unusable parameter.
    """
    return files.read_yaml(options.params, node) if options.params else Params()


def read_bag_params(
    options: argparse.Namespace, bags: Sequence[Bag], node: str = "mapping"
) -> Params:
    """The same, with topics of bags in them: of ``--scan-topic``, ``--params`` and so on, or all.

    Raises
    ------
    InputError
        As `read_params`; or if a bag lacks one that is named, or has none at all.
    """
    chosen = options.scan_topic, options.cloud_topic
    if not options.params:
        return with_sources(Params(), bags, *chosen)
    values = files.values_in(options.params, node)
    settings = files.params_of(options.params, values)
    is_named = "intake.scan_topics" in values
    return with_sources(settings, bags, *chosen, is_named=is_named)


def warn(sentences: Sequence[str]) -> None:
    """Say what was wrong with the messages of a drive."""
    for sentence in sentences:
        print(f"heightmap25d: warning: {sentence} (see docs/troubleshooting.md)", file=sys.stderr)


def figures_of(bags: Sequence[Bag]) -> Figures:
    """Which bags were read, and what of them was not."""
    paths = [str(bag.path) for bag in bags]
    return {
        **({"bag": paths[0]} if len(paths) == 1 else {"bags": paths}),
        "damaged": dict(sum((bag.damaged for bag in bags), Counter())),
        "other_types": dict(sum((bag.other_types for bag in bags), Counter())),
    }


def cell_counts(height_map: HeightMap, obstacle_map: ObstacleMap) -> Figures:
    """How many cells of a map are known, and how many occupied."""
    return {
        "known_cells": int(height_map.known.sum()),
        "occupied_cells": int((obstacle_map.occupancy == OCCUPIED).sum()),
    }
