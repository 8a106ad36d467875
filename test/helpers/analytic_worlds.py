# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Analytic worlds: the truth that the tests measure against.

A world is a union of convex solids with an upright rectangular footprint and a planar top:
planes, boxes and ramps. Where a ray meets it, and how high it is at (x, y), follow in closed
form; nothing here shares code with the package. Frame: map, z up, ground zero at z = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Solid:
    """All points over a rectangle, from ``bottom`` up to ``z = a + b x + c y``.

    Attributes
    ----------
    x, y : (low, high) [m]
        The footprint; may be infinite.
    top : (a, b, c)
        [m], and slopes along x and y.
    bottom : float [m]
        Minus infinity: complete from the ground up.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    top: tuple[float, float, float]
    bottom: float = -inf

    def top_at(self, x: Array, y: Array) -> Array:
        """Height [m] of the plane of the top, wherever the footprint ends."""
        a, b, c = self.top
        return np.asarray(a + b * x + c * y)

    def half_spaces(self) -> tuple[Array, Array]:
        """Normals (6, 3), not normalised, and offsets (6,): inside is ``n . p <= d``."""
        a, b, c = self.top
        normals = np.array(
            [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [-b, -c, 1], [0, 0, -1]], np.float64
        )
        offsets = np.array([self.x[1], -self.x[0], self.y[1], -self.y[0], a, -self.bottom])
        return normals, offsets


def plane(z: float = 0.0, slope: tuple[float, float] = (0.0, 0.0)) -> Solid:
    """The ground everywhere: ``z + slope . (x, y)``."""
    return Solid((-inf, inf), (-inf, inf), (z, *slope))


def box(x: tuple[float, float], y: tuple[float, float], top: float, bottom: float = -inf) -> Solid:
    """A flat top over a rectangle; a wall is a thin high one, a ceiling one with a bottom."""
    return Solid(x, y, (top, 0.0, 0.0), bottom)


def ramp(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Solid:
    """A wedge that goes from height ``z[0]`` at ``x[0]`` to ``z[1]`` at ``x[1]``."""
    slope = (z[1] - z[0]) / (x[1] - x[0])
    return Solid(x, y, (z[0] - slope * x[0], slope, 0.0))


class World:
    """A union of solids."""

    def __init__(self, solids: Sequence[Solid]) -> None:
        self.solids = tuple(solids)

    def ranges(self, origins: Array, directions: Array) -> Array:
        """Exact distance from each origin to the first surface along its direction.

        Parameters
        ----------
        origins, directions : (N, 3) float64 [m], map
            The directions have length one.

        Returns
        -------
        (N,) float64 [m]
            Infinite where the ray meets nothing; 0 from inside of a solid.
        """
        origins = np.broadcast_to(origins, directions.shape)
        nearest = np.full(len(directions), inf)
        for solid in self.solids:
            np.minimum(nearest, _entry(solid, origins, directions), out=nearest)
        return nearest

    def top(self, x: Array, y: Array) -> Array:
        """Exact height [m] of the top surface at points; minus infinity where there is none."""
        x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
        height = np.full(x.shape, -inf)
        for solid in self.solids:
            inside = (solid.x[0] <= x) & (x <= solid.x[1]) & (solid.y[0] <= y) & (y <= solid.y[1])
            np.maximum(height, np.where(inside, solid.top_at(x, y), -inf), out=height)
        return height

    def cell_top(
        self, resolution: float, origin: tuple[float, float], shape: tuple[int, int]
    ) -> Array:
        """(rows, columns) [m]: the supremum of the top surface over each cell's open square.

        This is what a perfect 2 1/2-D map holds: the paper's height of the tallest object in
        the cell. The square is open, so an object that only touches it does not count.
        """
        y = origin[1] + resolution * np.arange(shape[0])[:, None]
        x = origin[0] + resolution * np.arange(shape[1])[None, :]
        height = np.full(shape, -inf)
        for solid in self.solids:
            x0, x1 = np.maximum(x, solid.x[0]), np.minimum(x + resolution, solid.x[1])
            y0, y1 = np.maximum(y, solid.y[0]), np.minimum(y + resolution, solid.y[1])
            # A linear function over a rectangle is greatest in a corner.
            corners = [solid.top_at(xc, yc) for xc in (x0, x1) for yc in (y0, y1)]
            highest = np.maximum.reduce(corners)
            np.maximum(height, np.where((x0 < x1) & (y0 < y1), highest, -inf), out=height)
        return height


def _entry(solid: Solid, origins: Array, directions: Array) -> Array:
    """(N,) [m]: where rays enter a solid, by clipping them at its half-spaces."""
    enter, leave = np.zeros(len(directions)), np.full(len(directions), inf)
    for normal, offset in zip(*solid.half_spaces(), strict=True):
        slack = offset - origins @ normal
        rate = directions @ normal
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            crossing = slack / rate
        np.maximum(enter, np.where(rate < 0.0, crossing, -inf), out=enter)
        np.minimum(leave, np.where(rate > 0.0, crossing, inf), out=leave)
        leave[(rate == 0.0) & (slack < 0.0)] = -inf
    return np.where(enter <= leave, enter, inf)


def scan_directions(T_map_sensor: Array, angles: Array) -> Array:
    """(N, 3): directions of a planar laser's beams, one pose (N or 1, 4, 4) for each angle."""
    in_sensor = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)
    return np.einsum("nij,nj->ni", np.broadcast_to(T_map_sensor, (len(angles), 4, 4))[:, :3, :3],
                     in_sensor)  # fmt: skip


def scan_ranges(world: World, T_map_sensor: Array, angles: Array) -> Array:
    """(N,) [m]: exact ranges of a planar laser's beams, one pose (N or 1, 4, 4) each."""
    return world.ranges(T_map_sensor[:, :3, 3], scan_directions(T_map_sensor, angles))
