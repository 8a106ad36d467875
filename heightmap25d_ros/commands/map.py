# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d map``: a map directory from a bag."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.commands.common import (
    Figures,
    add_command,
    add_topics,
    cell_counts,
    read_params,
)
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import MapperParams, Params
from heightmap25d_ros.params.spec import specs
from heightmap25d_ros.pipelines.mapping import Mapping, compile_kernels
from heightmap25d_ros.pipelines.replay import pose_topic, replayed, with_scan_topics


def add_to(commands: Any) -> None:
    """Add ``map``."""
    command = add_command(commands, "map", _map, "a map directory from a bag")
    command.add_argument("bag", type=Path, metavar="BAG", help="rosbag2 directory, or a file of it")
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help="map directory to write")  # fmt: skip
    add_topics(command)
    rules = dict((name, spec) for name, spec, _ in specs(MapperParams()))
    command.add_argument("--update-rule", choices=rules["update_rule"].choices,
                         help="in place of mapper.update_rule")  # fmt: skip


def _map(options: argparse.Namespace) -> Figures:
    """Map a bag: scans and 3-D odometry in, a map directory out; the same bag, the same bytes."""
    with Bag(options.bag) as bag:
        settings = _mapping_params(options, bag)
        odom_topic, _ = pose_topic(bag, options.odom_topic, settings.intake)
        compile_kernels(settings)  # not what is timed below
        mapping = Mapping(settings)
        trajectory: list[tuple[int, se3.Matrix]] = []
        scan_ms: list[float] = []
        began = time.perf_counter()
        for step in replayed(bag, mapping, odom_topic, settings.intake):
            count = len(step.outcomes)
            scan_ms += [step.milliseconds / max(count, 1)] * count
            trajectory += [(r.scan.stamp_ns, r.T_map_base[0]) for r in step.outcomes]
        height_map, obstacle_map = mapping.maps()
        seconds = time.perf_counter() - began
        duration = bag.duration
    problems = [str(problem) for problem in mapping.problems()]
    if not scan_ms or not height_map.known.any():
        raise InputError(f"{options.bag}: {_reasons(mapping, problems)}")
    for problem in problems:
        print(f"heightmap25d: warning: {problem} (see docs/troubleshooting.md)", file=sys.stderr)
    frame = settings.mapping.map_frame
    layers = mapping.layers(height_map.geometry)
    map_directory.save(options.output, height_map, obstacle_map, frame, trajectory, layers)
    p50, p95, p99 = np.percentile(scan_ms, [50, 95, 99])
    return {
        "bag": str(options.bag),
        "map": str(options.output),
        "merged": dict(mapping.merged),
        "dropped": dict(mapping.dropped),
        "damaged": dict(bag.damaged),
        "other_types": dict(bag.other_types),
        "warnings": [*bag.warnings, *mapping.dropped.notices, *problems],
        **cell_counts(height_map, obstacle_map),
        "processing_s": round(seconds, 3),
        "real_time_factor": round(duration / seconds, 1),
        "scan_p50_ms": round(p50, 3),
        "scan_p95_ms": round(p95, 3),
        "scan_p99_ms": round(p99, 3),
        "sha256": map_directory.digest(options.output),
    }


def _reasons(mapping: Mapping, problems: list[str]) -> str:
    """Why a map would be empty."""
    merged = mapping.merged["scans"]
    begin = f"the map is empty after {merged} scans" if merged else "no scan could be mapped"
    return "; ".join([begin, *problems, *filter(None, [str(mapping.dropped)])])


def _mapping_params(options: argparse.Namespace, bag: Bag) -> Params:
    """The parameters with the topics of this bag in them."""
    settings = with_scan_topics(read_params(options), bag, options.scan_topic)
    if options.update_rule:
        return with_values(settings, {"mapper.update_rule": options.update_rule})
    return settings
