# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Goals that an ideal planner reaches on a map: those that cells of admissible cost connect.

It measures the map, not the planner: a goal that the truth connects and the map does not is lost to
every planner.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.evaluation.truth import GoalPairs
from heightmap25d_ros.grid.height_map import Geometry
from heightmap25d_ros.terrain.traversability import INFLATED, ObstacleMap

_ALL_NEIGHBOURS = np.ones((3, 3), bool)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reachability:
    """Success of an ideal planner on a map.

    Attributes
    ----------
    observed_goals, found : int
        Reachable goals with an observed path, and those of them that the map connects.
    unreachable_goals, refused : int
        Goals that the robot cannot reach, and those of them that the map does not connect.
    """

    observed_goals: int
    found: int
    unreachable_goals: int
    refused: int

    def as_dict(self) -> dict[str, int]:
        """The figures by name."""
        return asdict(self)


def evaluate_goals(obstacle_map: ObstacleMap, pairs: GoalPairs) -> Reachability:
    """Count the goals that the known, uninflated cells of a map connect with their starts.

    A start or a goal is represented by the admissible cells among its own cell and the 8 around
    it: the cells of the map and the true ones may differ by one. Unknown cells are closed.
    """
    admissible = (obstacle_map.cost >= 0) & (obstacle_map.cost < INFLATED)
    parts, _ = ndimage.label(admissible, _ALL_NEIGHBOURS)
    found = np.array(
        [
            bool(
                _parts_at(parts, obstacle_map.geometry, start)
                & _parts_at(parts, obstacle_map.geometry, goal)
            )
            for start, goal in zip(pairs.start, pairs.goal, strict=True)
        ],
        dtype=bool,
    )
    return Reachability(
        observed_goals=int(pairs.observed.sum()),
        found=int((found & pairs.observed).sum()),
        unreachable_goals=int((~pairs.reachable).sum()),
        refused=int((~found & ~pairs.reachable).sum()),
    )


def _parts_at(parts: NDArray[np.int32], geometry: Geometry, point: NDArray[np.float64]) -> set[int]:
    iy, ix = geometry.cell_at(point)
    around = parts[max(iy - 1, 0) : max(iy + 2, 0), max(ix - 1, 0) : max(ix + 2, 0)]
    return set(np.unique(around).tolist()) - {0}
