# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The description of a world, and functions to build one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import hypot

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.simulation.scene import Mover, Scene, Solid, Span, Terrain, box


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """A world, and a drive through it that observes most of it.

    The robot starts at the origin, on ground zero, along x.

    Attributes
    ----------
    name : str
    area : ((x, x), (y, y)) [m]
        Extent of the ground truth, in whole cells of 0.125 m.
    way : (N, 2) float64 [m]
        Corners of the path of the drive, beginning at the origin.
    solids, terrain, movers
        As for `Scene`.
    speed : float [m/s]
        Of the drive.
    has_decks : bool
        Whether the robot drives on overhead solids, too: then the truth is given per level.
    """

    name: str
    area: tuple[Span, Span]
    way: Array
    solids: tuple[Solid, ...]
    terrain: Terrain | None = None
    movers: tuple[Mover, ...] = ()
    speed: float = 1.0
    has_decks: bool = False

    def scene(self) -> Scene:
        """The geometry of the world."""
        return Scene(self.solids, self.terrain, self.movers)


def walls(x: Span, y: Span, height: float, thickness: float = 0.2) -> list[Solid]:
    """Four walls around a room with these ranges [m]."""
    z = (-0.5, height)
    outer_x = (x[0] - thickness, x[1] + thickness)
    return [
        box((x[0] - thickness, x[0]), y, z),
        box((x[1], x[1] + thickness), y, z),
        box(outer_x, (y[0] - thickness, y[0]), z),
        box(outer_x, (y[1], y[1] + thickness), z),
    ]


Recess = tuple[float, float, float]
"""Start along a wall, width and depth of a door, a niche or a doorway [m]."""


def recessed_wall(
    along: Span,
    face: float,
    outward: float,
    recesses: Sequence[Recess],
    height: float = 2.6,
    *,
    along_x: bool = True,
) -> list[Solid]:
    """A wall along x or y whose face steps back in places.

    Parameters
    ----------
    along : (low, high) [m]
        Along x, or along y where ``along_x`` is false.
    face : float [m]
        Of the wall, across.
    outward : float
        1 or -1: the sign of the direction from the face into the wall.
    recesses : sequence of Recess
        In order, none within another, less deep than 0.6 m.
    height : float [m]
    """
    pieces, at = [], along[0]
    for start, width, depth in recesses:
        pieces += [(at, start, 0.0), (start, start + width, depth)]
        at = start + width
    solids = []
    for start, end, depth in [*pieces, (at, along[1], 0.0)]:
        near, far = face + outward * depth, face + outward * 0.7
        across = (min(near, far), max(near, far))
        x, y = ((start, end), across) if along_x else (across, (start, end))
        solids.append(box(x, y, (-0.5, height)))
    return solids


def floor(z: float = 0.0) -> Solid:
    """Ground everywhere."""
    return box((-60.0, 60.0), (-60.0, 60.0), (z - 1.0, z))


def distance_to_way(way: Array, x: Array, y: Array) -> Array:
    """Distance [m] of points from a polygonal path."""
    nearest = np.full(np.broadcast(x, y).shape, np.inf)
    for start, end in pairwise(way):
        run = end - start
        along = ((x - start[0]) * run[0] + (y - start[1]) * run[1]) / max(run @ run, 1e-9)
        along = np.clip(along, 0.0, 1.0)
        offset = np.hypot(x - start[0] - along * run[0], y - start[1] - along * run[1])
        nearest = np.minimum(nearest, offset)
    return nearest


def scattered(
    rng: np.random.Generator,
    area: tuple[Span, Span],
    taken: list[tuple[float, float, float]],
    way: Array,
    radii: Array,
    clear: float = 0.75,
) -> Iterator[tuple[float, float]]:
    """Positions of round objects that touch neither the path nor other objects.

    Parameters
    ----------
    area : ((x, x), (y, y)) [m]
    taken : list of x, y, radius [m]
        Occupied circles; the yielded ones are appended.
    radii : (N,) float64 [m]
    clear : float [m]
        Least distance from the path.
    """
    for radius in radii:
        for _ in range(400):
            x, y = (rng.uniform(low + radius, high - radius) for low, high in area)
            is_free = all(hypot(x - u, y - v) > radius + r + 0.1 for u, v, r in taken)
            if is_free and distance_to_way(way, np.array(x), np.array(y)) > radius + clear:
                taken.append((x, y, float(radius)))
                yield x, y
                break


def turned_box(
    x: float, y: float, size: tuple[float, float], top: float, yaw: float, ground: float = 0.0
) -> Solid:
    """A box on the ground, centred at (x, y) and turned by a yaw [rad]."""
    half_x, half_y = size[0] / 2, size[1] / 2
    return box((x - half_x, x + half_x), (y - half_y, y + half_y), (ground - 0.3, ground + top),
               yaw=yaw)  # fmt: skip


def smooth(way: Array, radius: float = 1.0, corners: int = 6) -> Array:
    """The path with rounded corners."""
    result = [way[0]]
    for before, corner, after in zip(way[:-2], way[1:-1], way[2:], strict=True):
        cut = min(radius, 0.45 * np.linalg.norm(corner - before),
                  0.45 * np.linalg.norm(after - corner))  # fmt: skip
        enter = corner + cut * (before - corner) / np.linalg.norm(before - corner)
        leave = corner + cut * (after - corner) / np.linalg.norm(after - corner)
        for t in np.linspace(0.0, 1.0, corners):
            result.append((1 - t) ** 2 * enter + 2 * t * (1 - t) * corner + t**2 * leave)
    result.append(way[-1])
    return np.array(result)


def weaving(way: Array, rng: np.random.Generator, aside: float = 0.2) -> Array:
    """A path that deviates from another one to its left and right, randomly and smoothly.

    Parameters
    ----------
    way : (N, 2) float64 [m]
    aside : float [m]
        Largest deviation; none at the start, where the robot stands.
    """
    lengths = np.linalg.norm(np.diff(way, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    along = np.linspace(0.0, at[-1], round(at[-1] / 0.1) + 1)
    points = np.column_stack([np.interp(along, at, way[:, axis]) for axis in (0, 1)])
    run = np.gradient(points, axis=0)
    left = np.column_stack([-run[:, 1], run[:, 0]]) / np.linalg.norm(run, axis=1)[:, None]
    wavelengths, phases = rng.uniform(4.0, 9.0, 2), rng.uniform(0.0, 2 * np.pi, 2)
    offset = 0.5 * np.sin(2 * np.pi * along[:, None] / wavelengths + phases).sum(axis=1)
    offset *= aside * np.clip(along - 0.5, 0.0, 1.0)
    return np.asarray(points + offset[:, None] * left)
