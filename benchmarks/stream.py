# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The stream of scans that the mapping benchmarks share: a drive over an analytic terrain.

Hills that fade into flat ground, with boxes and walls on them. A robot drives a figure of eight
of about 60 m and carries two lasers of 361 beams, one level and one pitched down, whose scans
alternate. Everything follows from one seed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from heightmap25d_ros import se3
from heightmap25d_ros.mapping import sensor_model
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import Params

SEED = 25
SCANS = 3000
BEAMS = 361
RANGE_NOISE = 0.01  # [m]
LASER_RANGE = 30.0  # [m]
MOUNTS = se3.from_xyz_rpy(  # x, y, z, roll, pitch, yaw in base_link
    [[0.30, 0.0, 0.40, 0.0, 0.0, 0.0], [0.28, 0.0, 0.60, 0.0, np.radians(7.0), 0.0]]
)
_STEEPEST = 0.4  # the hills' slope is nowhere above this
_CLOSE = 1e-4  # [m] above the ground, at which a ray has arrived


@dataclass(frozen=True, slots=True)
class Recorded:
    """A scan with its poses (1, 4, 4): what `sensor.beams` takes."""

    scan: Scan
    T_map_base: se3.Matrix
    T_base_sensor: se3.Matrix


def record(count: int = SCANS) -> list[Recorded]:
    """The first scans of the drive."""
    rng = np.random.default_rng(SEED)
    boxes = _boxes(rng)
    poses = _drive(rng)[:count]
    angles = np.linspace(-np.pi / 2, np.pi / 2, BEAMS)
    fan = np.stack([np.cos(angles), np.sin(angles), np.zeros(BEAMS)], axis=1)
    recorded = []
    for index, T_map_base in enumerate(poses):
        mount = MOUNTS[index % len(MOUNTS)]
        T_map_sensor = T_map_base @ mount
        ranges = _cast(T_map_sensor[:3, 3].copy(), fan @ T_map_sensor[:3, :3].T, boxes)
        ranges += rng.normal(0.0, RANGE_NOISE, BEAMS)
        scan = Scan(
            stamp_ns=index * 10**9 // 75,
            frame_id="laser",
            angle_min=float(angles[0]),
            angle_increment=float(angles[1] - angles[0]),
            time_increment=0.0,
            range_min=0.05,
            range_max=LASER_RANGE,
            ranges=ranges.astype(np.float32),
        )
        recorded.append(Recorded(scan, T_map_base[None], mount[None]))
    return recorded


def beams(recorded: list[Recorded]) -> list[Beams]:
    """What the mapper takes of each scan, with default parameters."""
    params = Params()
    return [
        sensor_model.beams(
            r.scan, r.T_map_base, r.T_base_sensor, params.sensor, params.mapper.lone_return
        )
        for r in recorded
    ]


def describe(scans: list[Beams]) -> dict[str, float]:
    """Facts about a stream."""
    lengths = np.concatenate([np.linalg.norm(s.ends - s.origins, axis=1) for s in scans])
    is_hit = np.concatenate([s.is_hit for s in scans])
    return {
        "scans": len(scans),
        "beams": len(lengths),
        "share that hits": round(float(is_hit.mean()), 3),
        "mean length [m]": round(float(lengths.mean()), 2),
    }


def _drive(rng: np.random.Generator) -> se3.Matrix:
    """Poses (SCANS, 4, 4) on the ground, its slope and some rocking in roll and pitch."""
    phase = np.linspace(0.0, 2.0 * np.pi, SCANS, endpoint=False)
    x, y = 12.0 * np.sin(phase), 8.0 * np.sin(2.0 * phase)
    yaw = np.arctan2(16.0 * np.cos(2.0 * phase), 12.0 * np.cos(phase))
    z, slope_x, slope_y = _ground_and_slope(x, y)
    along = slope_x * np.cos(yaw) + slope_y * np.sin(yaw)
    across = slope_y * np.cos(yaw) - slope_x * np.sin(yaw)
    rocking = np.radians(0.5) * np.sin(40.0 * phase + rng.uniform(0.0, 6.0, (2, 1)))
    roll, pitch = np.arctan(across) + rocking[0], -np.arctan(along) + rocking[1]
    return se3.from_xyz_rpy(np.stack([x, y, z, roll, pitch, yaw], axis=1))


def _ground_and_slope(x, y):
    height = np.vectorize(_ground)
    step = 1e-4
    z = height(x, y)
    return z, (height(x + step, y) - z) / step, (height(x, y + step) - z) / step


def _boxes(rng: np.random.Generator):
    """(K, 5): x and y of two corners, top [m]: boxes, and walls of 0.2 m by up to 12 m."""
    count = 120
    center = rng.uniform(-40.0, 40.0, (count, 2))
    size = rng.uniform(0.3, 3.0, (count, 2))
    walls = rng.random(count) < 0.4
    size[walls, 0] = 0.2
    size[walls, 1] = rng.uniform(3.0, 12.0, walls.sum())
    turned = rng.random(count) < 0.5
    size[turned] = size[turned, ::-1]
    height = np.where(walls, rng.uniform(1.0, 3.0, count), rng.uniform(0.1, 1.5, count))
    top = height + np.vectorize(_ground)(center[:, 0], center[:, 1])
    boxes = np.concatenate([center - size / 2, center + size / 2, top[:, None]], axis=1)
    path = _drive(np.random.default_rng(0))[:, :2, 3]
    outside = np.maximum(boxes[:, None, :2] - path, path - boxes[:, None, 2:4]).clip(0.0)
    return boxes[np.linalg.norm(outside, axis=2).min(axis=1) > 1.0]


@njit(cache=True)
def _ground(x, y):
    """Height [m] of the hills, flat to the left of the middle."""
    share = min(max(0.5 + x / 20.0, 0.0), 1.0)
    hills = np.sin(x / 6.0) * np.cos(y / 7.0) + 0.25 * np.sin(x / 2.5 + y / 3.0)
    return 0.9 * share * share * (3.0 - 2.0 * share) * hills


@njit(cache=True)
def _cast(origin, directions, boxes):
    """Ranges (N,) [m] of rays (N, 3) to the first surface; +inf beyond the laser's range."""
    ranges = np.empty(len(directions))
    for ray in range(len(directions)):
        dx, dy, dz = directions[ray]
        limit = LASER_RANGE
        for box in range(len(boxes)):
            limit = min(limit, _to_box(origin, dx, dy, dz, boxes, box))
        closing = _STEEPEST * np.hypot(dx, dy) - dz
        reach = 0.0
        while reach < limit:
            x, y, z = origin[0] + reach * dx, origin[1] + reach * dy, origin[2] + reach * dz
            above = z - _ground(x, y)
            if above < _CLOSE:
                break
            reach = reach + above / closing if closing > 0.0 else LASER_RANGE
        reach = min(reach, limit)
        ranges[ray] = reach if reach < LASER_RANGE else np.inf
    return ranges


@njit(cache=True)
def _to_box(origin, dx, dy, dz, boxes, box):
    """Range [m] along a ray to a box, which is complete from below the ground; +inf: none."""
    entered, left = 0.0, LASER_RANGE
    for axis, slope in ((0, dx), (1, dy)):
        low, high = boxes[box, axis] - origin[axis], boxes[box, axis + 2] - origin[axis]
        if abs(slope) < 1e-12:
            if low > 0.0 or high < 0.0:
                return np.inf
            continue
        near, far = low / slope, high / slope
        entered, left = max(entered, min(near, far)), min(left, max(near, far))
    above = origin[2] - boxes[box, 4]
    if above + entered * dz > 0.0:  # enters over the box
        if dz >= 0.0:
            return np.inf
        entered = max(entered, -above / dz)
    return entered if entered <= left else np.inf
