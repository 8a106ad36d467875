# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Goals that an ideal planner reaches on a map: those that cells of admissible cost connect.

It measures the map, not the planner: a goal that the truth connects and the map does not is lost to
every planner.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from heightmap25d_ros.evaluation.truth import GoalPairs
from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.params.sections import LevelsParams, TraversabilityParams
from heightmap25d_ros.terrain.slices import SurfaceStack
from heightmap25d_ros.terrain.traversability import INFLATED, ObstacleMap, to_obstacle_map

_SAME_LEVEL = 0.35
"""How far a surface may be from the z of a start or a goal on it [m]."""

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
                _parts_at(parts, obstacle_map.geometry, start[:2])
                & _parts_at(parts, obstacle_map.geometry, goal[:2])
            )
            for start, goal in zip(pairs.start, pairs.goal, strict=True)
        ],
        dtype=bool,
    )
    return counted(pairs, found)


def counted(pairs: GoalPairs, found: NDArray[np.bool_]) -> Reachability:
    """The counts of pairs of which some (N,) were found."""
    return Reachability(
        observed_goals=int(pairs.observed.sum()),
        found=int((found & pairs.observed).sum()),
        unreachable_goals=int((~pairs.reachable).sum()),
        refused=int((~found & ~pairs.reachable).sum()),
    )


def evaluate_goals_on_levels(
    height_map: HeightMap, levels: LevelsParams, terrain: TraversabilityParams, pairs: GoalPairs
) -> Reachability:
    """`evaluate_goals` over all levels of a map: starts and goals are on those of their z."""
    stack = SurfaceStack(height_map, levels, terrain)
    slices = stack.slices(stack.footprint_cells)
    costs = [to_obstacle_map(found.height_map, terrain).cost for found in slices]
    admissible = np.array([(cost >= 0) & (cost < INFLATED) for cost in costs])
    parts = np.zeros(admissible.shape, np.int64)
    for number, is_open in enumerate(admissible):
        found, _ = ndimage.label(is_open, _ALL_NEIGHBOURS)
        parts[number] = np.where(found > 0, found + parts.max(), 0)
    linked = [
        (parts[i][same], parts[j][same])
        for i, j in combinations(range(len(slices)), 2)
        if (same := (slices[i].layer == slices[j].layer) & admissible[i] & admissible[j]).any()
    ]
    here, there = np.hstack([np.zeros((2, 0), np.int64), *map(np.array, linked)])
    count = int(parts.max()) + 1
    graph = coo_array((np.ones(len(here)), (here, there)), (count, count))
    _, joined = connected_components(graph, directed=False)
    heights = np.array([found.height_map.metres for found in slices])

    def parts_at(place: NDArray[np.float64]) -> set[int]:
        iy, ix = height_map.geometry.cell_at(place[:2])
        around = np.s_[:, max(iy - 1, 0) : max(iy + 2, 0), max(ix - 1, 0) : max(ix + 2, 0)]
        near = (np.abs(heights[around] - place[2]) < _SAME_LEVEL) & (parts[around] > 0)
        return set(joined[parts[around][near]].tolist())

    return counted(
        pairs,
        np.array(
            [bool(parts_at(s) & parts_at(g)) for s, g in zip(pairs.start, pairs.goal, strict=True)],
            dtype=bool,
        ),
    )


def _parts_at(parts: NDArray[np.int32], geometry: Geometry, point: NDArray[np.float64]) -> set[int]:
    iy, ix = geometry.cell_at(point)
    around = parts[max(iy - 1, 0) : max(iy + 2, 0), max(ix - 1, 0) : max(ix + 2, 0)]
    return set(np.unique(around).tolist()) - {0}
