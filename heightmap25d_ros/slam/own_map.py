# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What has been mapped so far around a place, as the scan filter and searches use it.

Only the surroundings are joined, so that it costs the same however large the map has become.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import Area, Geometry, HeightMap
from heightmap25d_ros.localization.landmarks import Landmarks, landmarks_of
from heightmap25d_ros.localization.layers import NAMES, LayerMap
from heightmap25d_ros.slam.submaps import MappedCells, joined

STOREY = 1.6
"""What is farther above or below a robot is of another level [m]."""


def surroundings(
    submaps: Sequence[MappedCells],
    position: Array,
    reach: float,
    resolution: float,
    *,
    has_walls_of_levels: bool = False,
) -> tuple[HeightMap, LayerMap]:
    """Height map and localization layers of submaps within a square around a position.

    What is on a level above or below is left out: a deck is no wall to those below it, and the
    ground below is not the ground of those on it.

    Parameters
    ----------
    submaps : sequence of MappedCells
    position : (3,) float64 [m], map
        Of the robot.
    reach : float [m]
        Half the side of the square, cut to what the submaps cover.
    resolution : float [m]
    has_walls_of_levels : bool, optional
        Whether walls that were seen on levels above and below are in the layers all the same.
    """
    near = [s for s in submaps if (np.abs(_nearest(s, position) - position[:2]) <= reach).all()]
    bounds = [submap.bounds() for submap in near] or [(position[:2], position[:2])]
    low = np.maximum(np.min([b[0] for b in bounds], axis=0), position[:2] - reach)
    high = np.minimum(np.max([b[1] for b in bounds], axis=0), position[:2] + reach)
    ix, iy = np.floor(low / resolution).astype(int)
    columns, rows = np.maximum(np.ceil(high / resolution).astype(int) - (ix, iy), 1)
    level = float(np.floor(position[2] + 0.5))
    area = Area(int(iy), int(ix), int(rows), int(columns))
    z = float(position[2]) - level
    heights = z - STOREY, z + STOREY
    whole = joined(near, area, resolution, level, heights, has_walls_of_levels=has_walls_of_levels)
    height_map = HeightMap.from_metres(
        whole.top + np.float64(level), resolution=resolution, ground_zero=level,
        origin=(float(ix * resolution), float(iy * resolution)),
    )  # fmt: skip
    dense = dict(zip(NAMES, whole.layers, strict=True))
    dense["ground_height"] = np.where(
        dense["ground_count"] > 0, dense["ground_height"] + np.float32(level), np.float32(0.0)
    )
    return height_map, LayerMap(geometry=height_map.geometry, **dense)


def landmarks_around(
    submaps: Sequence[MappedCells], position: Array, reach: float, resolution: float
) -> Landmarks:
    """Walls and ground of submaps around a position, see `surroundings`.

    What is not known yet, also close to what is, does not speak against a scan. Walls that were not
    seen again, see `sightings`, are none that a scan can be held to. Those that were seen on other
    levels are: outer walls go through all of them, and tell a robot that leaves a ramp, along which
    nothing tells the way, how far it came.
    """
    height_map, layers = surroundings(
        submaps, position, reach, resolution, has_walls_of_levels=True
    )
    landmarks = landmarks_of(height_map, layers, is_growing=True)
    is_confirmed = _confirmed(submaps, landmarks.geometry)
    walls = landmarks.walls.copy()
    walls[landmarks.wall_of[(landmarks.wall_of >= 0) & ~is_confirmed], 2:8] = np.nan
    return replace(landmarks, walls=walls)


def _confirmed(submaps: Sequence[MappedCells], geometry: Geometry) -> NDArray[np.bool_]:
    """The cells (rows, columns) of a map that one of the submaps has seen again."""
    is_confirmed = np.zeros(geometry.shape, bool)
    for submap in submaps:
        xy = (submap.confirmed()[:, ::-1] + 0.5) * geometry.resolution
        moved = xy @ submap.T_map_submap[:2, :2].T + submap.T_map_submap[:2, 3]
        index = geometry.cell_at(moved)
        is_confirmed[tuple(index[geometry.contains(index)].T)] = True
    return is_confirmed


def _nearest(submap: MappedCells, position: Array) -> Array:
    """The place x, y (2,) [m] of the bounds of a submap that is nearest to a position."""
    low, high = submap.bounds()
    return np.clip(position[:2], low, high)
