# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drives of one place, each with poses that drift, into one map.

Each bag is mapped by itself (`slam_drive`), on whatever process or machine; what comes of it can be
sent. The maps are found in one another, and the joint map is made of all scans at their joint poses
(`join_drives`), each held against the merged map once more. A saved map can be the first of them:
then the scans go on where it ended, and what has changed since is taken out of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.localization.landmarks import landmarks_of
from heightmap25d_ros.localization.layers import LayerMap
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.slam import CorrectedMapping, map_again, slam_bag
from heightmap25d_ros.slam.map_merge import merge_maps, register_all
from heightmap25d_ros.slam.map_pass import ScanPose
from heightmap25d_ros.slam.map_registration import MapRegistration, RegisteredMap
from heightmap25d_ros.terrain.traversability import ObstacleMap


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveTask:
    """What is to be mapped.

    Attributes
    ----------
    path : Path
        Of the bag.
    params : Params
        With the scan topics of the bag.
    odom_topic : str
    stretch : (int, int) [ns]
        See `replay.replayed`.
    """

    path: Path
    params: Params
    odom_topic: str
    stretch: tuple[int, int]


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class MappedDrive:
    """What came of a drive.

    Attributes
    ----------
    height_map, obstacle_map, layers
        Its map.
    poses : list of ScanPose
        Of the scans, in it.
    trajectory : list of (int, (4, 4) float64)
        Stamp [ns] and pose of the robot in the map at each scan.
    covariances : list of (3, 3) float64
        Of x, y [m], yaw [rad] at each scan, seen from the first pose.
    report : dict of str to Any
        How its poses were found, as in ``slam.json``.
    notices : list of str
        What was wrong with its messages.
    dropped : dict of str to int
        What was not used.
    """

    height_map: HeightMap
    obstacle_map: ObstacleMap
    layers: LayerMap | None
    poses: list[ScanPose]
    trajectory: list[tuple[int, se3.Matrix]]
    covariances: list[Array]
    report: dict[str, Any]
    notices: list[str]
    dropped: dict[str, int]


def slam_drive(task: DriveTask) -> MappedDrive:
    """Map a bag without known poses, see `slam_bag`.

    Raises
    ------
    InputError
        If the bag is damaged, or nothing could be mapped.
    """
    with Bag(task.path) as bag:
        result = slam_bag(bag, task.params, task.odom_topic, task.stretch)
    height_map, obstacle_map = result.mapping.maps()
    if not height_map.known.any():
        raise result.slam.nothing_of(task.path, "no scan could be mapped")
    tracker = result.slam.tracker
    return MappedDrive(
        height_map=height_map, obstacle_map=obstacle_map,
        layers=result.mapping.layers(height_map.geometry),
        poses=result.poses, trajectory=result.trajectory, covariances=tracker.covariances(),
        report={
            "poses": "estimated",
            "distance_m": round(tracker.distance, 3),
            "unobserved_m": round(tracker.unobserved, 3),
            "disagreed_m": round(result.disagreed, 3),
            "submaps_m": np.round(tracker.graph.poses[:, :2], 3).tolist(),
            "loops": [asdict(attempt) for attempt in tracker.attempts],
        },
        notices=[*result.slam.noticed(), *result.mapping.dropped.notices],
        dropped=dict(result.slam.dropped),
    )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class JointMap:
    """The map of several drives.

    Attributes
    ----------
    mapping : Mapping
    trajectories : list of list of (int, (4, 4) float64)
        Of each drive, in the joint map.
    disagreed : float [m]
        Travelled where the merged maps and the poses that they were made of disagree.
    found : list of MapRegistration
        Where the map of each drive lies in that of the first one, or in the initial map.
    """

    mapping: Mapping
    trajectories: list[list[tuple[int, se3.Matrix]]]
    disagreed: float
    found: list[MapRegistration]


def join_drives(
    tasks: Sequence[DriveTask], drives: Sequence[MappedDrive], initial: Path | None = None
) -> JointMap:
    """Make one map of drives of one place; its frame is that of the first one.

    Parameters
    ----------
    tasks, drives : sequence of DriveTask, of MappedDrive
    initial : Path, optional
        A map directory to go on from, in whose frame the drives are put.

    Raises
    ------
    InputError
        If the map of one fits nowhere in the others, or in several places; or the initial map
        cannot be used.
    """
    params = tasks[0].params
    mapping = Mapping(params)
    maps = [RegisteredMap(drive.height_map, drive.layers, params) for drive in drives]
    names = [str(task.path) for task in tasks]
    if initial is not None:
        mapping.load(initial)
        height_map, _ = mapping.maps(np.inf)
        layers = mapping.layers(height_map.geometry)
        maps.insert(0, RegisteredMap(height_map, layers, params))
        names.insert(0, str(initial))
    found = register_all(maps, names, params)
    merged = merge_maps(maps, [registration.T_fixed_moving for registration in found], params)
    landmarks = None if merged.layers is None else landmarks_of(merged.height_map, merged.layers)
    found = found[-len(drives) :]
    trajectories, disagreed = [], 0.0
    for task, drive, registration in zip(tasks, drives, found, strict=True):
        T = registration.T_fixed_moving
        placed = [pose._replace(T_map_odom=T @ pose.T_map_odom) for pose in drive.poses]
        made = CorrectedMapping(mapping, placed, params, landmarks)
        with Bag(task.path) as bag:
            map_again(bag, made, task.odom_topic, params, task.stretch)
        trajectories.append(made.trajectory)
        disagreed += made.disagreed
    return JointMap(mapping=mapping, trajectories=trajectories, disagreed=disagreed, found=found)


def joint_report(joint: JointMap, drives: Sequence[MappedDrive]) -> dict[str, Any]:
    """What ``slam.json`` tells of several drives: submaps and loops of all of them."""
    submaps: list[list[float]] = []
    loops = []
    for drive, registration in zip(drives, joint.found, strict=True):
        T, begun = registration.T_fixed_moving, len(submaps)
        places = np.array(drive.report["submaps_m"]).reshape(-1, 2)
        submaps += np.round(places @ T[:2, :2].T + T[:2, 3], 3).tolist()
        loops += [
            loop | {name: loop[name] + begun for name in ("first", "second")}
            for loop in drive.report["loops"]
        ]
    return {
        "poses": "estimated",
        "distance_m": round(sum(d.report["distance_m"] for d in drives), 3),
        "unobserved_m": round(sum(d.report["unobserved_m"] for d in drives), 3),
        "disagreed_m": round(joint.disagreed, 3),
        "submaps_m": submaps,
        "loops": loops,
    }
