# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Worlds under a roof: room, moving, arch, garage."""

from __future__ import annotations

import numpy as np

from heightmap25d_ros.simulation.scene import Solid, box
from heightmap25d_ros.simulation.worlds import (
    World,
    floor,
    scattered,
    smooth,
    turned_box,
    walls,
)


def room(rng: np.random.Generator) -> World:
    """A cluttered lab as Room 105 of the paper, 12 m x 10 m, and one lap in it.

    Cabinets along the walls, tables complete down to the floor in the middle, boxes about, and
    a corner behind a low barrier that can be seen and not be reached.
    """
    x, y = (-2.03, 10.06), (-2.07, 8.04)
    corners = [(0, 0), (8, 0), (8, 6), (0, 6), (0, 0), (1.2, 0)]
    way = smooth(np.array(corners, np.float64) + np.array([0.0, 0.0]), 1.2)
    solids = [floor(), *walls(x, y, 2.6)]
    solids += _cabinets(rng, x, y)
    solids += _tables(rng)
    solids += _fenced_corner(rng, x, y)
    taken = [(4.0, 3.0, 2.9), (9.2, 7.3, 1.5)]
    sizes = rng.uniform(0.25, 0.55, (14, 2))
    places = scattered(rng, (x, y), taken, way, np.hypot(*sizes.T) / 2)
    solids += [
        turned_box(px, py, (sx, sy), rng.uniform(0.16, 0.9), rng.uniform(0.0, 1.57))
        for (px, py), (sx, sy) in zip(places, sizes, strict=False)
    ]
    return World(name="room", area=((-2.5, 10.5), (-2.5, 8.5)), way=way, solids=tuple(solids),
                 speed=0.9)  # fmt: skip


def _cabinets(
    rng: np.random.Generator, x: tuple[float, float], y: tuple[float, float]
) -> list[Solid]:
    solids, at = [], x[0] + rng.uniform(0.3, 0.8)
    while at < x[1] - 1.6:
        width, height = rng.uniform(0.8, 1.2), rng.choice([0.75, 1.35, 2.0])
        solids.append(box((at, at + width), (y[0], y[0] + 0.45), (0.0, height)))
        at += width + rng.choice([0.0, 0.0, 0.9])
    at = x[0] + rng.uniform(0.5, 1.0)
    while at < x[1] - 3.6:
        width, height = rng.uniform(0.8, 1.2), rng.choice([0.4, 0.75, 1.35])
        solids.append(box((at, at + width), (y[1] - 0.45, y[1]), (0.0, height)))
        at += width + rng.choice([0.0, 0.7, 1.2])
    return solids


def _tables(rng: np.random.Generator) -> list[Solid]:
    """Islands in the middle of the lap."""
    solids = []
    for row in (1.55, 3.55):
        at = 1.6 + rng.uniform(0.0, 0.3)
        for _ in range(2):
            length = rng.uniform(1.5, 1.9)
            shift = rng.uniform(-0.1, 0.1)
            top = rng.uniform(0.68, 0.78)
            solids.append(box((at, at + length), (row + shift, row + shift + 0.8), (0.0, top)))
            at += length + rng.uniform(0.5, 1.1)
    return solids


def _fenced_corner(
    rng: np.random.Generator, x: tuple[float, float], y: tuple[float, float]
) -> list[Solid]:
    """A store behind a low barrier, over which the lasers look."""
    left, low, top = x[1] - 2.6, y[1] - 1.15, rng.uniform(0.22, 0.30)
    return [
        box((left, x[1]), (low, low + 0.1), (0.0, top)),
        box((left, left + 0.1), (low, y[1]), (0.0, top)),
    ]


BUILDERS = {"room": room}
