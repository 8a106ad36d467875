# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Indoor worlds: room, moving, arch, garage."""

from __future__ import annotations

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.simulation.scene import Mover, Solid, box, cylinder, ramp
from heightmap25d_ros.simulation.worlds import World, floor, scattered, smooth, turned_box, walls

_GATES = ((0.45, 0.80, 2.30), (0.65, 1.20, 1.80), (1.00, 0.55, 1.60))
"""Clear heights of the gates of each wall [m]."""

_GATE_WIDTH = 1.9
_PERSON_LEAVES = 20.0


def room(rng: np.random.Generator) -> World:
    """A cluttered lab as Room 105 of the paper, 12 m x 10 m, and one lap in it.

    Cabinets along the walls, tables complete down to the floor in the middle, boxes about, and
    a corner behind a low barrier that is visible but unreachable.
    """
    x, y = (-2.03, 10.06), (-2.07, 8.04)
    corners = [(0, 0), (8, 0), (8, 5.5), (0, 5.5), (0, 0), (1.2, 0)]
    way = smooth(np.array(corners, np.float64), 1.2)
    solids = [floor(), *walls(x, y, 2.6)]
    solids += _cabinets(rng, x, y)
    solids += _tables(rng)
    solids += _fenced_corner(rng, x, y)
    taken = [(4.0, 3.0, 2.9), (8.6, 7.6, 1.9)]
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
    while at < x[1] - 4.7:
        width, height = rng.uniform(0.8, 1.2), rng.choice([0.4, 0.75, 1.35])
        solids.append(box((at, at + width), (y[1] - 0.45, y[1]), (0.0, height)))
        at += width + rng.choice([0.0, 0.7, 1.2])
    return solids


def _tables(rng: np.random.Generator) -> list[Solid]:
    """Islands in the middle of the lap."""
    solids = []
    for row in (1.45, 3.25):
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
    """A store behind a low barrier, over which the lasers see."""
    left, low, top = x[1] - 3.4, y[1] - 1.6, rng.uniform(0.15, 0.20)
    return [
        box((left, x[1]), (low, low + 0.1), (0.0, top)),
        box((left, left + 0.1), (low, y[1]), (0.0, top)),
    ]


def moving(rng: np.random.Generator) -> World:
    """A hall with a box that is removed while the robot is elsewhere, and a walking person.

    The drive passes the box, goes around, and passes its position again.
    """
    x, y = (-2.03, 8.53), (-2.09, 6.04)
    corners = [(0, 0), (6.5, 0), (6.5, 4), (0, 4), (0, 0), (4.5, 0)]
    way = smooth(np.array(corners, np.float64), 1.2)
    taken = [(3.25, 2.0, 1.4)]
    sizes = rng.uniform(0.3, 0.6, (7, 2))
    places = scattered(rng, (x, y), taken, way, np.hypot(*sizes.T) / 2)
    solids = [
        floor(),
        *walls(x, y, 2.6),
        *(
            turned_box(px, py, (sx, sy), rng.uniform(0.2, 0.9), rng.uniform(0.0, 1.57))
            for (px, py), (sx, sy) in zip(places, sizes, strict=False)
        ),
    ]
    place = (rng.uniform(2.9, 3.6), rng.uniform(1.2, 1.5), 0.25)
    gone_at = rng.uniform(13.0, 15.0)
    removed = Mover(
        solid=box((-0.3, 0.3), (-0.25, 0.25), (-0.25, 0.25)),
        center_at=lambda seconds: place if seconds < gone_at else None,
    )
    return World(name="moving", area=((-2.5, 9.0), (-2.5, 6.5)), way=way, solids=tuple(solids),
                 movers=(removed, _person(rng)), speed=0.9)  # fmt: skip


def _person(rng: np.random.Generator) -> Mover:
    """A person who walks to and fro across the middle of the hall and leaves after 20 s."""
    x, low, high, pace = rng.uniform(4.6, 5.0), 0.9, 3.1, rng.uniform(0.8, 1.2)

    def center_at(seconds: float) -> tuple[float, float, float] | None:
        if seconds > _PERSON_LEAVES:
            return None
        phase = (pace * seconds / (high - low)) % 2.0
        return (x, low + (high - low) * (phase if phase < 1.0 else 2.0 - phase), 0.9)

    return Mover(solid=cylinder(0.0, 0.0, 0.22, (-0.9, 0.9)), center_at=center_at)


def arch(rng: np.random.Generator) -> World:
    """Three walls across a yard, each with gates of several clear heights, low ones too.

    The drive goes through one gate of each wall that is high enough.
    """
    y = (-4.03, 4.09)
    solids = [floor(), *walls((-2.03, 17.06), y, 1.9)]
    corners = [(0.0, 0.0)]
    for wall_x, heights in zip((3.53, 8.03, 12.53), _GATES, strict=True):
        order = rng.permutation(len(heights))
        middles = np.linspace(y[0] + 1.3, y[1] - 1.3, len(heights))
        solids += _gates(wall_x, middles, [heights[i] for i in order], y)
        through = middles[int(np.argmax([heights[i] for i in order]))]
        corners += [(wall_x - 1.5, through), (wall_x + 1.8, through)]
    way = smooth(np.array([*corners, (15.3, 0.0)]), 0.9)
    return World(name="arch", area=((-2.5, 17.5), (-4.5, 4.5)), way=way, solids=tuple(solids))


def _gates(x: float, middles: Array, heights: list[float], y: tuple[float, float]) -> list[Solid]:
    """A wall with a gate at each middle: complete between them, lintels above them."""
    solids, at = [], y[0]
    for middle, clear in zip(middles, heights, strict=True):
        low, high = float(middle) - _GATE_WIDTH / 2, float(middle) + _GATE_WIDTH / 2
        solids.append(box((x, x + 0.3), (at, low), (-0.5, clear + 0.3)))
        solids.append(box((x, x + 0.3), (low, high), (clear, clear + 0.3), is_overhead=True))
        at = high
    return [*solids, box((x, x + 0.3), (at, y[1]), (-0.5, heights[-1] + 0.3))]


def garage(rng: np.random.Generator) -> World:
    """Two decks, one above the other, joined by a ramp beside them.

    The drive goes around on the lower deck, up the ramp, and around on the upper deck.
    """
    rise, slab = rng.uniform(2.3, 2.6), 0.3
    foot, head = 2.06, 16.03 + rng.uniform(0.0, 1.0)
    deck_x, deck_y = (-2.03, head + 4.5), (1.53, 9.03)
    lane_y = (-1.53, 1.53)
    solids = [
        floor(),
        box(deck_x, deck_y, (rise - slab, rise), is_overhead=True),
        box((head, deck_x[1]), lane_y, (rise - slab, rise), is_overhead=True),
        ramp((foot, head), lane_y, (0.0, rise), thickness=3.0),
        box((foot + 3.0, head), (deck_y[0] - 0.12, deck_y[0] + 0.08), (0.0, rise + 0.7)),
        box((deck_x[0] - 0.2, deck_x[1]), (lane_y[0] - 0.2, lane_y[0]), (-0.5, rise + 0.7)),
        *_parapet(deck_x, deck_y, rise, lane_y[0]),
    ]
    pillars = [(x, y) for x in np.arange(1.0, head + 3.0, 4.5) for y in (3.6, 6.9)]
    solids += [box((px, px + 0.3), (py, py + 0.3), (0.0, rise - slab)) for px, py in pillars]
    far = head - 1.0
    turn = max(far, 15.3)  # past the last pillar, with room for the robot
    corners = [(0, 0), (0.3, 5.3), (turn, 5.3), (turn, 8.0), (0.0, 8.0), (0.0, 0.4), (2.0, 0.0),
               (head + 2.2, 0.0), (head + 2.2, 5.3), (3.0, 5.3)]  # fmt: skip
    way = smooth(np.array(corners, np.float64), 1.2)
    taken = [(px + 0.15, py + 0.15, 0.3) for px, py in pillars]
    places = scattered(rng, ((0.0, far), (2.0, 8.8)), taken, way, np.full(6, 0.35))
    solids += [
        turned_box(x, y, (0.5, 0.45), rng.uniform(0.3, 0.9), rng.uniform(0.0, 1.57))
        for x, y in places
    ]
    return World(name="garage", area=((-2.5, 22.0), (-2.0, 9.5)), way=way, solids=tuple(solids),
                 speed=1.4, has_decks=True)  # fmt: skip


def _parapet(
    x: tuple[float, float], y: tuple[float, float], deck: float, low: float
) -> list[Solid]:
    """Around the upper deck and, as a wall, around the lower one; open towards the start."""
    return [
        box((x[0], x[1]), (y[1], y[1] + 0.2), (-0.5, deck + 0.7)),
        box((x[0] - 0.2, x[0]), (y[0] - 3.2, y[1]), (-0.5, deck + 0.7)),
        box((x[1], x[1] + 0.2), (low, y[1]), (-0.5, deck + 0.7)),
        box((x[0], 2.2), (y[0] - 0.1, y[0]), (deck, deck + 0.7), is_overhead=True),
    ]


BUILDERS = {"room": room, "arch": arch, "garage": garage, "moving": moving}
