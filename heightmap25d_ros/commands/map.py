# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d map``: a map directory from a bag."""

from __future__ import annotations

import argparse
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
    if not scan_ms:
        reasons = str(mapping.dropped) or "the bag has none"
        raise InputError(f"{options.bag}: no scan could be mapped; {reasons}")
    frame = settings.mapping.map_frame
    map_directory.save(options.output, height_map, obstacle_map, frame, trajectory)
    p50, p95, p99 = np.percentile(scan_ms, [50, 95, 99])
    return {
        "bag": str(options.bag),
        "map": str(options.output),
        "merged": dict(mapping.merged),
        "dropped": dict(mapping.dropped),
        "damaged": dict(bag.damaged),
        "other types": dict(bag.other_types),
        "warnings": [*bag.warnings, *mapping.dropped.notices],
        **cell_counts(height_map, obstacle_map),
        "seconds": round(seconds, 3),
        "x real time": round(duration / seconds, 1),
        "ms per scan p50": round(p50, 3),
        "ms per scan p95": round(p95, 3),
        "ms per scan p99": round(p99, 3),
        "sha256": map_directory.digest(options.output),
    }


def _mapping_params(options: argparse.Namespace, bag: Bag) -> Params:
    """The parameters with the topics of this bag in them."""
    settings = with_scan_topics(read_params(options), bag, options.scan_topic)
    if options.update_rule:
        return with_values(settings, {"mapper.update_rule": options.update_rule})
    return settings
