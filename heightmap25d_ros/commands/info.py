# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d info``: what is in a bag or a map directory."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

from heightmap25d_ros.commands.common import Figures, add_command, cell_counts, read_params
from heightmap25d_ros.io import map_directory, merge_file, slam_file
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.terrain.traversability import to_obstacle_map


def add_to(commands: Any) -> None:
    """Add ``info``."""
    command = add_command(commands, "info", _info)
    command.add_argument("path", type=Path, metavar="BAG|DIR")


def _info(options: argparse.Namespace) -> Figures:
    """Tell what is in a bag or a map directory."""
    settings = read_params(options)
    if (options.path / map_directory.HEIGHT_GRID).exists():
        loaded = map_directory.load(options.path, settings.mapper.probability_threshold)
        geometry, heights = loaded.height_map.geometry, loaded.height_map
        known = heights.metres[heights.known]
        return {
            "frame": loaded.frame_id,
            **_poses(options.path),
            **({"ground": "unknown: made by level lasers"} if heights.is_level else {}),
            "size_cells": list(geometry.shape[::-1]),
            "resolution_m": geometry.resolution,
            "origin_m": list(geometry.origin),
            "ground_zero_m": geometry.ground_zero,
            "upper_surfaces": len(heights.upper),
            "heights_m": [round(known.min(), 2), round(known.max(), 2)] if known.size else [],
            **cell_counts(heights, to_obstacle_map(heights, settings.traversability)),
        }
    with Bag(options.path) as bag:
        return {
            "bag": str(options.path),
            "duration_s": round(bag.duration, 3),
            **{
                f"{name} ({message_type})": count
                for name, topic in bag.topics.items()
                for message_type, count in topic.counts.items()
            },
            **({"warnings": bag.warnings} if bag.warnings else {}),
        }


def _poses(directory: Path) -> Figures:
    """Whether a map was made with known poses, or how well they were found, and of what maps."""
    merged = merge_file.load(directory)
    if merged is not None:
        maps = [dict(source) for source in merged["maps"]]
        return {"poses": merged["poses"], "merged": {m.pop("map"): m for m in maps}}
    report = slam_file.load(directory)
    if report is None:
        return {"poses": "known"}
    names = ("poses", "distance_m", "unobserved_m", "disagreed_m")
    outcomes = Counter(str(loop["outcome"]) for loop in report["loops"])
    drives = [dict(drive) for drive in report.get("drives", [])]
    return {
        **{name: report[name] for name in names},
        "loops": dict(outcomes),
        **({"drives": {str(drive.pop("bag", "")): drive for drive in drives}} if drives else {}),
    }
