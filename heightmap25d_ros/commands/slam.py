# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d slam``: a map of bags whose poses drift."""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

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
from heightmap25d_ros.commands.merge import placing
from heightmap25d_ros.commands.stretch import add_stretch, stretch
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import atomic_directory, map_directory, slam_file
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.localization.layers import LayerMap
from heightmap25d_ros.pipelines.mapping import compile_kernels
from heightmap25d_ros.pipelines.replay import pose_topic
from heightmap25d_ros.pipelines.slam_drives import (
    DriveTask,
    MappedDrive,
    join_drives,
    joint_report,
    slam_drive,
)
from heightmap25d_ros.terrain.traversability import ObstacleMap

_Trajectory = Sequence[tuple[int, se3.Matrix]]
_Made = tuple[HeightMap, ObstacleMap, LayerMap | None, _Trajectory, dict[str, Any]]


def add_to(commands: Any) -> None:
    """Add ``slam``."""
    command = add_command(commands, "slam", _slam)
    command.add_argument("bags", type=Path, nargs="+", metavar="BAG",
                         help="rosbag2 directory, or a file of it; several, of one place, become "
                         "one map in the frame of the first one")  # fmt: skip
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help="map directory to write")  # fmt: skip
    where = command.add_mutually_exclusive_group()
    where.add_argument("--jobs", type=_count, default=1, metavar="N",
                       help="processes for several bags (default: 1)")  # fmt: skip
    where.add_argument("--dask", metavar="ADDRESS",
                       help="scheduler of a Dask cluster whose workers see the same files: the "
                       "bags are mapped there; needs dask.distributed")  # fmt: skip
    command.add_argument("--initial-map", type=Path, metavar="DIR",
                         help="map directory to go on from, wherever in it the bags begin: its "
                         "frame stays, what has changed is updated")  # fmt: skip
    add_stretch(command)
    add_topics(command)


def _count(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a number from 1 on")
    return number


def _slam(options: argparse.Namespace) -> Figures:
    """Map bags without known poses: scans and odometry in, a map directory out.

    Each scan is localized on the map made so far. The same bags give the same bytes, on however
    many processes. Several bags are mapped by themselves first; then their maps are searched in one
    another, and one that fits nowhere or in several places is refused. Besides what `map` writes:
    trajectory.tum (base in map), covariance.csv (seen from where each drive began), and slam.json
    with the loops that were closed or refused.
    """
    check_output(options.output)
    if options.initial_map is not None:
        require_map(options.initial_map)
    if len(options.bags) > 1 and (options.start or options.duration < math.inf):
        raise InputError("--start and --duration are for a single bag")
    with ExitStack() as stack:
        bags = [stack.enter_context(Bag(path)) for path in options.bags]
        settings = read_bag_params(options, bags)
        tasks = [
            DriveTask(
                path=bag.path.resolve(), params=settings, stretch=stretch(bag, options),
                odom_topic=pose_topic(bag, options.odom_topic, settings.intake)[0],
            ) for bag in bags
        ]  # fmt: skip
        about, notices = figures_of(bags), [line for bag in bags for line in bag.warnings]
    compile_kernels(settings)  # not what is timed below
    began = time.perf_counter()
    drives = _mapped(tasks, options)
    is_joined = len(drives) > 1 or options.initial_map is not None
    made = _joined(tasks, drives, options.initial_map) if is_joined else _alone(drives[0])
    height_map, obstacle_map, layers, trajectory, report = made
    seconds = time.perf_counter() - began
    warnings = [line for drive in drives for line in drive.notices]
    warn(warnings)
    frame = settings.mapping.map_frame
    map_directory.save(options.output, height_map, obstacle_map, frame, trajectory, layers)
    with atomic_directory.adding(options.output) as new:
        slam_file.write(options.output, report, into=new)
        stamps = [stamp for stamp, _ in trajectory]
        covariances = [covariance for drive in drives for covariance in drive.covariances]
        slam_file.write_covariances(new / slam_file.COVARIANCE, stamps, covariances)
    duration = sum(stop - start for start, stop in (task.stretch for task in tasks)) * 1e-9
    return {
        **about,
        "map": str(options.output),
        "scans": len(trajectory),
        "dropped": dict(sum((Counter(drive.dropped) for drive in drives), Counter())),
        "warnings": [*notices, *warnings],
        **cell_counts(height_map, obstacle_map),
        **{name: report[name] for name in ("distance_m", "unobserved_m", "disagreed_m")},
        "loops": dict(Counter(loop["outcome"] for loop in report["loops"])),
        **({"drives": report["drives"]} if "drives" in report else {}),
        "processing_s": round(seconds, 3),
        "real_time_factor": round(duration / seconds, 1),
        "sha256": map_directory.digest(options.output),
    }


def _mapped(tasks: Sequence[DriveTask], options: argparse.Namespace) -> list[MappedDrive]:
    """Each drive by itself, on this process or on others."""
    if options.dask is None and min(options.jobs, len(tasks)) == 1:
        return [slam_drive(task) for task in tasks]
    with _executor(options) as executor:
        return list(executor.map(slam_drive, tasks))


@contextmanager
def _executor(options: argparse.Namespace) -> Iterator[Executor]:
    if options.dask is None:
        with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
            yield pool
        return
    try:
        from distributed import Client  # noqa: PLC0415 - an extra
    except ImportError:
        raise InputError(
            "--dask needs dask.distributed: pip install -r requirements/dask.txt"
        ) from None
    try:
        client = Client(options.dask, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(f"--dask {options.dask}: {error}") from None
    with client, client.get_executor() as cluster:
        yield cluster


def _alone(drive: MappedDrive) -> _Made:
    return drive.height_map, drive.obstacle_map, drive.layers, drive.trajectory, drive.report


def _joined(
    tasks: Sequence[DriveTask], drives: Sequence[MappedDrive], initial: Path | None
) -> _Made:
    joint = join_drives(tasks, drives, initial)
    height_map, obstacle_map = joint.mapping.maps()
    trajectory = [step for steps in joint.trajectories for step in steps]
    placed = [
        {"bag": task.path.name, **placing(found, is_first=initial is None and not number)}
        for number, (task, found) in enumerate(zip(tasks, joint.found, strict=True))
    ]
    report = joint_report(joint, drives) | {"drives": placed}
    if initial is not None:
        report["initial_map"] = str(initial)
    layers = joint.mapping.layers(height_map.geometry)
    return height_map, obstacle_map, layers, trajectory, report
