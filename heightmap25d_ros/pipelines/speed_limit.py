# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How fast a robot should drive over the ground under the path ahead."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, Area, HeightMap
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.terrain.gap_filling import fill_gaps
from heightmap25d_ros.terrain.slices import SurfaceStack
from heightmap25d_ros.terrain.traversability import analyse_ground, covering_disc


def ahead_of(poses: NDArray[np.float64], first: int, distance: float) -> NDArray[np.float64]:
    """The poses (N, 4, 4) of a path from one of them on, up to a distance [m] along it."""
    rest = poses[first:]
    steps = np.hypot(*np.diff(rest[:, :2, 3], axis=0).T)
    return rest[: 1 + int(np.searchsorted(np.cumsum(steps), distance, side="right"))]


def speed_share(poses: NDArray[np.float64], height_map: HeightMap, params: Params) -> float:
    """The share of its full speed at which the robot should drive along poses (N, 4, 4).

    1 on ground that is nowhere steeper than ``planning.gentle_slope`` nor rougher than
    ``planning.gentle_roughness``. From there on it falls linearly to ``planning.least_speed`` at
    ``traversability.max_slope`` and ``max_roughness``. On unknown ground it is ``least_speed``.
    """
    limits, terrain = params.planning, params.traversability
    geometry = height_map.geometry
    cells = geometry.cell_at(poses[:, :2, 3])
    whole = Area(0, 0, *geometry.shape)
    (low_y, low_x), (rows, columns) = cells.min(axis=0), np.ptp(cells, axis=0) + 1
    reach = 2 * covering_disc(terrain, geometry.resolution).radius + 2
    area = Area(int(low_y), int(low_x), int(rows), int(columns)).grown(reach).within(whole)
    window = fill_gaps(_level(height_map.part(area), poses[0], params), params.planner.max_gap)
    inside = cells - (area.iy, area.ix)
    is_inside = ((inside >= 0) & (inside < area.shape)).all(axis=1)
    iy, ix = inside[is_inside].T
    if not (is_inside.all() and window.known[iy, ix].all()):
        return limits.least_speed
    ground = analyse_ground(window, terrain)
    tangents = ground.gradient[:, iy, ix] * (HEIGHT_RESOLUTION / geometry.resolution)
    slope = math.atan(float(np.hypot(*tangents).max()))
    roughness = float(ground.roughness[iy, ix].max()) * HEIGHT_RESOLUTION
    worst = max(
        _between(slope, limits.gentle_slope, terrain.max_slope),
        _between(roughness, limits.gentle_roughness, terrain.max_roughness),
    )
    return 1.0 - (1.0 - limits.least_speed) * worst


def _level(height_map: HeightMap, pose: se3.Matrix, params: Params) -> HeightMap:
    """The level of a map on which a pose (4, 4) is."""
    if not len(height_map.upper):
        return height_map
    stack = SurfaceStack(height_map, params.levels, params.traversability)
    surface = stack.surface_at(*map(float, pose[:3, 3]))
    return height_map if surface is None else stack.followed(surface).height_map


def _between(value: float, low: float, high: float) -> float:
    """0 up to ``low``, 1 from ``high`` on, linear between them."""
    if value <= low:
        return 0.0
    return 1.0 if value >= high else (value - low) / (high - low)
