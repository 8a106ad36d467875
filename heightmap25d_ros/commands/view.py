# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d view``: a map directory, or a bag as it becomes a map, in 3-D."""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from heightmap25d_ros.commands.common import (
    Figures,
    add_command,
    add_topics,
    read_bag_params,
    read_params,
)
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import map_directory, trajectory
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import pose_topic, replayed

if TYPE_CHECKING:
    from heightmap25d_ros.viz.rerun_scene import Scene3d

_MAP_EVERY, _POSE_EVERY = 2.0, 0.1  # [s] of the bag
_PORT = 9090


def add_to(commands: Any) -> None:
    """Add ``view``."""
    command = add_command(commands, "view", _view)
    command.add_argument("path", type=Path, metavar="DIR|BAG", help="map directory, or rosbag2")
    add_topics(command)
    where = command.add_mutually_exclusive_group()
    where.add_argument("--save", type=Path, metavar="FILE.rrd",
                       help="write a recording for `rerun FILE.rrd`")  # fmt: skip
    where.add_argument("--web", type=int, nargs="?", const=_PORT, metavar="PORT",
                       help=f"serve it to browsers until Ctrl-C (default: {_PORT})")  # fmt: skip


def _view(options: argparse.Namespace) -> Figures:
    """Show a map directory in 3-D, or a bag: map, robot and trajectory over the bag's time.

    Opens a window where neither --save nor --web is given.
    """
    if not options.path.exists():
        raise InputError(f"{options.path}: does not exist")
    from heightmap25d_ros.viz.rerun_scene import Scene3d  # noqa: PLC0415 - needs rerun

    settings = read_params(options)
    is_map = (options.path / map_directory.HEIGHT_GRID).exists()
    if options.save and not options.save.parent.is_dir():
        raise InputError(f"{options.save.parent}: is not a directory")
    if not (options.save or options.web or _has_display()):
        raise InputError("view: there is no display here; give --save FILE.rrd or --web")
    scene = Scene3d(options.path.name, settings.traversability, settings.planner, options.save)
    figures = _show_map(scene, options.path, settings) if is_map else _show_bag(scene, options)
    if options.save is None and options.web is None:
        scene.open_window()
    if options.web is not None:
        print(f"heightmap25d: {scene.serve(options.web)} until Ctrl-C", flush=True)
    scene.finish()
    while options.web is not None:
        time.sleep(1.0)
    return {**figures, **({"recording": str(options.save)} if options.save else {})}


def _has_display() -> bool:
    return sys.platform != "linux" or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def _show_map(scene: Scene3d, path: Path, settings: Params) -> Figures:
    height_map = map_directory.load(path, settings.mapper.probability_threshold).height_map
    scene.show_map(height_map)
    if (path / map_directory.TRAJECTORY).exists():
        scene.show_trajectory(trajectory.read_tum(path / map_directory.TRAJECTORY)[:, 1:4])
    return {"map": str(path), "known_cells": int(height_map.known.sum())}


def _show_bag(scene: Scene3d, options: argparse.Namespace) -> Figures:
    path: Path = options.path
    with Bag(path) as bag:
        settings = read_bag_params(options, [bag])
        odom_topic, _ = pose_topic(bag, options.odom_topic, settings.intake)
        mapping = Mapping(settings)
        way: list[Any] = []
        shown = {"map": -np.inf, "pose": -np.inf}
        for step in replayed(bag, mapping, odom_topic, settings.intake):
            if not step.outcomes:
                continue
            reading = step.outcomes[-1]
            T, seconds = reading.T_map_base[0], (reading.scan.stamp_ns - bag.start_ns) * 1e-9
            scene.at(seconds)
            if seconds - shown["pose"] >= _POSE_EVERY:
                shown["pose"] = seconds
                way.append(T[:3, 3])
                scene.show_robot(T)
                scene.show_trajectory(np.array(way))
            if seconds - shown["map"] >= _MAP_EVERY:
                shown["map"] = seconds
                scene.show_map(mapping.maps()[0])
    if not way:
        raise InputError(f"{path}: no scan could be mapped")
    height_map = mapping.maps()[0]
    scene.show_map(height_map)
    return {"bag": str(path), "known_cells": int(height_map.known.sum())}
