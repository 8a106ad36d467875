# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Outdoor worlds: ramp, rough, street, overpass."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.simulation.scene import Solid, Terrain, box, cylinder, ramp
from heightmap25d_ros.simulation.worlds import (
    World,
    distance_to_way,
    floor,
    scattered,
    smooth,
    turned_box,
    walls,
)

_DEEP = -4.0


def ramp_down(rng: np.random.Generator) -> World:
    """As Fig. 2 of the paper: from a landing down a ramp into a yard.

    A building on the left, an upper deck along the ramp, a drop-off on the right, kerbs, a low
    wall at the end; crates stand about.
    """
    fall, length = rng.uniform(1.3, 1.6), rng.uniform(10.5, 12.5)
    foot = 4.03 + length
    left, right, deck = 1.47, -1.53, 3.06
    yard = (foot + 11.0, foot + 11.3)
    solids = [
        floor(-fall),
        box((-6.0, 4.03), (right, deck), (_DEEP, 0.0)),
        ramp((4.03, foot), (right, left), (0.0, -fall), thickness=2.5),
        box((4.03, foot + 3.9), (left, deck), (_DEEP, 0.0)),
        box((-6.0, yard[1]), (deck, deck + 3.0), (_DEEP, 3.0)),
        box((-6.0, yard[1]), (-7.2, -6.97), (_DEEP, 1.0)),
        box(yard, (-7.0, deck), (_DEEP, -fall + rng.uniform(0.7, 1.0))),
        *_kerb(rng, length, fall, right),
        box((1.06, 1.21), (-1.31, -0.69), (-0.5, 0.08)),
        box((foot + 5.1, yard[0]), (deck - 1.2, deck), (_DEEP, -fall + 0.12)),
        turned_box(2.4, 2.5, (0.6, 0.5), 0.45, rng.uniform(0.0, 0.5)),
    ]
    way = smooth(np.array([(0.0, 0.0), (foot, 0.0), (foot + 4.0, rng.uniform(-2.2, -1.6)),
                           (foot + 8.5, -0.6)]), 1.5)  # fmt: skip
    taken: list[tuple[float, float, float]] = []
    sizes = rng.uniform(0.35, 0.9, (9, 2))
    area = ((4.5, yard[0] - 0.3), (-6.8, -2.2))
    places = scattered(rng, area, taken, way, np.hypot(*sizes.T) / 2)
    solids += [
        turned_box(x, y, (sx, sy), rng.uniform(0.14, 0.7), rng.uniform(0.0, 1.57), -fall)
        for (x, y), (sx, sy) in zip(places, sizes, strict=False)
    ]
    places = scattered(rng, ((foot + 4.2, yard[0] - 0.3), (-2.0, 1.5)), taken, way,
                       np.full(3, 0.13))  # fmt: skip
    solids += [cylinder(x, y, 0.13, (_DEEP, -fall + 0.9)) for x, y in places]
    return World(name="ramp", area=((-2.5, 28.5), (-7.5, 4.0)), way=way, solids=tuple(solids))


def _kerb(rng: np.random.Generator, length: float, fall: float, right: float) -> list[Solid]:
    """Along a part of the ramp's open edge, 15 cm above it."""
    start, end = 4.03 + rng.uniform(1.5, 2.5), 4.03 + length - rng.uniform(3.5, 5.0)
    z = [0.15 - fall * (x - 4.03) / length for x in (start, end)]
    return [ramp((start, end), (right, right + 0.16), (z[0], z[1]), thickness=0.6)]


def rough(rng: np.random.Generator) -> World:
    """Hills, ditches, rocks and trees; a track that can be driven winds through it."""
    area = ((-3.0, 25.0), (-9.0, 9.0))
    bends = rng.uniform(-1.0, 1.0, 4)
    corners = [(0.0, 0.0), (5.0, 2.0 * bends[0]), (10.0, 2.5 * bends[1]), (15.0, 2.5 * bends[2]),
               (19.0, 2.0 * bends[3]), (22.0, 0.0)]  # fmt: skip
    way = smooth(np.array(corners), 2.5)
    terrain = _hills(rng, area, way)
    taken: list[tuple[float, float, float]] = []
    inner = ((area[0][0] + 0.5, area[0][1] - 0.5), (area[1][0] + 0.5, area[1][1] - 0.5))
    tree_radii, rock_radii = rng.uniform(0.10, 0.22, 16), rng.uniform(0.2, 0.6, 26)
    solids: list[Solid] = []
    places = scattered(rng, inner, taken, way, tree_radii, 0.9)
    for (x, y), radius in zip(places, tree_radii, strict=False):
        solids.append(cylinder(x, y, float(radius), (-6.0, _ground(terrain, x, y) + 4.0)))
    places = scattered(rng, inner, taken, way, rock_radii, 0.8)
    for (x, y), radius in zip(places, rock_radii, strict=False):
        flat = radius * rng.uniform(0.5, 0.9)
        center = (x, y, _ground(terrain, x, y) + 0.2 * flat)
        size = (float(radius), float(radius * rng.uniform(0.6, 1.0)), float(flat))
        solids.append(Solid(kind="ellipsoid", center=center, size=size, yaw=rng.uniform(0.0, 3.1)))
    return World(name="rough", area=area, way=way, solids=tuple(solids), terrain=terrain,
                 speed=0.9)  # fmt: skip


def _hills(
    rng: np.random.Generator, area: tuple[tuple[float, float], tuple[float, float]], way: Array
) -> Terrain:
    """Two sizes of hills and two ditches; gentler along the path, level at its start."""
    spacing, border = 0.125, 0.125
    x = np.arange(area[0][0] - border, area[0][1] + 1.5 * border, spacing)[None, :]
    y = np.arange(area[1][0] - border, area[1][1] + 1.5 * border, spacing)[:, None]
    shape = (y.size, x.size)
    large, small = (
        gaussian_filter(rng.normal(0.0, 1.0, shape), width / spacing) * width / spacing
        for width in (2.2, 0.55)
    )
    large, small = (0.55 * field / field.std() * scale for field, scale in
                    ((large, 0.8), (small, 0.14)))  # fmt: skip
    off_way = np.clip((distance_to_way(way, x, y) - 0.8) / 1.6, 0.0, 1.0)
    off_way = off_way**2 * (3.0 - 2.0 * off_way)
    height = large * (0.55 + 0.45 * off_way) + small * (0.25 + 0.75 * off_way)
    for side in (-1.0, 1.0):
        bearing, offset = side * rng.uniform(0.05, 0.25), side * rng.uniform(4.2, 5.5)
        across = np.abs((y - offset) * np.cos(bearing) - (x - 11.0) * np.sin(bearing))
        depth, width = rng.uniform(0.5, 0.8), rng.uniform(0.45, 0.6)
        edge = 1.0 / (1.0 + np.exp((across - width) / 0.07))
        height = height - off_way * depth * edge
    level = np.clip((np.hypot(x, y) - 0.8) / 1.5, 0.0, 1.0)
    level = level**2 * (3.0 - 2.0 * level)
    start = float(height[np.abs(y[:, 0]).argmin(), np.abs(x[0]).argmin()])
    return Terrain(
        height=(height - start) * level,
        origin=(float(x[0, 0]), float(y[0, 0])),
        spacing=spacing,
    )


def _ground(terrain: Terrain, x: float, y: float) -> float:
    row = round((y - terrain.origin[1]) / terrain.spacing)
    column = round((x - terrain.origin[0]) / terrain.spacing)
    return float(terrain.height[row, column])


def street(rng: np.random.Generator) -> World:
    """A road between pavements behind 15 cm kerbs, and a lowered kerb with a lip of 5 cm.

    The drive climbs the lip, goes along the pavement up to stairs that lead down, and beside
    them down a gentle slope back to the road. Posts and boxes stand about; buildings on the left.
    """
    kerb, lip = 0.15, 0.05
    lane, house = 2.53, 8.06
    drive_in = (4.5 + rng.uniform(0.0, 1.0), 7.5 + rng.uniform(0.0, 1.0))
    slope = (18.5 + rng.uniform(0.0, 1.0), 21.5 + rng.uniform(0.0, 0.5))
    middle_y, last = 5.35, 25.3
    pavement: list[Solid] = [
        box((-3.4, drive_in[0]), (lane, house), (_DEEP, kerb)),
        box(drive_in, (lane + 1.6, house), (_DEEP, kerb)),
        _rise(drive_in, (lane, lane + 1.6), (lip, kerb)),
        box((drive_in[1], slope[0]), (lane, house), (_DEEP, kerb)),
        ramp(slope, (lane, middle_y), (kerb, 0.0), thickness=3.0),
        box((slope[1], last), (lane, middle_y), (_DEEP, 0.0)),
        box((slope[0], last), (middle_y, middle_y + 0.15), (_DEEP, 0.6)),
        *_stairs(slope[0], last, (middle_y + 0.15, house), kerb),
    ]
    solids = [
        floor(_DEEP),
        box((-3.4, last), (-2.47, lane), (_DEEP, 0.0)),
        box((-3.4, last), (-4.97, -2.47), (_DEEP, kerb)),
        box((-3.4, last), (house, house + 1.0), (_DEEP, 4.0)),
        box((-3.4, last), (-5.2, -4.97), (_DEEP, 1.9)),
        box((last, last + 0.25), (-5.2, house + 1.0), (_DEEP, 1.9)),
        box((-3.4, -3.15), (-5.2, house + 1.0), (_DEEP, 1.9)),
        *pavement,
    ]
    middle = sum(drive_in) / 2
    way = smooth(np.array([(0.0, 0.0), (middle - 0.3, 0.0), (middle + 0.1, 5.0), (13.0, 6.5),
                           (slope[0] - 0.9, 6.5), (slope[0] - 0.2, 3.9), (23.5, 3.9),
                           (23.5, 0.0), (17.0, 0.0)]), 1.0)  # fmt: skip
    return World(
        name="street",
        area=((-3.5, 25.75), (-5.25, 8.5)),
        way=way,
        solids=(*solids, *_street_furniture(rng, way, kerb, (lane, house))),
    )


def _rise(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Solid:
    """A plate that rises along y."""
    along = ramp((y[0], y[1]), (-x[1], -x[0]), z, thickness=2.0)
    # The plate of x turned by a quarter: (x, y) becomes (-y, x).
    center = (-along.center[1], along.center[0], along.center[2])
    return Solid(kind="box", center=center, size=along.size, pitch=along.pitch, yaw=np.pi / 2)


def _stairs(x0: float, x1: float, y: tuple[float, float], top: float) -> list[Solid]:
    """Down along x: six steps of 15 cm, each 40 cm deep, and a landing."""
    steps = [
        box((x0 + 0.4 * i, x0 + 0.4 * (i + 1)), y, (_DEEP, top - 0.15 * (i + 1))) for i in range(6)
    ]
    return [*steps, box((x0 + 2.4, x1), y, (_DEEP, top - 0.15 * 6))]


def _street_furniture(
    rng: np.random.Generator, way: Array, kerb: float, pavement: tuple[float, float]
) -> list[Solid]:
    """Posts on the pavement, boxes on the road."""
    taken: list[tuple[float, float, float]] = []
    area = ((-2.5, 18.0), (pavement[0] + 0.2, pavement[1]))
    posts = scattered(rng, area, taken, way, np.full(8, 0.09))
    solids = [cylinder(x, y, 0.09, (_DEEP, kerb + 1.1)) for x, y in posts]
    sizes = rng.uniform(0.35, 0.8, (6, 2))
    boxes = scattered(rng, ((-2.5, 24.0), (-2.3, pavement[0])), taken, way,
                      np.hypot(*sizes.T) / 2, 0.8)  # fmt: skip
    return solids + [
        turned_box(x, y, (sx, sy), rng.uniform(0.2, 0.8), rng.uniform(0.0, 1.57))
        for (x, y), (sx, sy) in zip(boxes, sizes, strict=False)
    ]


def overpass(rng: np.random.Generator) -> World:
    """A bridge over a road: two ramps and a deck between them, all driven, and the way below it.

    Which of the two comes first is drawn.
    """
    rise, slab = rng.uniform(2.1, 2.4), 0.3
    foot, length = 2.06, rng.uniform(9.0, 9.6)
    head, end = foot + length, foot + length + 5.0
    last, lane = end + length, (-1.53, 1.53)
    x, y = (-2.03, last + 2.6), (-5.03, 5.03)
    solids = [
        floor(),
        ramp((foot, head), lane, (0.0, rise), thickness=3.0),
        box((head, end), lane, (rise - slab, rise), is_overhead=True),
        ramp((end, last), lane, (rise, 0.0), thickness=3.0),
        *(box((head, end), side, (rise - slab, rise + 0.7), is_overhead=True)
          for side in ((lane[0] - 0.2, lane[0]), (lane[1], lane[1] + 0.2))),
        *walls(x, y, 3.6),
    ]  # fmt: skip
    middle, aside = (head + end) / 2, 3.3
    over = [(0.0, 0.0), (last + 1.2, 0.0), (last + 1.2, -aside), (middle, -aside),
            (middle, aside), (foot, aside)]  # fmt: skip
    under = [(0.0, 0.0), (0.6, -aside), (middle, -aside), (middle, aside), (-0.6, aside),
             (-0.6, 0.0), (last + 0.6, 0.0)]  # fmt: skip
    is_over_first = rng.random() < 0.5
    way = smooth(np.array(over if is_over_first else under), 1.0)
    sizes = rng.uniform(0.35, 0.7, (8, 2))
    taken: list[tuple[float, float, float]] = []
    solids += [
        turned_box(px, py, (sx, sy), rng.uniform(0.2, 0.9), rng.uniform(0.0, 1.57))
        for side in ((y[0], lane[0] - 0.6), (lane[1] + 0.6, y[1]))
        for (px, py), (sx, sy) in zip(
            scattered(rng, ((foot, last), side), taken, way, np.hypot(*sizes.T) / 2), sizes,
            strict=False,
        )
    ]  # fmt: skip
    return World(name="overpass", area=((-2.5, 29.0), (-5.5, 5.5)), way=way, solids=tuple(solids),
                 speed=1.4, has_decks=True)  # fmt: skip


BUILDERS = {"ramp": ramp_down, "rough": rough, "street": street, "overpass": overpass}
