# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d slam``: a map of a bag whose poses drift."""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from heightmap25d_ros.commands.common import (
    Figures,
    add_command,
    add_topics,
    cell_counts,
    check_output,
    figures_of,
    nothing_of,
    read_bag_params,
    warn,
)
from heightmap25d_ros.commands.stretch import add_stretch, stretch
from heightmap25d_ros.io import atomic_directory, map_directory, slam_file
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.pipelines.mapping import compile_kernels
from heightmap25d_ros.pipelines.replay import pose_topic
from heightmap25d_ros.pipelines.slam import SlamResult, slam_bag


def add_to(commands: Any) -> None:
    """Add ``slam``."""
    command = add_command(commands, "slam", _slam)
    command.add_argument("bag", type=Path, metavar="BAG", help="rosbag2 directory, or a file of it")
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help="map directory to write")  # fmt: skip
    add_stretch(command)
    add_topics(command)


def _slam(options: argparse.Namespace) -> Figures:
    """Map a bag without known poses: scans and odometry in, a map directory out.

    Each scan is localized on the map made so far. The same bag gives the same bytes. Besides what
    `map` writes: trajectory.tum (base in map), covariance.csv, and slam.json with the loops that
    were closed or refused.
    """
    check_output(options.output)
    with Bag(options.bag) as bag:
        settings = read_bag_params(options, [bag])
        topic, _ = pose_topic(bag, options.odom_topic, settings.intake)
        start_ns, stop_ns = stretch(bag, options)
        compile_kernels(settings)  # not what is timed below
        began = time.perf_counter()
        result = slam_bag(bag, settings, topic, (start_ns, stop_ns))
        height_map, obstacle_map = result.mapping.maps()
        seconds = time.perf_counter() - began
    if not height_map.known.any():
        raise nothing_of(bag, result.slam, "no scan could be mapped")
    warnings = warn(result.slam)
    report = _report(result)
    map_directory.save(
        options.output, height_map, obstacle_map, settings.mapping.map_frame, result.trajectory,
        result.mapping.layers(height_map.geometry),
    )  # fmt: skip
    with atomic_directory.adding(options.output) as new:
        slam_file.write(options.output, report, into=new)
        stamps = [stamp for stamp, _ in result.trajectory]
        slam_file.write_covariances(
            new / slam_file.COVARIANCE, stamps, result.slam.tracker.covariances()
        )
    return {
        **figures_of([bag]),
        "map": str(options.output),
        "scans": len(result.trajectory),
        "dropped": dict(result.slam.dropped),
        "warnings": [*bag.warnings, *warnings],
        **cell_counts(height_map, obstacle_map),
        **{name: report[name] for name in ("distance_m", "unobserved_m", "disagreed_m")},
        "loops": dict(Counter(attempt.outcome for attempt in result.slam.tracker.attempts)),
        "processing_s": round(seconds, 3),
        "real_time_factor": round((stop_ns - start_ns) * 1e-9 / seconds, 1),
        "sha256": map_directory.digest(options.output),
    }


def _report(result: SlamResult) -> dict[str, Any]:
    """What slam.json tells."""
    tracker = result.slam.tracker
    return {
        "poses": "estimated",
        "distance_m": round(tracker.distance, 3),
        "unobserved_m": round(tracker.unobserved, 3),
        "disagreed_m": round(result.disagreed, 3),
        "submaps_m": np.round(tracker.graph.poses[:, :2], 3).tolist(),
        "loops": [asdict(attempt) for attempt in tracker.attempts],
    }
