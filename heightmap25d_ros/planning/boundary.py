# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The area that the robot may not leave: a polygon, and the cells within it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import POSITION_LIMIT, Geometry
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.search import CLOSED

_LEAST_AREA = 1e-6
"""Of a polygon [m^2]: one with less has its corners on a line."""


@dataclass(frozen=True, slots=True, eq=False)
class Boundary:
    """A simple polygon in the map; what crosses itself is inside by the even-odd rule.

    Attributes
    ----------
    corners : (N, 2) float64 [m], map
        x and y; empty: everything is inside.

    Examples
    --------
    >>> geometry = Geometry(resolution=1.0, origin=(0.0, 0.0), shape=(2, 3))
    >>> Boundary.of([(0, 0), (2, 0), (2, 1), (0, 1)]).mask(geometry)
    array([[ True,  True, False],
           [False, False, False]])
    """

    corners: NDArray[np.float64]

    @classmethod
    def of(cls, corners: ArrayLike) -> Boundary:
        """A boundary from its corners (N, 2), or from x, y, x, y...

        Raises
        ------
        InputError
            If they are no polygon.
        """
        numbers = np.asarray(corners, np.float64)
        if numbers.size == 0:
            return cls(np.empty((0, 2)))
        if numbers.size % 2:
            raise InputError(f"boundary: {numbers.size} numbers are not pairs of x and y")
        points = numbers.reshape(-1, 2)
        if not (np.abs(points) <= POSITION_LIMIT).all():  # nor NaN
            raise InputError("boundary: a corner is not a place")
        if len(points) < 3:
            raise InputError(f"boundary: {len(points)} corners are no polygon")
        x, y = (points - points[0]).T
        if abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0 < _LEAST_AREA:
            raise InputError("boundary: its corners are on a line")
        return cls(points)

    def mask(self, geometry: Geometry) -> NDArray[np.bool_]:
        """(rows, columns): cells whose centre is inside."""
        if not len(self.corners):
            return np.ones(geometry.shape, np.bool_)
        rows, columns = geometry.shape
        points = (self.corners - geometry.origin) / geometry.resolution
        crossings = np.zeros((rows, columns + 1), np.int32)
        for (x0, y0), (x1, y1) in zip(points, np.roll(points, -1, axis=0), strict=True):
            # Rows whose line of centres the edge crosses, and the first column right of it.
            low, high = (int(np.ceil(np.clip(y - 0.5, 0, rows))) for y in sorted((y0, y1)))
            row = np.arange(low, high)
            if not len(row):
                continue
            x = x0 + (row + 0.5 - y0) * (x1 - x0) / (y1 - y0)
            column = np.ceil(np.clip(x - 0.5, 0, columns)).astype(np.int64)
            np.add.at(crossings, (row, column), 1)
        return np.asarray(np.cumsum(crossings, axis=1)[:, :-1] % 2 == 1)

    def contains(self, x: float, y: float) -> bool:
        """Whether a point [m] is inside."""
        return bool(self.mask(Geometry(resolution=1.0, origin=(x - 0.5, y - 0.5), shape=(1, 1))))


def confined(graph: TransitionGraph, boundary: Boundary) -> TransitionGraph:
    """The graph without the cells outside of a boundary; a robot that is outside may come in."""
    if not len(boundary.corners):
        return graph
    inside = boundary.mask(graph.geometry)
    incoming = graph.incoming.copy()
    incoming[1:-1, 1:-1][~inside] = CLOSED
    return replace(graph, enterable=graph.enterable & inside, incoming=incoming)
