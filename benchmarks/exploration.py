# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where to look next on large maps that change around the robot: the CPU time of a decision.

    python benchmarks/exploration.py

Three quarters of a map are known, with boxes that cannot be driven over, and patches that have not
been seen. The robot is somewhere else each time, and the heights within 5 m of it have changed. One
explorer decides on all of these maps, one after the other, and so makes the planner's graph anew
only where they have changed; another one sees each of them for the first time. Both must choose the
same place.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.exploration.explorer import Explorer
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.plan import Pose2D

SIDES = (512, 2048)
CELL, CHANGED = 0.125, 5.0  # [m]
ROUNDS = 10


def measure() -> dict[str, float]:
    """95th percentiles [ms], and the ratio of the two."""
    decide(Explorer(Params()), HeightMap.from_metres(ground(SIDES[0])), Pose2D(9.0, 9.0, yaw=0.0))
    figures: dict[str, float] = {}
    for side in SIDES:
        rng = np.random.default_rng(1)
        metres, explorer = ground(side), Explorer(Params())
        kept, anew = [], []
        for n in range(ROUNDS + 1):
            x, y = (float(value) for value in rng.uniform(6.0, 0.7 * side * CELL, 2))
            part = tuple(
                slice(int((c - CHANGED) / CELL), int((c + CHANGED) / CELL)) for c in (y, x)
            )
            metres[part] += rng.normal(0.0, 0.01, metres[part].shape)
            height_map, robot = (
                HeightMap.from_metres(metres, resolution=CELL),
                Pose2D(x, y, yaw=0.0),
            )
            first, goal = decide(explorer, height_map, robot)
            second, other = decide(Explorer(Params()), height_map, robot)
            assert goal == other
            if n:  # there is nothing to be kept at first
                kept.append(first)
                anew.append(second)
        figures[f"{side}^2: decision p95 [ms]"] = float(np.percentile(kept, 95))
        figures[f"{side}^2: of a map seen for the first time p95 [ms]"] = float(
            np.percentile(anew, 95)
        )
        figures[f"{side}^2: first time / kept"] = float(np.median(anew) / np.median(kept))
    return figures


def decide(explorer: Explorer, height_map: HeightMap, robot: Pose2D) -> tuple[float, Pose2D | None]:
    """CPU time [ms] of a decision, and the place."""
    began = time.process_time()
    goal = explorer.choose(explorer.survey(height_map, robot)).goal
    return 1e3 * (time.process_time() - began), goal


def ground(side: int) -> NDArray[np.float64]:
    """Heights [m] of so many rows and columns."""
    rng = np.random.default_rng(0)
    metres = rng.normal(0.0, 0.01, (side, side))
    for _ in range(side * side // 3000):
        y, x = rng.integers(0, side - 12, 2)
        rows, columns = rng.integers(2, 12, 2)
        metres[y : y + rows, x : x + columns] += rng.choice([0.3, 1.5])
    for _ in range(side * side // 20000):
        y, x = rng.integers(0, side - 60, 2)
        rows, columns = rng.integers(10, 60, 2)
        metres[y : y + rows, x : x + columns] = np.nan
    metres[:, 3 * side // 4 :] = np.nan
    return metres


if __name__ == "__main__":
    for name, value in measure().items():
        print(f"{name:50} {value:10.1f}")
