# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Beams, the robot's body and the ground truth meet one geometry.

It is held against the solids in closed form: whether points are inside of any of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from heightmap25d_ros.simulation.recording import BUILDERS, world_of
from heightmap25d_ros.simulation.robot import CLEARANCE, HEIGHT, LENGTH, WIDTH, Robot
from heightmap25d_ros.simulation.scene import Scene, Solid
from heightmap25d_ros.simulation.truth import RESOLUTION, Levels, Surface
from heightmap25d_ros.simulation.worlds import World

DECKS = ("garage", "overpass")
STEP = 0.05
Z = np.arange(-5.0, 5.0, STEP)


def inside(solids: Sequence[Solid], points: np.ndarray) -> np.ndarray:
    """Whether points (..., 3) are inside of any of the solids."""
    found = np.zeros(points.shape[:-1], bool)
    for solid in solids:
        turn = Rotation.from_euler("yz", [solid.pitch, solid.yaw]).as_matrix()
        scaled = np.abs((points - solid.center) @ turn) / solid.size
        if solid.kind == "box":
            found |= (scaled <= 1.0).all(axis=-1)
        elif solid.kind == "cylinder":
            found |= (np.hypot(scaled[..., 0], scaled[..., 1]) <= 1.0) & (scaled[..., 2] <= 1.0)
        else:
            found |= (scaled**2).sum(axis=-1) <= 1.0
    return found


def columns(world: World, places: np.ndarray, solids: Sequence[Solid]) -> np.ndarray:
    """(N, len(Z)): whether the heights Z at places (N, 2) are in solids or in the terrain."""
    points = np.concatenate(
        [np.repeat(places[:, None], len(Z), axis=1), np.tile(Z[:, None], (len(places), 1, 1))], -1
    )
    filled = inside(solids, points)
    if world.terrain is not None:
        filled |= Scene([], world.terrain).heights(places)[:, None] >= Z
    return filled


def somewhere(world: World, count: int) -> np.ndarray:
    """(N, 2) [m]: random places in a world."""
    return np.random.default_rng(0).uniform(*np.transpose(world.area), (count, 2))


@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_what_does_not_hang_is_complete_from_the_ground_up(name: str) -> None:
    """No room for the robot below it: beams would see it, the robot and the truth would not.

    Rocks overhang a little. What is below all of the drive, nothing sees.
    """
    world = world_of(name, 1)
    places = somewhere(world, 500)
    filled = columns(world, places, [solid for solid in world.solids if not solid.is_overhead])
    is_below = np.logical_or.accumulate(filled, axis=1)
    is_above = np.logical_or.accumulate(filled[:, ::-1], axis=1)[:, ::-1]
    is_seen = world.scene().heights(world.way, below=HEIGHT).min() < Z
    gap = (is_below & is_above & ~filled & is_seen).sum(axis=1) * STEP
    assert gap.max() < HEIGHT, places[gap.argmax()]


@pytest.mark.parametrize("name", DECKS)
def test_beams_end_at_the_solids(name: str) -> None:
    """Rays in all directions, from wherever it is free."""
    world, rng, reach = world_of(name, 12), np.random.default_rng(1), 8.0
    origins = np.column_stack([somewhere(world, 200), rng.uniform(0.0, 4.0, 200)])
    origins = origins[~inside(world.solids, origins)]
    directions = rng.normal(size=origins.shape)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    ranges, _ = world.scene().ranges(origins, directions)
    along = np.arange(0.0, reach, 0.02)
    met = inside(world.solids, origins[:, None] + along[:, None] * directions[:, None])
    first = np.where(met.any(axis=1), along[met.argmax(axis=1)], reach)
    # Steps along a ray miss an edge here and there, but never meet what the ray does not.
    off = first - np.minimum(ranges, reach)
    assert off.min() > -1e-6
    assert (off <= 0.02).mean() > 0.98


def floors(world: World, places: np.ndarray) -> list[np.ndarray]:
    """For each place the heights [m], at most `STEP` too low, on which the robot has room."""
    filled = columns(world, places, world.solids)
    above = np.lib.stride_tricks.sliding_window_view(filled[:, 1:], round(HEIGHT / STEP), axis=1)
    has_room = filled[:, : above.shape[1]] & ~above.any(axis=2)
    return [Z[: above.shape[1]][column] for column in has_room]


def seen_from(solids: Sequence[Solid], place: Sequence[float], yaw: float) -> list[Solid]:
    """Solids in the frame of a place (x, y, z) [m] and a heading [rad]."""
    turn = Rotation.from_euler("z", -yaw).as_matrix()
    return [
        replace(solid, center=tuple(turn @ np.subtract(solid.center, place)), yaw=solid.yaw - yaw)
        for solid in solids
    ]


def body(margin: float, low: float) -> tuple[np.ndarray, np.ndarray]:
    """Points of the robot's box, and of its sides: wider by a margin [m], from a height [m] up."""
    x, y, z = np.meshgrid(
        (LENGTH / 2 + margin) * np.linspace(-1.0, 1.0, 16),
        (WIDTH / 2 + margin) * np.linspace(-1.0, 1.0, 13),
        np.linspace(low, HEIGHT + margin, 8),
    )
    points = np.stack([x, y, z], axis=-1)
    is_side = (np.abs(x) == np.abs(x).max()) | (np.abs(y) == np.abs(y).max())
    return points, points[is_side]


@pytest.mark.parametrize("name", DECKS)
def test_the_robot_is_stopped_where_its_body_meets_a_solid(name: str) -> None:
    """On level ground wherever beams show some: below the decks, on them, beside the ramps."""
    world, rng = world_of(name, 34), np.random.default_rng(2)
    places = somewhere(world, 120)
    sides = [body(margin, CLEARANCE + 0.01)[1] for margin in (-0.04, 0.04)]
    around, _ = body(0.03, 0.02)
    met = {True: 0, False: 0}
    for place, heights in zip(places, floors(world, places), strict=True):
        for z in heights:
            yaw = float(rng.uniform(-np.pi, np.pi))
            solids = seen_from(world.solids, (*place, z), yaw)
            robot = Robot(Scene(solids))
            up = robot.T[:3, 3]
            if robot.T[2, 2] < 1.0 - 1e-9 or not 0.0 <= up[2] <= STEP:
                continue
            touches = all(inside(solids, side + up).any() for side in sides)
            stands = inside(solids, around[:, :, 0] - [0.0, 0.0, 0.04] + up).all()
            if touches or (stands and not inside(solids, around + up).any()):
                robot.move(0.05, 0.0, 0.02)
                assert robot.is_blocked is touches, (place, z, yaw)
                met[touches] += 1
    assert met[True] > 10
    assert met[False] > 30


@pytest.mark.parametrize("name", DECKS)
def test_the_truth_has_every_floor_with_room_for_the_robot(name: str) -> None:
    """Cells, at the border and in the middle of which there are the same floors."""
    world = world_of(name, 34)
    cells = np.unique(np.floor(somewhere(world, 80) / RESOLUTION), axis=0).astype(int)
    share = np.array([0.002, 0.5, 0.998])
    agreed = 0
    for cell in cells:
        x, y = (cell + 0.0) * RESOLUTION
        part = replace(world, area=((x, x + RESOLUTION), (y, y + RESOLUTION)))
        top, ground, clearance = Surface(part).heights(0.0)
        drivable = Levels(ground, ground + clearance).drivable(top, HEIGHT).ravel()
        corners = np.stack(np.meshgrid(x + share * RESOLUTION, y + share * RESOLUTION), -1)
        found = floors(world, corners.reshape(-1, 2))
        if len({len(one) for one in found}) > 1 or np.ptp(found, axis=0).max(initial=0.0) > STEP:
            continue
        expected = np.max(found, axis=0)
        told = np.unique(drivable[np.isfinite(drivable)])
        near = np.abs(told[:, None] - expected) <= 2 * STEP
        assert near.any(axis=0).all(), (x, y, told, expected)
        assert near.any(axis=1).all(), (x, y, told, expected)
        agreed += 1
    assert agreed > 30
