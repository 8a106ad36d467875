# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How fast heights become obstacles: medians of interleaved runs over 4000 x 4000 cells.

    python benchmarks/conversion.py

- ``step_obstacles`` beside scipy.ndimage's maximum and minimum filters of size 3, which the same
  obstacles can be made from, and beside the least that any conversion has to do: one pass over
  the heights that writes one byte a cell.
- ``convert``, which adds transitions, planes under the footprint, cost and inflation, and the
  incremental conversion of a block of 240 x 240 cells that changed.
"""

from __future__ import annotations

import functools
import statistics
import time
from collections.abc import Callable

import numpy as np
from numba import njit
from scipy import ndimage

from heightmap25d_ros.grid.height_grid import TILE, HeightGrid
from heightmap25d_ros.grid.height_map import Area, HeightMap
from heightmap25d_ros.params.sections import GridParams, MapperParams, TraversabilityParams
from heightmap25d_ros.terrain.obstacle_grid import ObstacleGrid
from heightmap25d_ros.terrain.steps import step_obstacles
from heightmap25d_ros.terrain.traversability import to_obstacle_map

SIDE = 4000
BLOCK = 240
ROUNDS = 7
MAX_STEP_CM = 10
THRESHOLD = MapperParams().probability_threshold


def measure(rounds: int = ROUNDS) -> dict[str, float]:
    """Medians in milliseconds, and their ratios."""
    grid, height_map = _terrain()
    heights, known = height_map.height, height_map.known
    params = TraversabilityParams()
    obstacles = ObstacleGrid(grid.geometry, params)
    obstacles.update(grid, THRESHOLD)

    times = _interleaved(
        {
            "one_pass": lambda: _one_pass(heights),
            "step_obstacles": lambda: step_obstacles(heights, known, MAX_STEP_CM),
            "scipy_max_min": lambda: (
                ndimage.maximum_filter(heights, 3),
                ndimage.minimum_filter(heights, 3),
            ),
            "convert": lambda: to_obstacle_map(height_map, params),
            "update_block": functools.partial(_update_block, grid, obstacles),
        },
        rounds,
    )
    return {
        **{f"{name}_ms": milliseconds for name, milliseconds in times.items()},
        "scipy_max_min_per_step_obstacles": times["scipy_max_min"] / times["step_obstacles"],
        "step_obstacles_per_one_pass": times["step_obstacles"] / times["one_pass"],
        "convert_per_update_block": times["convert"] / times["update_block"],
    }


def _terrain() -> tuple[HeightGrid, HeightMap]:
    """Hills, walls and kerbs with noise of 1 cm, one cell in ten unknown."""
    rng = np.random.default_rng(25)
    y, x = np.indices((SIDE, SIDE), np.float32)
    height = 60.0 * np.sin(x / 70.0) * np.cos(y / 90.0) + rng.normal(0.0, 1.0, x.shape)
    height += 200.0 * ((x % 160 < 2) & (y % 100 < 70)) + 15.0 * (y % 120 > 90)
    probability = np.where(rng.random(x.shape) < 0.9, 60000, 1500).astype(np.uint16)
    grid = HeightGrid(GridParams(extent=2.0 * SIDE * 0.125))
    corner = (grid.area.rows - SIDE) // (2 * TILE) * TILE
    grid.write(
        HeightMap(
            geometry=grid.geometry.part(Area(corner, corner, SIDE, SIDE)),
            height=height.astype(np.int16),
            probability=probability,
            probability_threshold=THRESHOLD,
        )
    )
    return grid, grid.read(THRESHOLD)


def _update_block(grid: HeightGrid, obstacles: ObstacleGrid) -> None:
    first, count = grid.tile_changed.shape[0] // 2 - 3, BLOCK // TILE
    grid.mark_changed(np.s_[first : first + count, first : first + count])
    obstacles.update(grid, THRESHOLD)


def _one_pass(heights: np.ndarray) -> np.ndarray:
    result = np.empty(heights.shape, np.int8)
    _threshold(heights, result)
    return result


@njit(cache=True)
def _threshold(heights, result):
    for y in range(heights.shape[0]):
        for x in range(heights.shape[1]):
            result[y, x] = 100 if heights[y, x] > MAX_STEP_CM else 0


def _interleaved(runs: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Median milliseconds of each; the first round, which compiles, does not count."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds + 1):
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            times[name].append(1e3 * (time.perf_counter() - start))
    return {name: statistics.median(values[1:]) for name, values in times.items()}


if __name__ == "__main__":
    for name, value in measure().items():
        print(f"{name:<34} {value:>10.2f}")
