# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d localize``: the drifting pose of a bag is held to a map."""

from __future__ import annotations

import argparse
import csv
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.commands.common import (
    Figures,
    add_command,
    add_topics,
    check_output,
    figures_of,
    read_bag_params,
    require_map,
    warn,
)
from heightmap25d_ros.commands.stretch import add_stretch, stretch
from heightmap25d_ros.evaluation import trajectory_error
from heightmap25d_ros.evaluation.trajectory_error import TrajectoryError
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import atomic_directory, decode, layers_file, map_directory, trajectory
from heightmap25d_ros.io.bag import ODOMETRY, Bag
from heightmap25d_ros.localization.surface import surface_of
from heightmap25d_ros.localization.tracker import Attempt
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.localization import Localizer, compile_kernels
from heightmap25d_ros.pipelines.replay import pose_topic, replayed
from heightmap25d_ros.pose_interpolation import interpolate
from heightmap25d_ros.viz import localization_figures

Trajectory = list[tuple[int, se3.Matrix]]

GROUND_TRUTH = "/ground_truth"
REGISTRATIONS = "registrations.csv"
_COLUMNS = (
    "t", "kind", "reason", "state", "x", "y", "z", "yaw", "position_deviation", "yaw_deviation",
    "overlap", "residual", "ratio", "points",
)  # fmt: skip


def add_to(commands: Any) -> None:
    """Add ``localize``."""
    command = add_command(commands, "localize", _localize)
    command.add_argument("bag", type=Path, metavar="BAG", help="rosbag2 directory, or a file of it")
    command.add_argument("--map", type=Path, required=True, metavar="DIR",
                         help="map directory of the long-term map")  # fmt: skip
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help="directory for trajectories, registrations, pictures")  # fmt: skip
    command.add_argument("--initial", type=_pose, metavar="X,Y,Z,YAW",
                         help="where the robot is at the first odometry [m, rad] (default: odom "
                         "and map are the same)")  # fmt: skip
    add_stretch(command)
    add_topics(command)


def _pose(text: str) -> Array:
    numbers = np.array([float(part) for part in text.split(",")])
    if len(numbers) != 4 or not np.isfinite(numbers).all():
        raise argparse.ArgumentTypeError(f"{text} is not x,y,z,yaw")
    return numbers


def _localize(options: argparse.Namespace) -> Figures:
    """Localize a bag's drive in a map by its scans and odometry; the same bag, the same bytes.

    Writes trajectory.tum (base in map), registrations.csv (x, y, z, yaw: what the pose was found
    to be off [m, rad]) and pictures; with /ground_truth in the bag, the error as well.
    """
    require_map(options.map)
    check_output(options.output)
    with Bag(options.bag) as bag:
        settings = read_bag_params(options, [bag], "localization")
        odom_topic, _ = pose_topic(bag, options.odom_topic, settings.intake)
        part = stretch(bag, options)
        long_term = map_directory.load_in(
            options.map, settings.mapper.probability_threshold, settings.mapping.map_frame
        )
        compile_kernels(settings)  # not what is timed below
        localizer = Localizer(settings)
        localizer.set_long_term(long_term, layers_file.load(options.map, long_term))
        if options.initial is not None:
            localizer.begin_at(options.initial)
        attempts: list[Attempt] = []
        corrected: Trajectory = []
        odometry: Trajectory = []
        began = time.perf_counter()
        for step in replayed(bag, localizer, odom_topic, settings.intake, part):
            attempts += step.outcomes
            pose = localizer.pose
            is_new = pose is not None and (not corrected or pose.stamp_ns != corrected[-1][0])
            if step.topic == odom_topic and pose is not None and is_new:
                corrected.append((pose.stamp_ns, pose.T_map_base))
                odometry.append((pose.stamp_ns, se3.inverse(pose.T_map_odom) @ pose.T_map_base))
        seconds = time.perf_counter() - began
        truth = _truth(bag, settings)
    if not attempts:
        raise localizer.nothing_of(bag.path, "nothing to register")
    warnings = localizer.noticed()
    warn(warnings)
    duration = (part[1] - part[0]) * 1e-9
    T_map_odom = corrected[0][1] @ se3.inverse(odometry[0][1])
    odometry = [(stamp, T_map_odom @ T) for stamp, T in odometry]
    with atomic_directory.adding(options.output) as new:
        trajectory.write_tum(new / map_directory.TRAJECTORY, corrected)
        _write_attempts(new / REGISTRATIONS, attempts)
        _draw(new, long_term, settings, attempts, (corrected, odometry, truth))
    return {
        **figures_of([bag]),
        "output": str(options.output),
        "registrations": len(attempts),
        "outcomes": _counted(f"{a.kind.value}: {a.registration.reason.value}" for a in attempts),
        "state": attempts[-1].state.name,
        "dropped": dict(localizer.dropped),
        "warnings": [*bag.warnings, *warnings],
        **_errors(corrected, odometry, truth),
        "processing_s": round(seconds, 3),
        "real_time_factor": round(duration / seconds, 1),
    }


def _truth(bag: Bag, settings: Params) -> Trajectory:
    """The true poses in the map, if the bag has them."""
    if GROUND_TRUTH not in bag.topics_of(ODOMETRY):
        return []
    poses = [decode.odometry(event.message) for event in bag.events([GROUND_TRUTH])]
    return [(p.stamp_ns, p.T) for p in poses if p.frame_id == settings.mapping.map_frame]


def _counted(names: Any) -> dict[str, int]:
    return dict(Counter(names).most_common())


def _write_attempts(path: Path, attempts: Sequence[Attempt]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(_COLUMNS)
        for attempt in attempts:
            found = attempt.registration
            x, y, yaw = found.offset
            numbers = (
                x, y, found.z, yaw, *attempt.deviation, found.overlap, found.residual, found.ratio
            )  # fmt: skip
            writer.writerow((
                f"{attempt.stamp_ns // 10**9}.{attempt.stamp_ns % 10**9:09d}",
                attempt.kind.value, found.reason.value, attempt.state.name,
                *(f"{number:.6f}" for number in numbers), found.points,
            ))  # fmt: skip


def _arrays(trajectory: Trajectory) -> tuple[NDArray[np.int64], se3.Matrix]:
    stamps = np.array([stamp for stamp, _ in trajectory], np.int64)
    return stamps, np.array([T for _, T in trajectory]).reshape(-1, 4, 4)


def _errors(corrected: Trajectory, odometry: Trajectory, truth: Trajectory) -> Figures:
    if not truth:
        return {}
    results: dict[str, TrajectoryError | None] = {
        name: trajectory_error.evaluate_trajectory(*_arrays(trajectory), *_arrays(truth))
        for name, trajectory in (("corrected", corrected), ("odometry_alone", odometry))
    }
    return {name: error.as_dict() for name, error in results.items() if error is not None}


def _draw(
    directory: Path,
    long_term: HeightMap,
    settings: Params,
    attempts: Sequence[Attempt],
    ways: tuple[Trajectory, Trajectory, Trajectory],
) -> None:
    (stamps, corrected), (_, odometry), (true_stamps, truth) = map(_arrays, ways)
    localization_figures.trajectories(
        directory / "trajectories.png", long_term, corrected[:, :3, 3], odometry[:, :3, 3],
        truth[:, :3, 3] if len(truth) else None,
    )  # fmt: skip
    accepted = [a for a in attempts if a.registration.is_accepted] or list(attempts)
    surface = surface_of(long_term, settings.registration.edge_step)
    localization_figures.score_surface(
        directory / "score.png", accepted[len(accepted) // 2], surface, settings.registration
    )
    if not len(truth):
        return
    covered = (stamps >= true_stamps[0]) & (stamps <= true_stamps[-1])
    if not covered.any():
        return
    true = interpolate(true_stamps, truth, stamps[covered])
    refused = [a.stamp_ns for a in attempts if not a.registration.is_accepted]
    localization_figures.errors(
        directory / "errors.png",
        (stamps[covered] - stamps[0]) * 1e-9,
        trajectory_error.planar_errors(corrected[covered], true),
        trajectory_error.planar_errors(odometry[covered], true),
        (np.array(refused) - stamps[0]) * 1e-9,
    )
