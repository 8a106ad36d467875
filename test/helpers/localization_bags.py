# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recorded drives for localization: maps made on another drive, and a way through the messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from heightmap25d_ros import cli, se3
from heightmap25d_ros.evaluation import trajectory_error
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.io.bag import Bag, Event
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.replay import feed
from heightmap25d_ros.pose_interpolation import interpolate
from heightmap25d_ros.simulation import recording

SCANS = ("/scan", "/scan_down")
LISTENED = (*SCANS, "/odom", "/tf", "/tf_static")
PARAMS = with_values(Params(), {"intake.scan_topics": list(SCANS)})


def map_of_another_drive(world: str, directory: Path, scan_rate: float = 18.75) -> Path:
    """A map directory of a world of seed 1, made with true poses on drive 1."""
    bag = directory / f"{world}_drive_1"
    recording.simulate(world, 1, bag, drive=1, mounted=recording.mounted_sensors(scan_rate))
    arguments = ["map", str(bag), "-o", str(directory / world), "--odom-topic", "/ground_truth"]
    assert cli.main(arguments) == 0
    return directory / world


def heights(directory: Path) -> HeightMap:
    return map_directory.load_in(directory, PARAMS.mapper.probability_threshold, "map")


def events_of(bag: Path, seconds: float = 1e9) -> list[Event]:
    with Bag(bag) as opened:
        limit = opened.start_ns + seconds * 1e9
        events = opened.events([*LISTENED, "/ground_truth"])
        return [event for event in events if event.stamp_ns <= limit]


@dataclass
class Drive:
    """What came of a drive."""

    localizer: Localizer
    attempts: list[Any] = field(default_factory=list)
    states: list[Any] = field(default_factory=list)
    stamps: list[int] = field(default_factory=list)
    poses: list[se3.Matrix] = field(default_factory=list)
    deviations: list[float] = field(default_factory=list)

    def errors(self, events: Iterable[Event]) -> np.ndarray:
        """(N, 3): of position [m], z [m], yaw [deg], at each pose."""
        stamps, truth = truth_of(events)
        asked = np.clip(np.array(self.stamps), stamps[0], stamps[-1])
        return trajectory_error.planar_errors(
            np.array(self.poses), interpolate(stamps, truth, asked)
        )


def truth_of(events: Iterable[Event]) -> tuple[np.ndarray, np.ndarray]:
    poses = [event.message for event in events if event.topic == "/ground_truth"]
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in poses]
    positions = [(p.x, p.y, p.z) for p in (m.pose.pose.position for m in poses)]
    rotations = [(q.x, q.y, q.z, q.w) for q in (m.pose.pose.orientation for m in poses)]
    return np.array(stamps), se3.from_quaternion(positions, rotations)


def drive(
    events: Sequence[Event],
    long_term: HeightMap | None,
    *,
    params: Params = PARAMS,
    begin: Callable[[Localizer], None] = lambda localizer: None,
    search_slice: float = np.inf,
) -> Drive:
    """Give events to a localizer."""
    localizer = Localizer(params, search_slice)
    if long_term is not None:
        localizer.set_long_term(long_term)
    begin(localizer)
    result = Drive(localizer)
    for event in events:
        result.attempts += feed(localizer, event.topic, event.message)
        if event.topic == "/odom":
            pose = localizer.pose
            assert pose is not None
            assert np.isfinite(pose.T_map_base).all()
            result.stamps.append(pose.stamp_ns)
            result.poses.append(pose.T_map_base)
            result.states.append(localizer.state)
            result.deviations.append(float(np.sqrt(np.linalg.eigvalsh(pose.covariance)[-1])))
    result.attempts += localizer.flush()
    return result
