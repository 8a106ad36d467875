# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drives through worlds with two levels, and the maps of them, for the studies of levels."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.mapping.drop_offs import DropOffs
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import replayed
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.simulation.recording import mounted_sensors, simulate

WORLDS = ("overpass", "garage")
SCAN_RATE = 18.75


def recorded(folder: Path, world: str, seed: int) -> Path:
    """A drive through a world, recorded where it is not there yet."""
    bag = folder / f"{world}_{seed}"
    if not bag.exists():
        simulate(world, seed, bag, mounted=mounted_sensors(SCAN_RATE))
    return bag


def scans_of(
    bag_path: Path, params: Params, topics: tuple[str, ...] = ("/scan", "/scan_down")
) -> list[Beams]:
    """The beams of each scan, from true poses."""
    with Bag(bag_path) as bag:
        intake = replace(params.intake, scan_topics=topics)
        settings = replace(params, intake=intake)
        mapping = Mapping(settings)
        return [
            reading.beams(settings)
            for step in replayed(bag, mapping, "/ground_truth", settings.intake)
            for reading in step.outcomes
        ]


def mapped(scans: list[Beams], params: Params) -> tuple[HeightMap, float, HeightGrid]:
    """A map of scans, the seconds of processor time that `Mapper` took, and its grid.

    With suspected drop-offs, as `mapping` makes it.
    """
    grid = HeightGrid(params.grid, levels=params.levels)
    mapper = Mapper(grid, params.sensor, params.mapper)
    drop_offs = DropOffs(grid, params.traversability, params.mapper.probability_threshold)
    seconds = 0.0
    for beams in scans:
        began = time.process_time()
        mapper.integrate(beams)
        seconds += time.process_time() - began
        drop_offs.integrate(beams)
    return grid.read(), seconds, grid


def place(point: Any) -> Pose2D:
    return Pose2D(float(point[0]), float(point[1]), z=float(point[2]))


def print_table(*columns: str) -> None:
    """The head of a table."""
    print(f"| {' | '.join(columns)} |")
    print("|---" * len(columns) + "|")
