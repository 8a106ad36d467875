# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ground and walls of which everything is known, seen by returns that are simply sampled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.height_map import Area, HeightMap
from heightmap25d_ros.localization.landmarks import Landmarks, landmarks_of
from heightmap25d_ros.localization.layers import NAMES, LayerMap, LocalizationLayers
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import GridParams, MapperParams, SensorParams

Wall = tuple[tuple[float, float], tuple[float, float]]
CORRIDOR: tuple[Wall, ...] = (((-6.0, -1.2), (6.0, -1.2)), ((-6.0, 1.3), (6.0, 1.3)))
ROOM: tuple[Wall, ...] = (*CORRIDOR, ((-3.1, -1.2), (-3.1, 1.3)), ((3.4, -1.2), (3.4, 1.3)))


def ground_returns(rng, count, half=(6.0, 1.2), slope=(0.0, 0.0), noise=0.0):
    """(N, 3) on a plane z = slope . (x, y)."""
    xy = rng.uniform(-1.0, 1.0, (count, 2)) * half
    return np.column_stack([xy, xy @ slope + rng.normal(0.0, noise, count)])


def wall_returns(rng, count, walls: Sequence[Wall] = CORRIDOR, noise=0.0):
    """(N, 3) on upright walls, 0.2 to 0.8 m above z = 0; noise across them."""
    chosen = rng.integers(len(walls), size=count)
    begin, end = np.moveaxis(np.array(walls)[chosen], 1, 0)
    along = (end - begin) / np.linalg.norm(end - begin, axis=1)[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0]]) * rng.normal(0.0, noise, count)[:, None]
    xy = begin + (end - begin) * rng.random(count)[:, None] + across
    return np.column_stack([xy, rng.uniform(0.2, 0.8, count)])


def beams_to(ends, above=0.4):
    """Beams straight down to returns."""
    count = len(ends)
    return Beams(
        origins=ends + (0.0, 0.0, above), ends=ends,
        is_hit=np.ones(count, bool), is_lone=np.zeros(count, bool),
    )  # fmt: skip


def mapped(*returns) -> tuple[HeightMap, LayerMap]:
    """Height map and layers of returns (N, 3), those of each array in turn."""
    grid = HeightGrid(GridParams(extent=32.0))
    mapper, layers = Mapper(grid, SensorParams(), MapperParams()), LocalizationLayers(grid)
    for ends in returns:
        mapper.integrate(beams_to(ends))
        layers.integrate(beams_to(ends))
    height_map = grid.read(0.5)
    return height_map, layers.read(grid.area_of(height_map.geometry))


def tightly_cropped(height_map: HeightMap, layers: LayerMap) -> tuple[HeightMap, LayerMap]:
    """The same map without any rows and columns around what is known."""
    rows, columns = np.nonzero(height_map.known)
    area = Area(
        int(rows.min()), int(columns.min()),
        int(np.ptp(rows)) + 1, int(np.ptp(columns)) + 1,
    )  # fmt: skip
    part = height_map.part(area)
    here = area.slices(Area(0, 0, *height_map.geometry.shape))
    return part, LayerMap(
        geometry=part.geometry, **{name: getattr(layers, name)[here] for name in NAMES}
    )


def landmarks_seen_by(*returns) -> Landmarks:
    return landmarks_of(*mapped(*returns))
