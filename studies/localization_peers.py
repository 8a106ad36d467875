# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Others on the same drives: a particle filter as AMCL's, and odometry of scans.

A section of measure_localization.py. All of them get the level laser alone; ours gets what the
robot has. The particle filter has a map of 5 cm with what the laser hit from true poses of the
drive that ours is mapped in. KISS-ICP and small_gicp (requirements/peers.txt) know no map: their
poses are chained from the true first one, and what they lack is what drifts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation import trajectory_error
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.bag import Event
from heightmap25d_ros.pose_interpolation import interpolate

PARTICLES = 800
BEAMS = 60  # of a scan, that AMCL uses by default
CELL = 0.05  # [m] of the likelihood field
HIT_NOISE, HIT_SHARE = 0.1, 0.95  # [m] of a beam's end; of the beams that hit what is on the map
FAR = 1.0  # [m] from what was hit, and farther
TEMPER = 0.1  # power of the likelihood: beams of a scan err alike
TURN_NOISE, TRANSLATION_NOISE = 0.2, 0.2  # AMCL's alpha1..4, of turns and of distances
STEP, TURN = 0.1, 0.1  # [m], [rad] between two updates
START = 0.1, 0.1, 0.05  # deviations of the particles at the start
MOST_RANGE = 20.0  # [m]
SCAN = "/scan"


class LevelScan(NamedTuple):
    """The returns of a scan, as points of the robot, and its odometry."""

    stamp_ns: int
    points: np.ndarray
    odometry: se3.Matrix


def peers(label: str, mapped: Sequence[Event], drive: Sequence[Event], truth) -> Iterator[str]:
    """Rows of the errors of each on a drive; ``mapped``: the one that the map is of."""
    scans = list(level_scans(drive))
    scans = [s for s in scans if truth[0][0] <= s.stamp_ns <= truth[0][-1]]
    stamps = np.array([scan.stamp_ns for scan in scans])
    true = interpolate(*truth, stamps)
    field = LikelihoodField(mapped)
    methods: dict[str, Callable[[], list[np.ndarray]]] = {
        f"particle filter, {PARTICLES} particles": lambda: particle_filter(scans, field, true[0]),
        "KISS-ICP, odometry": lambda: kiss_icp(scans, true[0]),
        "small_gicp, odometry": lambda: gicp(scans, true[0]),
    }
    for name, run in methods.items():
        try:
            told = np.array(run())
        except ImportError:
            yield f"| {label}: {name} | not installed: pip install -r requirements/peers.txt |"
            continue
        error = trajectory_error.planar_errors(told, true)
        distance, turn = error[:, 0], np.abs(error[:, 2])
        yield (
            f"| {label}: {name} | {np.median(distance):.3f} m "
            f"| {np.percentile(distance, 95):.3f} m | {distance.max():.2f} m "
            f"| {np.percentile(turn, 95):.1f} deg |"
        )


def level_scans(events: Sequence[Event]) -> Iterator[LevelScan]:
    """The level laser's scans, each with the odometry before it."""
    mounts = [t for e in events if e.topic == "/tf_static" for t in e.message.transforms]
    odometry = None
    for event in events:
        if event.topic == "/odom":
            odometry = decode.odometry(event.message).T
        if event.topic != SCAN or odometry is None:
            continue
        (x,) = (t.transform.translation.x for t in mounts
                if t.child_frame_id == event.message.header.frame_id)  # fmt: skip
        stamp_ns = decode.stamp_ns(event.message.header)
        yield LevelScan(stamp_ns, returns_of(event.message, x), odometry)


def returns_of(scan, x_of_laser: float) -> np.ndarray:
    """(N, 2) [m] as points of the robot."""
    ranges = np.asarray(scan.ranges, np.float64)
    angles = scan.angle_min + np.arange(len(ranges)) * scan.angle_increment
    is_hit = np.isfinite(ranges) & (ranges > scan.range_min) & (ranges < MOST_RANGE)
    x, y = ranges * np.cos(angles) + x_of_laser, ranges * np.sin(angles)
    return np.column_stack([x, y])[is_hit]


class LikelihoodField:
    """Distance [m] from the nearest cell that the laser has hit twice, from true poses."""

    def __init__(self, events: Sequence[Event]) -> None:
        poses = [decode.odometry(e.message) for e in events if e.topic == "/ground_truth"]
        stamps, true = np.array([p.stamp_ns for p in poses]), np.array([p.T for p in poses])
        ends = [
            scan.points @ T[:2, :2].T + T[:2, 3]
            for scan in level_scans(events)
            if stamps[0] <= scan.stamp_ns <= stamps[-1]
            for T in interpolate(stamps, true, [scan.stamp_ns])
        ]
        places = np.concatenate(ends)
        self._corner = places.min(axis=0) - 2.0
        cells = np.floor((places - self._corner) / CELL).astype(int)
        hits = np.zeros(cells.max(axis=0) + int(2.0 / CELL), int)
        np.add.at(hits, tuple(cells.T), 1)
        self._distance = np.minimum(CELL * ndimage.distance_transform_edt(hits < 2), FAR)

    def distance(self, places: np.ndarray) -> np.ndarray:
        """Of places (..., 2) [m]."""
        cells = np.floor((places - self._corner) / CELL).astype(int)
        last = np.array(self._distance.shape) - 1
        is_inside = ((cells >= 0) & (cells <= last)).all(axis=-1)
        return np.where(is_inside, self._distance[tuple(np.moveaxis(cells.clip(0, last), -1, 0))],
                        FAR)  # fmt: skip


def particle_filter(
    scans: Sequence[LevelScan], field: LikelihoodField, first: se3.Matrix
) -> list[se3.Matrix]:
    """As AMCL: its motion model of wheels, its likelihood field, systematic resampling."""
    rng = np.random.default_rng(1)
    x, y, _, _, _, yaw = se3.to_xyz_rpy(first)
    particles = rng.normal((x, y, yaw), START, (PARTICLES, 3))
    told, used = [], scans[0].odometry
    mean = planar(x, y, yaw)
    for scan in scans:
        dx, dy, _, _, _, turn = se3.to_xyz_rpy(se3.inverse(used) @ scan.odometry)
        distance = float(np.hypot(dx, dy))
        if distance >= STEP or abs(turn) >= TURN:
            move(particles, float(dx), float(dy), float(turn), rng)
            weights = likelihood(particles, scan.points[:: 1 + len(scan.points) // BEAMS], field)
            x, y = weights @ particles[:, :2]
            yaw = np.arctan2(weights @ np.sin(particles[:, 2]), weights @ np.cos(particles[:, 2]))
            mean, used = planar(x, y, yaw), scan.odometry
            if 1.0 / np.square(weights).sum() < 0.5 * PARTICLES:
                steps = (rng.random() + np.arange(PARTICLES)) / PARTICLES
                particles = particles[
                    np.searchsorted(np.cumsum(weights), steps).clip(0, PARTICLES - 1)
                ]
        told.append(mean @ se3.inverse(used) @ scan.odometry)
    return told


def move(particles: np.ndarray, dx: float, dy: float, turn: float, rng) -> None:
    """Move particles by odometry, each with errors of its own."""
    count, distance = len(particles), np.hypot(dx, dy)
    times = 1.0 + TRANSLATION_NOISE * rng.normal(size=count)
    aside = 0.1 * TRANSLATION_NOISE * distance * rng.normal(size=count)
    cos, sin = np.cos(particles[:, 2]), np.sin(particles[:, 2])
    forth, left = times * dx, times * dy + aside
    particles[:, 0] += cos * forth - sin * left
    particles[:, 1] += sin * forth + cos * left
    noise = TURN_NOISE * (abs(turn) + 0.3 * distance)
    particles[:, 2] += turn + noise * rng.normal(size=count)


def likelihood(particles: np.ndarray, points: np.ndarray, field: LikelihoodField) -> np.ndarray:
    """Weights (N,) of particles by where the ends (M, 2) of beams are."""
    cos, sin = np.cos(particles[:, 2, None]), np.sin(particles[:, 2, None])
    x = particles[:, 0, None] + cos * points[:, 0] - sin * points[:, 1]
    y = particles[:, 1, None] + sin * points[:, 0] + cos * points[:, 1]
    near = np.exp(-0.5 * np.square(field.distance(np.stack([x, y], axis=-1)) / HIT_NOISE))
    logarithm = TEMPER * np.log(HIT_SHARE * near + (1.0 - HIT_SHARE)).sum(axis=1)
    weights = np.exp(logarithm - logarithm.max())
    return weights / weights.sum()


def planar(x: float, y: float, yaw: float) -> se3.Matrix:
    return se3.from_xyz_rpy([x, y, 0.0, 0.0, 0.0, yaw])


def kiss_icp(scans: Sequence[LevelScan], first: se3.Matrix) -> list[se3.Matrix]:
    """KISS-ICP with its defaults, but for voxels that fit rooms."""
    from kiss_icp.config import KISSConfig  # noqa: PLC0415
    from kiss_icp.kiss_icp import KissICP  # noqa: PLC0415

    config = KISSConfig()
    config.data.max_range, config.data.min_range, config.data.deskew = MOST_RANGE, 0.1, False
    config.mapping.voxel_size = 0.2
    odometry = KissICP(config)
    told = []
    for scan in scans:
        points = in_space(scan.points)
        odometry.register_frame(points, np.zeros(len(points)))
        told.append(first @ odometry.last_pose)
    return told


def gicp(scans: Sequence[LevelScan], first: se3.Matrix) -> list[se3.Matrix]:
    """small_gicp, each scan to the one before, from the motion before."""
    import small_gicp  # noqa: PLC0415 - an extra

    told, motion, before = [first], np.eye(4), in_space(scans[0].points)
    for scan in scans[1:]:
        points = in_space(scan.points)
        found = small_gicp.align(
            before, points, init_T_target_source=motion, registration_type="ICP",
            downsampling_resolution=CELL, max_correspondence_distance=0.5,
        )  # fmt: skip
        x, y, _, _, _, yaw = se3.to_xyz_rpy(found.T_target_source)
        motion, before = planar(float(x), float(y), float(yaw)), points
        told.append(told[-1] @ motion)
    return told


def in_space(points: np.ndarray) -> np.ndarray:
    """(3 N, 3) float64 of points (N, 2), at three heights: a plane alone leaves three ways open."""
    heights = np.repeat([-1.0, 0.0, 1.0], len(points))
    return np.column_stack([np.tile(points, (3, 1)), heights])
