# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A 3-D evidence grid, which the paper compares with: OctoMap's, fed with the mapper's beams."""

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import (
    HEIGHT_RESOLUTION,
    PROBABILITY_SCALE,
    Geometry,
    HeightMap,
)
from heightmap25d_ros.mapping.sensor_model import Beams

try:
    import pyoctomap
except ImportError:
    pyoctomap = None

OCCUPIED = 0.5


class EvidenceGrid:
    """Cubes of one size, OctoMap's sensor model and clamping.

    Parameters
    ----------
    resolution : float [m]
    lowest : float [m]
        A height at which a layer of cubes begins.

    Raises
    ------
    InputError
        If pyoctomap is missing.
    """

    def __init__(self, resolution: float, lowest: float = 0.0) -> None:
        if pyoctomap is None:
            raise InputError("pyoctomap is missing: pip install -r requirements/bench.txt")
        self.resolution = resolution
        self.lowest = lowest
        self.tree = pyoctomap.OcTree(resolution)
        self.tree.setOccupancyThres(OCCUPIED)

    def insert(self, beams: Beams) -> None:
        """Merge the returns of one scan, all from where the laser was in the middle of it."""
        if beams.is_hit.any():
            shift = np.array([0.0, 0.0, self.lowest])
            origin = beams.origins[len(beams.origins) // 2]
            self.tree.insertPointCloud(beams.ends[beams.is_hit] - shift, origin - shift)

    def occupied(self, geometry: Geometry) -> NDArray[np.int64]:
        """(N, 3) int64: column, row and layer of the occupied cubes over a map."""
        corner = np.array([*geometry.origin, 0.0])
        found = [np.empty((0, 3), np.int64)]
        for leaf in self.tree.begin_leafs():
            if self.tree.isNodeOccupied(leaf):  # eight equal cubes are stored as a larger one
                side = round(leaf.getSize() / self.resolution)
                low = (np.array(leaf.getCoordinate()) - corner) / self.resolution - side / 2
                inside = np.indices((side, side, side)).reshape(3, -1).T
                found.append(np.rint(low).astype(np.int64) + inside)
        cubes = np.concatenate(found)
        return cubes[geometry.contains(cubes[:, 1::-1])]

    def height_map(self, geometry: Geometry) -> HeightMap:
        """The centre of each column's highest occupied cube, as the paper takes heights from it.

        Rounded to a centimetre, which is never what makes a step higher than 0.10 m.
        """
        column, row, layer = self.occupied(geometry).T
        none = np.iinfo(np.int64).min
        top = np.full(geometry.shape, none)
        np.maximum.at(top, (row, column), layer)
        known = top != none
        metres = self.lowest + (np.where(known, top, 0) + 0.5) * self.resolution
        return HeightMap(
            geometry=geometry,
            height=np.floor(metres / HEIGHT_RESOLUTION + 0.5).astype(np.int16),
            probability=np.where(known, np.uint16(PROBABILITY_SCALE), np.uint16(0)),
            probability_threshold=OCCUPIED,
        )
