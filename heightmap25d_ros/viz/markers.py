# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays for 3-D viewers: blocks of a map, its frontier, and the planner's field as arrows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, HeightMap
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.search import UNREACHABLE, CostToGo
from heightmap25d_ros.terrain.steps import NEIGHBOURS
from heightmap25d_ros.terrain.traversability import OCCUPIED, ObstacleMap
from heightmap25d_ros.viz import block_mesh, palette
from heightmap25d_ros.viz.map_figures import observed_part

MAX_BLOCKS = 40_000
"""Largest number of blocks; larger maps are shown with larger cells."""

MAX_ARROWS = 1500
"""Largest number of arrows; larger fields are shown by every second, third, ... cell."""

ARROW_SPACING = 0.5
"""Least distance between arrows [m]."""


def blocks(height_map: HeightMap) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Faces of the known cells as blocks, with those above as slabs, and their colours by height.

    Returns
    -------
    corners : (N, 4, 3) float64 [m], map
    colours : (N, 3) float64, 0 .. 1
        Red, green, blue.
    """
    shown = block_mesh.coarser(observed_part(height_map), MAX_BLOCKS)
    metres = shown.metres
    tops = shown.upper.top * HEIGHT_RESOLUTION + shown.geometry.ground_zero
    norm = palette.height_norm(np.concatenate([metres.ravel(), tops]))
    parts = block_mesh.all_faces(shown.geometry, metres), block_mesh.slabs(shown)
    return (
        np.concatenate([part.corners for part in parts]),
        np.concatenate([block_mesh.colours(part, norm) for part in parts]),
    )


def frontier(height_map: HeightMap, obstacles: ObstacleMap) -> HeightMap:
    """The map reduced to its frontier: free cells with an unknown neighbour.

    Parameters
    ----------
    height_map : HeightMap
    obstacles : ObstacleMap
        Of that map.
    """
    known = np.pad(height_map.known, 1)
    beside_unknown = ndimage.minimum_filter(known, size=3)[1:-1, 1:-1] == 0
    is_frontier = height_map.known & beside_unknown & (obstacles.occupancy != OCCUPIED)
    return replace(
        height_map, probability=np.where(is_frontier, height_map.probability, np.uint16(0))
    )


def field_arrows(graph: TransitionGraph, cost_to_go: CostToGo) -> NDArray[np.float64]:
    """Poses (N, 4, 4) [m], map, of cells, in the direction of their cheapest path.

    Parameters
    ----------
    graph : TransitionGraph
    cost_to_go : CostToGo
        In that graph.
    """
    reached = cost_to_go.dense() != UNREACHABLE
    every = max(1, round(ARROW_SPACING / graph.geometry.resolution))
    while reached[::every, ::every].sum() > MAX_ARROWS:
        every += 1
    cells = np.argwhere(reached[::every, ::every]) * every
    steps = np.array([cost_to_go.direction((int(iy), int(ix))) for iy, ix in cells], np.int64)
    cells, steps = cells[steps >= 0], steps[steps >= 0]  # the goal has no direction
    dy, dx = np.array(NEIGHBOURS)[steps].T
    poses = np.zeros((len(cells), 6))
    poses[:, :2] = graph.geometry.cell_center(cells)
    poses[:, 2] = graph.height[tuple(cells.T)] + graph.geometry.ground_zero
    poses[:, 5] = np.arctan2(dy, dx)
    return se3.from_xyz_rpy(poses)
