# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d map``: a map directory from bags."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.commands.common import (
    Figures,
    add_command,
    add_topics,
    cell_counts,
    check_output,
    figures_of,
    read_bag_params,
    require_map,
    warn,
)
from heightmap25d_ros.commands.stretch import add_stretch, stretch
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import MapperParams, Params
from heightmap25d_ros.params.spec import specs
from heightmap25d_ros.pipelines.mapping import Mapping, compile_kernels
from heightmap25d_ros.pipelines.replay import Step, pose_topic, replayed
from heightmap25d_ros.pipelines.scan_queue import Reading


def add_to(commands: Any) -> None:
    """Add ``map``."""
    command = add_command(commands, "map", _map)
    command.add_argument("bags", type=Path, nargs="+", metavar="BAG",
                         help="rosbag2 directory, or a file of it; several are mapped one after "
                         "the other, their poses must be in one frame")  # fmt: skip
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help="map directory to write")  # fmt: skip
    command.add_argument("--initial-map", type=Path, metavar="DIR",
                         help="map directory to go on from (default: mapping.initial_map of "
                         "--params, below mapping.map_directory)")  # fmt: skip
    add_stretch(command)
    add_topics(command)
    rules = dict((name, spec) for name, spec, _ in specs(MapperParams()))
    command.add_argument("--update-rule", choices=rules["update_rule"].choices,
                         help="in place of mapper.update_rule")  # fmt: skip


def _map(options: argparse.Namespace) -> Figures:
    """Map bags: scans and 3-D odometry in, a map directory out; the same bags, the same bytes.

    Several bags make the map of one long drive with poses in one frame. Where a bag begins, scans
    before its first pose are not used, nor those after the last pose of the one before it.
    """
    check_output(options.output)
    if len(options.bags) > 1 and (options.start or options.duration < math.inf):
        raise InputError("--start and --duration are for a single bag")
    with ExitStack() as stack:
        bags = [stack.enter_context(Bag(path)) for path in options.bags]
        settings = _mapping_params(options, bags)
        mapping = _begun(options, settings)
        topics = [pose_topic(bag, options.odom_topic, settings.intake)[0] for bag in bags]
        stretches = [stretch(bag, options) for bag in bags]
        compile_kernels(settings)  # not what is timed below
        began = time.perf_counter()
        trajectory: list[tuple[int, se3.Matrix]] = []
        scan_ms: list[float] = []
        for bag, topic, part in zip(bags, topics, stretches, strict=True):
            for step in _drive(mapping, bag, topic, settings, part):
                count = len(step.outcomes)
                scan_ms += [step.milliseconds / max(count, 1)] * count
                trajectory += [(r.scan.stamp_ns, r.T_map_base[0]) for r in step.outcomes]
        height_map, obstacle_map = mapping.maps()
        seconds = time.perf_counter() - began
    if not height_map.known.any():
        raise _nothing_mapped(bags[-1], mapping)
    warnings = mapping.noticed()
    warn(warnings)
    frame = settings.mapping.map_frame
    layers = mapping.layers(height_map.geometry)
    map_directory.save(options.output, height_map, obstacle_map, frame, trajectory, layers)
    duration = sum(stop - start for start, stop in stretches) * 1e-9
    return {
        **figures_of(bags),
        "map": str(options.output),
        "merged": dict(mapping.merged),
        **({"clouds": mapping.watch.clouds} if mapping.watch.clouds else {}),
        "dropped": dict(mapping.dropped),
        "warnings": [*(line for bag in bags for line in bag.warnings), *warnings],
        **cell_counts(height_map, obstacle_map),
        "processing_s": round(seconds, 3),
        "real_time_factor": round(duration / seconds, 1),
        **{f"scan_p{p}_ms": round(np.percentile(scan_ms, p), 3) for p in (50, 95, 99)},
        "sha256": map_directory.digest(options.output),
    }


def _begun(options: argparse.Namespace, settings: Params) -> Mapping:
    """A map to write into: empty, or the initial one."""
    mapping = Mapping(settings)
    directory, name = options.initial_map, settings.mapping.initial_map
    if directory is None and name:
        directory = map_directory.map_path(Path(settings.mapping.map_directory), name)
    if directory is not None:
        require_map(directory)
        mapping.load(directory)
    return mapping


def _drive(
    mapping: Mapping, bag: Bag, odom_topic: str, settings: Params, part: tuple[int, int]
) -> Iterator[Step[Reading]]:
    """Map a stretch of a bag; InputError where nothing of it is mapped, or in another frame."""
    before, returns = mapping.odometry, mapping.merged["returns"]
    mapping.begin_drive()
    yield from replayed(bag, mapping, odom_topic, settings.intake, part)
    if mapping.merged["returns"] == returns:
        raise _nothing_mapped(bag, mapping)
    newest = mapping.odometry
    if before is not None and newest is not None and newest.frame_id != before.frame_id:
        raise InputError(
            f"{bag.path}: its poses are in {newest.frame_id!r}, those of the bag before it in "
            f"{before.frame_id!r}"
        )


def _nothing_mapped(bag: Bag, mapping: Mapping) -> InputError:
    """Why nothing of a bag is in the map."""
    scans = mapping.merged["scans"]
    told = f"nothing could be mapped of {scans} scans" if scans else "no scan could be mapped"
    return mapping.nothing_of(bag.path, told)


def _mapping_params(options: argparse.Namespace, bags: Sequence[Bag]) -> Params:
    """The parameters with the topics of these bags in them."""
    settings = read_bag_params(options, bags)
    if options.update_rule:
        return with_values(settings, {"mapper.update_rule": options.update_rule})
    return settings
