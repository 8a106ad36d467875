# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays for 3-D viewers: blocks of a map, and its frontier."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, HeightMap
from heightmap25d_ros.terrain.traversability import OCCUPIED, ObstacleMap
from heightmap25d_ros.viz import block_mesh, palette
from heightmap25d_ros.viz.map_figures import observed_part

MAX_BLOCKS = 40_000
"""Largest number of blocks; larger maps are shown with larger cells."""


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
