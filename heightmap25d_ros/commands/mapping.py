# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d map``: a map directory from a bag."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from heightmap25d_ros import map_io, params, se3
from heightmap25d_ros.bag import LASER_SCAN, ODOMETRY, Bag
from heightmap25d_ros.commands.command import Figures, add_command, cell_counts, read_params
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.intake import Reading
from heightmap25d_ros.mapping import Mapping, compile_kernels
from heightmap25d_ros.params import MapperParams, Params


def add_to(commands: Any) -> None:
    """Add ``map``."""
    command = add_command(commands, "map", _map, "a map directory from a bag")
    command.add_argument("bag", type=Path, metavar="BAG", help="rosbag2 directory, or a file of it")
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help="map directory to write")  # fmt: skip
    command.add_argument("--odom-topic", metavar="T",
                         help="Odometry, a 3-D pose (default: /odom, or the only one)")  # fmt: skip
    command.add_argument("--scan-topic", metavar="T", action="append", default=[],
                         help="a laser, repeatable (default: every LaserScan topic)")  # fmt: skip
    rules = dict((name, spec) for name, spec, _ in params.specs(MapperParams()))
    command.add_argument("--update-rule", choices=rules["update_rule"].choices,
                         help="in place of mapper.update_rule")  # fmt: skip


def _map(options: argparse.Namespace) -> Figures:
    """Map a bag: scans and 3-D odometry in, a map directory out; the same bag, the same bytes."""
    with Bag(options.bag) as bag:
        settings = _mapping_params(options, bag)
        odom_topic = options.odom_topic or bag.odometry_topic()
        bag.require(odom_topic, ODOMETRY)
        compile_kernels(settings)  # not what is timed below
        mapping = Mapping(settings)
        trajectory: list[tuple[int, se3.Matrix]] = []
        scan_ms: list[float] = []
        began = time.perf_counter()
        for event_ms, readings in _replayed(bag, mapping, odom_topic):
            scan_ms += [event_ms / len(readings)] * len(readings)
            trajectory += [(r.scan.stamp_ns, r.T_map_base[0]) for r in readings]
        height_map, obstacle_map = mapping.maps()
        seconds = time.perf_counter() - began
        duration = bag.duration
    if not scan_ms:
        raise InputError(f"{options.bag}: no scan could be mapped; {_reasons(mapping)}")
    frame = settings.mapping.map_frame
    map_io.save(options.output, height_map, obstacle_map, frame, trajectory)
    p50, p95, p99 = np.percentile(scan_ms, [50, 95, 99])
    return {
        "bag": str(options.bag),
        "map": str(options.output),
        "merged": dict(mapping.merged),
        "dropped": dict(mapping.dropped),
        "damaged": dict(bag.damaged),
        **cell_counts(height_map, obstacle_map),
        "seconds": round(seconds, 3),
        "x real time": round(duration / seconds, 1),
        "ms per scan p50": round(p50, 3),
        "ms per scan p95": round(p95, 3),
        "ms per scan p99": round(p99, 3),
        "sha256": map_io.digest(options.output),
    }


def _mapping_params(options: argparse.Namespace, bag: Bag) -> Params:
    """The parameters with the topics of this bag in them."""
    settings = read_params(options)
    named = [f"/{topic.lstrip('/')}" for topic in settings.intake.scan_topics]
    topics = options.scan_topic or (named if settings.intake.mounts else bag.scan_topics())
    for topic in topics:
        bag.require(topic, LASER_SCAN)
    values: Figures = {"intake.scan_topics": topics}
    if options.update_rule:
        values["mapper.update_rule"] = options.update_rule
    return params.with_values(settings, values)


def _replayed(bag: Bag, mapping: Mapping, odom_topic: str) -> Iterator[tuple[float, list[Reading]]]:
    """Give a bag to a mapping: milliseconds and readings of each message that completed some."""
    transform_topics = [topic for topic in ("/tf", "/tf_static") if topic in bag.topics]
    topics = [*mapping.scan_topics, odom_topic, *transform_topics]
    total = sum(bag.topics[topic].count for topic in topics if topic in bag.topics)
    with tqdm(total=total, unit=" messages", unit_scale=True, desc=bag.path.name) as progress:
        for event in bag.events(topics):
            began = time.perf_counter()
            if event.topic == odom_topic:
                readings = mapping.take_odometry(event.message)
            elif event.topic in transform_topics:
                is_static = event.topic == "/tf_static"
                readings = mapping.take_transforms(event.message, is_static=is_static)
            else:
                readings = mapping.take_scan(event.topic, event.message)
            if readings:
                yield 1e3 * (time.perf_counter() - began), readings
            progress.update()
    began = time.perf_counter()
    readings = mapping.flush()
    if readings:
        yield 1e3 * (time.perf_counter() - began), readings


def _reasons(mapping: Mapping) -> str:
    dropped = mapping.dropped.most_common()
    return "; ".join(f"{reason} ({count})" for reason, count in dropped) or "the bag has none"
