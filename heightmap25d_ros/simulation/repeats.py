# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Worlds in which one place looks like another: pillars, twin_rooms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.simulation.scene import Solid, box
from heightmap25d_ros.simulation.worlds import (
    World,
    floor,
    scattered,
    smooth,
    turned_box,
    walls,
)

PILLAR_SPACING = 4.0
"""From a pillar's middle to the next one's along the corridor [m]."""

_ROOM_X, _ROOM_Y = (-2.03, 4.97), (-1.97, 4.28)
"""Inside of the first room [m], map."""

_WALL, _DOOR = 0.2, 1.7
"""Thickness of a wall and width of a doorway [m]."""

_LAP = ((0.0, 0.0), (3.4, 0.0), (3.4, 2.9))
"""Corners of the drive that is the same in both rooms [m], in the room."""


def pillars(rng: np.random.Generator) -> World:
    """A corridor of about 60 m with a pair of equal pillars every 4 m, and nothing else."""
    half, end = rng.uniform(1.4, 1.7), rng.uniform(57.0, 59.0)
    depth, width = rng.uniform(0.25, 0.40), rng.uniform(0.30, 0.50)
    first = rng.uniform(0.8, 3.0)
    solids = [floor(), *walls((-2.53, end), (-half, half), 2.6)]
    for x in np.arange(first, end - 1.0, PILLAR_SPACING):
        along = (float(x) - width / 2, float(x) + width / 2)
        solids.append(box(along, (half - depth, half), (-0.5, 2.6)))
        solids.append(box(along, (-half, depth - half), (-0.5, 2.6)))
    return World(name="pillars", area=((-3.0, 59.5), (-2.0, 2.0)),
                 way=np.array([(0.0, 0.0), (end - 1.5, 0.0)]), solids=tuple(solids))  # fmt: skip


def twin_rooms(rng: np.random.Generator) -> World:
    """Two rooms of the same furniture, 9 to 10 m apart, and a corridor along both.

    The second is the first moved along x, by whole cells of 0.125 m: nothing inside tells one
    from the other. The drive goes through the first one, along the corridor, and through the
    second one in the same way.
    """
    apart = 9.0 + 0.125 * float(rng.integers(0, 9))
    door = rng.uniform(-0.3, 0.3)
    middle = _ROOM_Y[1] + _WALL + 1.2
    left, right = _ROOM_X[0] - rng.uniform(0.2, 1.0), apart + _ROOM_X[1] + rng.uniform(1.2, 2.5)
    furniture = _furniture(rng, door, middle)
    solids = [floor(), *_corridor((left, right), middle, (door, apart + door))]
    for shift in (0.0, apart):
        solids += [
            replace(solid, center=(solid.center[0] + shift, *solid.center[1:]))
            for solid in furniture
        ]
    first = [*_LAP, (door, 2.9), (door, middle)]
    second = [(door, middle), (door, 0.0), *_LAP[1:], (door + 1.0, 2.9)]
    corners = np.array([*first, *((apart + x, y) for x, y in second)])
    return World(name="twin_rooms", area=((-3.5, 18.0), (-2.5, 7.5)), way=smooth(corners, 0.9),
                 solids=tuple(solids), speed=0.9)  # fmt: skip


def _corridor(x: tuple[float, float], middle: float, doors: tuple[float, float]) -> list[Solid]:
    """Its walls; that towards the rooms has a doorway about each of two places along x [m]."""
    low, high, z = middle - 1.2, middle + 1.2, (-0.5, 2.6)
    edges = [x[0], *(door + side * _DOOR / 2 for door in doors for side in (-1.0, 1.0)), x[1]]
    rooms_side = [
        box((start, end), (low - _WALL, low), z)
        for start, end in zip(edges[::2], edges[1::2], strict=True)
    ]
    return [
        *rooms_side,
        box((x[0] - _WALL, x[1] + _WALL), (high, high + _WALL), z),
        box((x[0] - _WALL, x[0]), (low - _WALL, high), z),
        box((x[1], x[1] + _WALL), (low - _WALL, high), z),
    ]


def _furniture(rng: np.random.Generator, door: float, middle: float) -> list[Solid]:
    """Of the first room: its other three walls, cabinets, a table and boxes."""
    x, y, z = _ROOM_X, _ROOM_Y, (-0.5, 2.6)
    solids = [
        box((x[0] - _WALL, x[1] + _WALL), (y[0] - _WALL, y[0]), z),
        box((x[0] - _WALL, x[0]), y, z),
        box((x[1], x[1] + _WALL), y, z),
    ]
    at = x[0] + rng.uniform(0.2, 0.8)
    while at < x[1] - 1.3:
        width, height = rng.uniform(0.8, 1.2), rng.choice([0.75, 1.35, 2.0])
        solids.append(box((at, at + width), (y[0], y[0] + 0.45), (-0.3, height)))
        at += width + rng.choice([0.0, 0.6, 0.9])
    top, yaw = rng.uniform(0.68, 0.78), rng.uniform(-0.2, 0.2)
    solids.append(turned_box(1.7, 1.45, (1.2, 0.7), top, yaw))
    taken = [(1.7, 1.45, 0.9)]
    sizes = rng.uniform(0.25, 0.5, (6, 2))
    drive: Array = np.array([*_LAP, (door, 2.9), (door, middle), (door, 0.0)])
    places = scattered(rng, (x, (y[0] + 0.5, y[1])), taken, drive, np.hypot(*sizes.T) / 2)
    solids += [
        turned_box(px, py, (sx, sy), rng.uniform(0.2, 0.9), rng.uniform(0.0, 1.57))
        for (px, py), (sx, sy) in zip(places, sizes, strict=False)
    ]
    return solids


BUILDERS = {"pillars": pillars, "twin_rooms": twin_rooms}
