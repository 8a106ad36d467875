# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Worlds with nothing to hold on to along the drive: plain_ramp, plain_street, corridor, court.

Between their ends, surfaces do not change along x (on the ramp: along its slope), so that no scan
tells how far the robot has come. The lasers reach 30 m ahead: street and corridor are plain over
about 50 m, so that nothing else is in sight for about 20 m.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.simulation.scene import Solid, Span, box, cylinder, ramp
from heightmap25d_ros.simulation.worlds import (
    Recess,
    World,
    floor,
    recessed_wall,
    smooth,
    walls,
)

_DOOR = (0.95, 0.12)
"""Width and depth of a closed door in its frame [m]."""

_COURT_X, _COURT_Y = (-10.0, 52.0), (0.0, 38.0)
"""Middles of the corridors around the court [m], map."""


def plain_ramp(rng: np.random.Generator) -> World:
    """A straight ramp upwards between smooth walls, 14.5 to 15.5 m long, 8 to 12 % steep.

    Level ends with crates and low walls across. From the ramp the level laser looks over those
    at its head: what it meets up to 1.5 m above the robot are the walls beside it, which end 8 m
    behind the low one.
    """
    slope, length = rng.uniform(0.08, 0.12), rng.uniform(14.5, 15.5)
    half = rng.uniform(1.5, 1.8)
    back, foot = -2.53, 4.03
    head, rise = foot + length, slope * length
    end = head + rng.uniform(6.5, 7.5)
    lane = (-half, half)
    solids = [
        floor(),
        ramp((foot, head), lane, (0.0, rise), thickness=2.0),
        box((head, end), lane, (-0.5, rise)),
        box((back - 0.2, end + 8.0), (half, half + 0.2), (-0.5, rise + 2.2)),
        box((back - 0.2, end + 8.0), (-half - 0.2, -half), (-0.5, rise + 2.2)),
        box((back - 0.2, back), lane, (-0.5, 1.0)),
        box((end, end + 0.2), lane, (-0.5, rise + 0.8)),
        *_crates(rng, (back, foot - 0.8), half, (0.25, 0.9)),
        *_crates(rng, (head + 1.2, end), half, (0.2, 0.42), rise),
    ]
    return World(name="plain_ramp", area=((-3.0, 35.25), (-2.25, 2.25)),
                 way=_straight(end - 1.5), solids=tuple(solids))  # fmt: skip


def plain_street(rng: np.random.Generator) -> World:
    """A flat street between plain facades, over 50 m without kerbs, posts or doors.

    Doorways, posts and boxes stand at both ends, which are open.
    """
    half = rng.uniform(3.2, 4.0)
    first, last = (-3.0, 4.0), (55.0, 59.5)
    solids = [floor()]
    for side in (-1.0, 1.0):
        recesses = [*_doorways(rng, first), *_doorways(rng, last)]
        height = rng.uniform(4.0, 6.0)
        solids += recessed_wall((first[0], last[1]), side * half, side, recesses, height)
    for x in (first, last):
        for side in (-1.0, 1.0):
            post = rng.uniform(x[0] + 0.3, x[1] - 0.3), side * rng.uniform(1.2, half - 0.7)
            solids.append(cylinder(*post, 0.09, (-0.5, 1.1)))
        solids += _crates(rng, x, half, (0.4, 1.2))
    return World(name="plain_street", area=((-3.5, 59.75), (-5.0, 5.0)), way=_straight(57.5),
                 solids=tuple(solids))  # fmt: skip


def corridor(rng: np.random.Generator) -> World:
    """A straight corridor of about 60 m; cabinets stand in its first and its last 4 m only."""
    half, end = rng.uniform(1.1, 1.35), rng.uniform(57.0, 59.0)
    back = -2.53
    solids = [
        floor(),
        *walls((back, end), (-half, half), 2.6),
        *_crates(rng, (-0.5, 4.0), half, (0.4, 2.0)),
        *_crates(rng, (end - 4.0, end), half, (0.4, 2.0)),
    ]
    return World(name="corridor", area=((-3.0, 59.5), (-1.75, 1.75)), way=_straight(end - 1.5),
                 solids=tuple(solids))  # fmt: skip


def court(rng: np.random.Generator) -> World:
    """Corridors around a court, 62 m by 38 m, and once around: about 200 m, a closed loop.

    Doors and niches at a few places, cabinets at the start; more than 20 m between them without
    anything, on each of the four sides. The drive ends 6 m past its start.
    """
    half = rng.uniform(1.15, 1.35)
    (west, east), (south, north) = _COURT_X, _COURT_Y
    shift = rng.uniform(-1.0, 1.0, 4)
    solids = [floor()]
    for outward, reach in ((1.0, half), (-1.0, -half)):
        x, y = (west - reach, east + reach), (south - reach, north + reach)
        along_south = [*_features(rng, 0.0), *_features(rng, 27.0 + shift[0])]
        solids += recessed_wall(x, y[0], -outward, along_south)
        solids += recessed_wall(x, y[1], outward, _features(rng, 21.0 + shift[1]))
        solids += recessed_wall(y, x[0], -outward, _features(rng, 31.0 + shift[2]), along_x=False)
        solids += recessed_wall(y, x[1], outward, _features(rng, 7.0 + shift[3]), along_x=False)
    solids += _crates(rng, (-2.6, 2.6), half, (0.8, 2.0))
    corners = [(0.0, 0.0), (east, south), (east, north), (west, north), (west, south), (6.0, 0.0)]
    return World(name="court", area=((-12.25, 54.25), (-2.25, 40.25)),
                 way=smooth(np.array(corners), 1.2), solids=tuple(solids), speed=1.2)  # fmt: skip


def _straight(length: float) -> Array:
    """Along x."""
    return np.array([(0.0, 0.0), (length, 0.0)])


def _crates(
    rng: np.random.Generator, x: Span, half: float, heights: Span, ground: float = 0.0
) -> list[Solid]:
    """Two boxes along each of two walls at ``y = -half`` and ``half``, within a range of x [m]."""
    solids = []
    for side in (-1.0, 1.0):
        edges = np.linspace(x[0] + 0.2, x[1] - 0.2, 3)
        for low, high in pairwise(edges):
            width, depth = rng.uniform(0.4, 1.0), rng.uniform(0.25, 0.40)
            start = rng.uniform(low, high - width)
            y = sorted((side * half, side * (half - depth)))
            top = ground + rng.uniform(*heights)
            solids.append(box((start, start + width), (y[0], y[1]), (ground - 0.3, top)))
    return solids


def _doorways(rng: np.random.Generator, x: Span) -> list[Recess]:
    """One deep doorway within a range [m]."""
    return [(rng.uniform(x[0] + 0.5, x[1] - 1.9), rng.uniform(0.9, 1.4), rng.uniform(0.2, 0.5))]


def _features(rng: np.random.Generator, middle: float) -> list[Recess]:
    """A door and a niche, within 2.4 m of a place along a wall [m]."""
    door = (middle + rng.uniform(-2.3, -1.3), *_DOOR)
    niche = (middle + rng.uniform(0.0, 1.0), rng.uniform(0.7, 1.3), rng.uniform(0.25, 0.5))
    return [door, niche]


BUILDERS = {
    "plain_ramp": plain_ramp,
    "plain_street": plain_street,
    "corridor": corridor,
    "court": court,
}
