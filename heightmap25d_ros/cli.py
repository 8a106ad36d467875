# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: the same core on a recorded bag, deterministic and without a ROS graph."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from heightmap25d_ros import (
    evaluation,
    map_io,
    messages,
    parameter_file,
    params,
    reachability,
    render,
    se3,
    trajectory_error,
)
from heightmap25d_ros.bag import LASER_SCAN, ODOMETRY, Bag
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid import HEIGHT_RESOLUTION, HeightMap
from heightmap25d_ros.intake import Reading
from heightmap25d_ros.mapping import Mapping, compile_kernels
from heightmap25d_ros.params import MapperParams, Params
from heightmap25d_ros.traversability import OCCUPIED, ObstacleMap, convert

GROUND_TRUTH = "/ground_truth"
EXIT_UNUSABLE = 2


def main(arguments: list[str] | None = None) -> int:
    """Run a command; the exit status of the process."""
    options = _parser().parse_args(arguments)
    try:
        figures = options.command(options)
    except InputError as error:
        print(f"heightmap25d: {error}", file=sys.stderr)
        return EXIT_UNUSABLE
    except OSError as error:
        print(f"heightmap25d: {error.filename or 'output'}: {error.strerror}", file=sys.stderr)
        return EXIT_UNUSABLE
    except KeyboardInterrupt:
        return 130
    try:
        print(json.dumps(figures, indent=2) if options.json else "\n".join(_lines(figures)))
        sys.stdout.flush()
    except BrokenPipeError:  # whoever read has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="heightmap25d",
        description="2 1/2-D height maps from recorded laser bags.",
        epilog="Example: heightmap25d map bags/ramp -o out/ramp && "
        "heightmap25d render out/ramp -o out/pictures",
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    command = _command(commands, "map", _map, "a map directory from a bag")
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

    command = _command(commands, "convert", _convert, "the obstacle grid of a map anew")
    command.add_argument("map", type=Path, metavar="DIR", help="map directory")
    command.add_argument("-o", "--output", type=Path, metavar="DIR",
                         help="map directory to write (default: the same)")  # fmt: skip

    command = _command(commands, "render", _render, "pictures of a map directory")
    command.add_argument("map", type=Path, metavar="DIR", help="map directory")
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help="directory for height.png, obstacles.png, blocks.png")  # fmt: skip

    command = _command(commands, "evaluate", _evaluate, "a map directory against the truth")
    command.add_argument("map", type=Path, metavar="DIR", help="map directory")
    command.add_argument("--truth", type=Path, required=True, metavar="FILE",
                         help="the world's surface, as bags/ramp/truth/surface.npz; goals.npz "
                         "beside it is used as well")  # fmt: skip
    command.add_argument("--bag", type=Path, metavar="BAG",
                         help="its /ground_truth is the truth of trajectory.tum")  # fmt: skip

    command = _command(commands, "simulate", _simulate, "a bag of a simulated drive, and its truth")
    command.add_argument("world", metavar="WORLD",
                         help="ramp, room, rough, street, arch, garage or moving")  # fmt: skip
    command.add_argument("--seed", type=int, default=1, metavar="N",
                         help="of the world's details and of the noise (default: 1)")  # fmt: skip
    command.add_argument("-o", "--output", type=Path, required=True, metavar="BAG",
                         help="rosbag2 directory to write, with truth/ in it")  # fmt: skip
    command.add_argument("--scan-rate", type=float, default=37.5, metavar="HZ",
                         help="scans of each laser, at most 75 (default: 37.5)")  # fmt: skip
    command.add_argument("--nodding", action="store_true", help="a third laser, which nods")
    command.add_argument("--true-odometry", action="store_true", help="/odom without errors")
    command.add_argument("--noise-free", action="store_true", help="nothing errs")

    command = _command(commands, "info", _info, "what is in a bag or a map directory")
    command.add_argument("path", type=Path, metavar="BAG|DIR")
    return parser


def _command(commands: Any, name: str, function: Any, help_text: str) -> argparse.ArgumentParser:
    command: argparse.ArgumentParser = commands.add_parser(
        name, help=help_text, description=function.__doc__
    )
    command.set_defaults(command=function)
    command.add_argument("--params", type=Path, metavar="FILE",
                         help="ROS parameter file; see config/heightmap25d.yaml")  # fmt: skip
    command.add_argument("--json", action="store_true", help="print the figures as JSON")
    return command


def _params(options: argparse.Namespace) -> Params:
    return parameter_file.read_yaml(options.params) if options.params else Params()


def _map(options: argparse.Namespace) -> dict[str, Any]:
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
        **_cells(height_map, obstacle_map),
        "seconds": round(seconds, 3),
        "x real time": round(duration / seconds, 1),
        "ms per scan p50": round(p50, 3),
        "ms per scan p95": round(p95, 3),
        "ms per scan p99": round(p99, 3),
        "sha256": map_io.digest(options.output),
    }


def _mapping_params(options: argparse.Namespace, bag: Bag) -> Params:
    """The parameters with the topics of this bag in them."""
    settings = _params(options)
    named = [f"/{topic.lstrip('/')}" for topic in settings.intake.scan_topics]
    topics = options.scan_topic or (named if settings.intake.mounts else bag.scan_topics())
    for topic in topics:
        bag.require(topic, LASER_SCAN)
    values: dict[str, Any] = {"intake.scan_topics": topics}
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


def _convert(options: argparse.Namespace) -> dict[str, Any]:
    """Convert the heights of a map directory again, for instance for another robot."""
    settings = _params(options)
    output = options.output or options.map
    loaded = map_io.load(options.map, settings.mapper.probability_threshold)
    obstacle_map = convert(loaded.height_map, settings.traversability)
    map_io.save(output, loaded.height_map, obstacle_map, loaded.frame_id)
    return {"map": str(output), **_cells(loaded.height_map, obstacle_map)}


def _render(options: argparse.Namespace) -> dict[str, Any]:
    """Draw a map directory: heights, obstacles, and blocks as in Fig. 2(c) of the paper."""
    settings = _params(options)
    height_map = map_io.load(options.map, settings.mapper.probability_threshold).height_map
    trajectory = None
    if (options.map / map_io.TRAJECTORY).exists():
        trajectory = map_io.read_tum(options.map / map_io.TRAJECTORY)[:, 1:4]
    options.output.mkdir(parents=True, exist_ok=True)
    pictures = [options.output / f"{name}.png" for name in ("height", "obstacles", "blocks")]
    render.height_map(pictures[0], height_map, trajectory)
    render.obstacle_map(pictures[1], convert(height_map, settings.traversability), trajectory)
    render.blocks(pictures[2], height_map, trajectory)
    return {"pictures": [str(picture) for picture in pictures]}


def _evaluate(options: argparse.Namespace) -> dict[str, Any]:
    """Hold a map directory against the truth of its world: surface, goals, trajectory."""
    settings = _params(options)
    height_map = map_io.load(options.map, settings.mapper.probability_threshold).height_map
    truth = evaluation.read_truth(options.truth)
    figures = evaluation.evaluate(height_map, settings.traversability, truth).as_dict()
    goals = options.truth.with_name("goals.npz")
    if goals.exists():
        obstacle_map = convert(height_map, settings.traversability)
        pairs = reachability.read_goals(goals)
        figures["goals"] = reachability.evaluate_goals(obstacle_map, pairs).as_dict()
    if options.bag:
        figures["trajectory"] = _trajectory_error(options.map / map_io.TRAJECTORY, options.bag)
    return figures


def _trajectory_error(trajectory: Path, bag_path: Path) -> dict[str, float]:
    with Bag(bag_path) as bag:
        true = [messages.odometry(event.message) for event in bag.events([GROUND_TRUTH])]
    rows = map_io.read_tum(trajectory)
    error = trajectory_error.evaluate_trajectory(
        np.rint(rows[:, 0] * 1e9).astype(np.int64),
        se3.from_quaternion(rows[:, 1:4], rows[:, 4:]),
        np.array([pose.stamp_ns for pose in true], np.int64),
        np.array([pose.T for pose in true]),
    )
    if error is None:
        raise InputError(f"{trajectory}: no pose of it is within the {GROUND_TRUTH} of {bag_path}")
    return error.as_dict()


def _simulate(options: argparse.Namespace) -> dict[str, Any]:
    """Record a drive through a simulated world, and the truth; the same seed, the same bytes."""
    from heightmap25d_ros.simulation import recording  # noqa: PLC0415 - needs MuJoCo

    return recording.simulate(
        options.world,
        options.seed,
        options.output,
        scan_rate=options.scan_rate,
        has_nodding=options.nodding,
        noise=recording.noise_of(
            noise_free=options.noise_free, true_odometry=options.true_odometry
        ),
    )


def _info(options: argparse.Namespace) -> dict[str, Any]:
    """Tell what is in a bag or a map directory."""
    settings = _params(options)
    if (options.path / map_io.HEIGHT_GRID).exists():
        loaded = map_io.load(options.path, settings.mapper.probability_threshold)
        geometry, heights = loaded.height_map.geometry, loaded.height_map
        known = heights.height[heights.known] * HEIGHT_RESOLUTION
        return {
            "frame": loaded.frame_id,
            "size [cells]": list(geometry.shape[::-1]),
            "resolution [m]": geometry.resolution,
            "origin [m]": list(geometry.origin),
            "heights [m]": [round(known.min(), 2), round(known.max(), 2)] if known.size else [],
            **_cells(heights, convert(heights, settings.traversability)),
        }
    with Bag(options.path) as bag:
        return {
            "bag": str(options.path),
            "duration [s]": round(bag.duration, 3),
            **{f"{name} ({topic.message_type})": topic.count for name, topic in bag.topics.items()},
        }


def _cells(height_map: HeightMap, obstacle_map: ObstacleMap) -> dict[str, int]:
    return {
        "known cells": int(height_map.known.sum()),
        "occupied cells": int((obstacle_map.occupancy == OCCUPIED).sum()),
    }


def _lines(figures: dict[str, Any], indent: str = "") -> Iterator[str]:
    """The figures as aligned lines of text."""
    width = max((len(name) for name in figures), default=0)
    for name, value in figures.items():
        if isinstance(value, dict):
            yield f"{indent}{name}" if value else f"{indent}{name:{width}}  none"
            yield from _lines(value, indent + "  ")
        else:
            text = ", ".join(map(str, value)) if isinstance(value, list) else value
            yield f"{indent}{name:{width}}  {text}"
