# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""KISS-ICP and small_gicp (requirements/peers.txt) on the same scans, for measure_slam.py.

They are made for lidars that see in space. A frame consists of the returns of the newest scan of
each laser, put together by odometry, seen from the robot levelled by the odometry's roll, pitch and
z. What a level laser sees stands at three heights, since a plane of points leaves three ways open;
z, roll and pitch of what they find are not used.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.replay import replayed
from heightmap25d_ros.pipelines.scan_queue import Reading
from heightmap25d_ros.pipelines.sensor_intake import SensorIntake

LEVEL = "scan"
STOREY = np.array([[0.0, 0.0, 1.0]])  # [m] from one copy of a level scan to the next
VOXEL, FAR = 0.2, 30.0  # [m]
GAUSSIAN_VOXEL = 0.5  # [m] of small_gicp's map


class Frame(NamedTuple):
    """Points (N, 3) [m] seen from the levelled robot, and its pose (4, 4) by odometry."""

    stamp_ns: int
    points: np.ndarray
    odometry: se3.Matrix


class _Readings(SensorIntake[Reading]):
    def _use(self, readings: list[Reading]) -> list[Reading]:
        return readings


def frames(bag: Bag, params: Params) -> Iterator[Frame]:
    """One for each scan of the level laser."""
    seen: dict[str, np.ndarray] = {}
    for step in replayed(bag, _Readings(params), "/odom", params.intake):
        for reading in step.outcomes:
            beams = reading.beams(params)
            ends = beams.ends[beams.is_hit & ~beams.is_lone]
            is_level = reading.topic.strip("/") == LEVEL
            copies = (ends - STOREY, ends, ends + STOREY) if is_level else (ends,)
            seen[reading.topic] = np.concatenate(copies)
            if is_level:
                x, y, _, _, _, yaw = se3.to_xyz_rpy(reading.T_map_base[-1])
                T = se3.from_xyz_rpy([x, y, 0.0, 0.0, 0.0, yaw])
                points = se3.transform_points(se3.inverse(T), np.concatenate([*seen.values()]))
                yield Frame(reading.scan.stamp_ns, points, T)


def kiss_icp(found: Sequence[Frame], *, is_guided: bool) -> list[tuple[int, se3.Matrix]]:
    """Stamps [ns] and poses (4, 4), the first of which is that of the odometry.

    It expects the motion of before, or, where it is guided, that of the odometry.
    """
    from kiss_icp.config import KISSConfig  # noqa: PLC0415 - an extra
    from kiss_icp.kiss_icp import KissICP  # noqa: PLC0415

    config = KISSConfig()
    config.data.max_range, config.data.min_range, config.data.deskew = FAR, 0.1, False
    config.mapping.voxel_size, config.registration.max_num_threads = VOXEL, 1
    icp, first, before = KissICP(config), found[0].odometry, found[0].odometry
    told = []
    for frame in found:
        if is_guided:
            icp.last_delta = se3.inverse(before) @ frame.odometry
            before = frame.odometry
        icp.register_frame(np.ascontiguousarray(frame.points), np.zeros(len(frame.points)))
        x, y, _, _, _, yaw = se3.to_xyz_rpy(icp.last_pose)
        icp.last_pose = se3.from_xyz_rpy([x, y, 0.0, 0.0, 0.0, yaw])
        told.append((frame.stamp_ns, np.asarray(first @ icp.last_pose)))
    return told


def small_gicp(found: Sequence[Frame], *, is_guided: bool) -> list[tuple[int, se3.Matrix]]:
    """The same, each frame held against a map of Gaussian voxels (VGICP) of all frames before."""
    import small_gicp as peer  # noqa: PLC0415 - an extra

    voxels, T, motion = peer.GaussianVoxelMap(GAUSSIAN_VOXEL), np.eye(4), np.eye(4)
    told: list[tuple[int, se3.Matrix]] = []
    for k, frame in enumerate(found):
        cloud, _ = peer.preprocess_points(frame.points, downsampling_resolution=VOXEL)
        if k:
            if is_guided:
                motion = se3.inverse(found[k - 1].odometry) @ frame.odometry
            result = peer.align(voxels, cloud, init_T_target_source=T @ motion)
            x, y, _, _, _, yaw = se3.to_xyz_rpy(result.T_target_source)
            before, T = T, se3.from_xyz_rpy([x, y, 0.0, 0.0, 0.0, yaw])
            motion = se3.inverse(before) @ T
        voxels.insert(cloud, T)
        told.append((frame.stamp_ns, np.asarray(found[0].odometry @ T)))
    return told
