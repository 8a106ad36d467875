# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drives that the studies of localization share: recorded or simulated, mapped, localized."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation import trajectory_error
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.bag import Bag, Event
from heightmap25d_ros.localization.layers import LayerMap
from heightmap25d_ros.localization.tracker import Attempt
from heightmap25d_ros.localization.tracking_state import State
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import feed
from heightmap25d_ros.pose_interpolation import interpolate
from heightmap25d_ros.simulation import recording

SCANS = ("/scan", "/scan_down")
PARAMS = with_values(Params(), {"intake.scan_topics": list(SCANS)})
LongTerm = tuple[HeightMap, LayerMap | None]


@dataclasses.dataclass
class Run:
    """A drive that was localized."""

    stamps: list[int]
    told: list[se3.Matrix]
    odometry: list[se3.Matrix]
    covariances: list[np.ndarray]
    attempts: list[Attempt]
    state: State


def events_of(bags: Path, world: str, seed: int, drive: int) -> list[Event]:
    path = bags / f"{world}_{seed}_{drive}"
    if not path.exists():
        recording.simulate(world, seed, path, drive=drive)
    with Bag(path) as bag:
        return list(bag.events([*SCANS, "/odom", "/ground_truth", "/tf_static"]))


def mapped(events: Sequence[Event], odom_topic: str, params: Params = PARAMS) -> LongTerm:
    """A map with the poses of a topic, and its localization layers."""
    mapping = Mapping(params)
    for event in events:
        feed(mapping, event.topic, event.message, odom_topic)
    mapping.flush()
    height_map = mapping.maps()[0]
    return height_map, mapping.layers(height_map.geometry)


def localized(events: Sequence[Event], localizer: Localizer) -> Run:
    run = Run([], [], [], [], [], State.DEGRADED)
    for event in events:
        run.attempts += feed(localizer, event.topic, event.message)
        if event.topic == "/odom":
            pose = localizer.pose
            assert pose is not None
            run.stamps.append(pose.stamp_ns)
            run.told.append(pose.T_map_base)
            run.odometry.append(se3.inverse(pose.T_map_odom) @ pose.T_map_base)
            run.covariances.append(pose.covariance)
    run.state = localizer.state
    return run


def truth_of(events: Sequence[Event]) -> tuple[np.ndarray, se3.Matrix]:
    poses = [decode.odometry(e.message) for e in events if e.topic == "/ground_truth"]
    return np.array([p.stamp_ns for p in poses]), np.array([p.T for p in poses])


def error_of(run: Run, poses: Sequence[se3.Matrix], truth: tuple[np.ndarray, se3.Matrix]):
    return trajectory_error.evaluate_trajectory(np.array(run.stamps), np.array(poses), *truth)


def material(bags: Path, world: str, seed: int):
    """Events and truth of drive 0, and the long-term map of drive 1."""
    long_term = mapped(events_of(bags, world, seed, 1), "/ground_truth")
    events = events_of(bags, world, seed, 0)
    return events, truth_of(events), long_term


def overconfident(run: Run, truth: tuple[np.ndarray, se3.Matrix]) -> int:
    """How many poses are off by more than 0.15 m and by more than three of their deviations."""
    stamps = np.clip(np.array(run.stamps), truth[0][0], truth[0][-1])
    error = (np.array(run.told) - interpolate(*truth, stamps))[:, :2, 3]
    planar = np.array(run.covariances)[:, :2, :2]
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(planar), error)
    return int(((squared > 9.0) & (np.linalg.norm(error, axis=1) > 0.15)).sum())
