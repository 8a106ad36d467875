# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Worlds without anything to hold on to, worlds with repeats, and what slip does in them."""

from __future__ import annotations

from itertools import groupby, pairwise
from math import atan, cos, exp, radians, sin, sqrt

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from heightmap25d_ros.simulation import plain, recording, repeats
from heightmap25d_ros.simulation.lasers import (
    BEAMS,
    DOWN,
    EXACT_RANGES,
    LEVEL,
    Laser,
    take_scan,
)
from heightmap25d_ros.simulation.odometry import EXACT_ODOMETRY, Odometer, OdometryNoise
from heightmap25d_ros.simulation.pure_pursuit import Driver
from heightmap25d_ros.simulation.recording import world_of
from heightmap25d_ros.simulation.robot import MAX_SPEED, Robot
from heightmap25d_ros.simulation.scene import Scene

NAMES = sorted({**plain.BUILDERS, **repeats.BUILDERS})
SEEDS = range(1, 5)
WINDOW = 1.5
"""What is higher above the robot is not mapped [m]."""


def pose(x: float, y: float = 0.0, z: float = 0.0, pitch: float = 0.0, yaw: float = 0.0):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", [0.0, pitch, yaw]).as_matrix()
    T[:3, 3] = x, y, z
    return T


def seen_from(scene: Scene, laser: Laser, T: np.ndarray) -> np.ndarray:
    """(361, 3): what a scan meets, in base_link; NaN: nothing that is mapped."""
    poses = np.broadcast_to(T, (BEAMS, 4, 4))
    ends = take_scan(laser, scene, 0.0, poses, EXACT_RANGES, np.random.default_rng(0)).ends
    ends = np.where((ends[:, 2] - T[2, 3] <= WINDOW)[:, None], ends, np.nan)
    return (ends - T[:3, 3]) @ T[:3, :3]


def along_x(scene: Scene, x: np.ndarray, y: float) -> np.ndarray:
    return scene.heights(np.column_stack([x, np.full(len(x), y)]))


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("seed", "drive", "speed"), [(1, 0, None), (2, 1, MAX_SPEED)])
def test_world_is_drivable_along_its_drive(
    name: str, seed: int, drive: int, speed: float | None
) -> None:
    world = recording.another_drive(world_of(name, seed), seed, drive)
    world = recording.at_speed(world, speed)
    robot, driver = Robot(world.scene()), Driver(world.way, world.speed)
    seconds = 0.0
    while not driver.is_done:
        robot.move(*driver.command(robot.T), 0.02)
        seconds += 0.02
        assert not robot.is_blocked, robot.T[:3, 3]
        assert seconds < 300.0
    np.testing.assert_allclose(robot.T[:2, 3], world.way[-1], atol=0.15)


# Nothing to hold on to


@pytest.mark.parametrize("seed", SEEDS)
def test_plain_ramp_has_one_slope_between_level_ends(seed: int) -> None:
    world = world_of("plain_ramp", seed)
    scene = world.scene()
    x = np.arange(-2.0, world.way[-1, 0] + 1.0, 0.01)
    height = along_x(scene, x, 0.0)
    rise = height.max()
    on_ramp = (height > 1e-6) & (height < rise - 1e-6)
    slope, start = np.polyfit(x[on_ramp], height[on_ramp], 1)
    assert 0.08 <= slope <= 0.12
    assert 14.5 <= rise / slope <= 15.5
    expected = np.clip(slope * x + start, 0.0, rise)
    for y in (-0.9, 0.0, 0.9):
        np.testing.assert_allclose(along_x(scene, x, y), expected, atol=1e-6)
    foot, head = x[on_ramp][[0, -1]]
    assert foot > 3.0
    assert head + 4.0 < world.way[-1, 0]
    robot = Robot(scene)
    while robot.T[0, 3] < 0.5 * (foot + head):
        robot.move(1.0, 0.0, 0.02)
    assert np.arcsin(robot.T[2, 0]) == pytest.approx(atan(slope), abs=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("laser", [LEVEL, DOWN], ids=lambda laser: laser.topic)
def test_scans_on_the_plain_ramp_do_not_tell_where(seed: int, laser: Laser) -> None:
    scene = world_of("plain_ramp", seed).scene()
    x = np.linspace(5.0, 15.5, 8)
    z = along_x(scene, x, 0.0)
    pitch = -atan((z[-1] - z[0]) / (x[-1] - x[0]))
    scans = [seen_from(scene, laser, pose(x[i], z=z[i], pitch=pitch)) for i in range(len(x))]
    assert np.isfinite(scans[0]).any(axis=1).sum() > 200
    for scan in scans[1:]:
        np.testing.assert_allclose(scan, scans[0], atol=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", ["corridor", "plain_street"])
@pytest.mark.parametrize("laser", [LEVEL, DOWN], ids=lambda laser: laser.topic)
def test_scans_between_plain_walls_do_not_tell_where(name: str, seed: int, laser: Laser) -> None:
    world = world_of(name, seed)
    scene = world.scene()
    first, *others = (seen_from(scene, laser, pose(x, 0.1, yaw=0.02)) for x in (4.5, 9.3, 15.1, 22))
    assert np.isfinite(first).any(axis=1).sum() > 200
    for scan in others:
        np.testing.assert_allclose(scan, first, atol=1e-6)
    # It does where it sees the ends.
    for x in (0.0, world.way[-1, 0] - 3.0):
        scan = seen_from(scene, LEVEL, pose(x, 0.1, yaw=0.02))
        other = seen_from(scene, LEVEL, pose(15.1, 0.1, yaw=0.02))
        off = np.linalg.norm(np.nan_to_num(scan) - np.nan_to_num(other), axis=1)
        assert (off > 0.1).sum() > 5


@pytest.mark.parametrize("seed", SEEDS)
def test_street_is_flat_from_facade_to_facade(seed: int) -> None:
    scene = world_of("plain_street", seed).scene()
    x, y = np.meshgrid(np.arange(5.0, 54.9, 0.25), np.arange(-3.1, 3.15, 0.1))
    np.testing.assert_allclose(scene.heights(np.column_stack([x.ravel(), y.ravel()])), 0.0)


def plain_lengths(
    scene: Scene, start: tuple[float, float], end: tuple[float, float]
) -> list[float]:
    """Lengths [m] of the stretches where the walls on both sides keep their distance."""
    run = np.subtract(end, start)
    length = float(np.linalg.norm(run))
    ahead = run / length
    side = np.array([-ahead[1], ahead[0], 0.0])
    at = np.arange(0.0, length, 0.05)
    points = np.column_stack([start + at[:, None] * ahead, np.full(len(at), 0.4)])
    ranges = np.column_stack(
        [scene.ranges(points, np.broadcast_to(sign * side, points.shape))[0] for sign in (1, -1)]
    )
    same = (np.abs(np.diff(ranges, axis=0)) < 1e-6).all(axis=1)
    return [0.05 * len(list(group)) for is_same, group in groupby(same) if is_same]


@pytest.mark.parametrize("seed", SEEDS)
def test_court_is_a_long_loop_with_plain_stretches(seed: int) -> None:
    world = world_of("court", seed)
    steps = np.linalg.norm(np.diff(world.way, axis=0), axis=1)
    assert steps.sum() == pytest.approx(204.0, abs=3.0)
    end = world.way[-1]
    assert end[0] > 3.0
    assert end[1] == 0.0  # again where it began, along the same line
    corners = [(-10.0, 0.0), (52.0, 0.0), (52.0, 38.0), (-10.0, 38.0), (-10.0, 0.0)]
    scene = world.scene()
    for start, end in pairwise(corners):
        lengths = plain_lengths(scene, start, end)
        assert max(lengths) >= 20.0
        assert len(lengths) > 3  # and doors and niches between
    assert sum(length >= 20.0 for length in plain_lengths(scene, *corners[:2])) >= 2


# Repeats


@pytest.mark.parametrize("seed", SEEDS)
def test_pillars_are_four_metres_apart(seed: int) -> None:
    scene = world_of("pillars", seed).scene()
    x = np.arange(-2.0, 56.0, 0.001)
    wall = float(scene.ranges([-1.5, 0.0, 0.4], [[0.0, 1.0, 0.0]])[0][0])
    for y in (wall - 0.1, 0.1 - wall):
        is_pillar = along_x(scene, x, y) > 1.0
        begins = x[1:][np.diff(is_pillar.astype(int)) == 1]
        ends = x[1:][np.diff(is_pillar.astype(int)) == -1]
        assert len(begins) >= 13
        for edges in (begins, ends):
            np.testing.assert_allclose(np.diff(edges), 4.0, atol=0.0011)
    between = along_x(scene, x, 0.0)
    np.testing.assert_array_equal(between, 0.0)


@pytest.mark.parametrize("seed", SEEDS)
def test_scans_repeat_every_four_metres_between_pillars(seed: int) -> None:
    scene = world_of("pillars", seed).scene()
    first, again, off = (seen_from(scene, LEVEL, pose(x, 0.1, yaw=0.02)) for x in (5.0, 9.0, 10.0))
    near = np.linalg.norm(np.nan_to_num(first), axis=1) < 20.0
    assert near.sum() > 300
    np.testing.assert_allclose(again[near], first[near], atol=1e-6)
    assert (np.abs(off - first)[near] > 0.1).sum() > 20


def room_points(apart: float = 0.0) -> np.ndarray:
    """Over the first room with its walls, every 6 cm or so; moved along x [m]."""
    x, y = np.meshgrid(np.arange(-2.229, 5.169, 0.061), np.arange(-2.169, 4.479, 0.061))
    return np.column_stack([x.ravel() + apart, y.ravel()])


def shifts_of_equal_rooms(scene: Scene) -> list[float]:
    """By which whole cells [m] the first room is found again."""
    first = scene.heights(room_points())
    shifts = 0.125 * np.arange(64, 97)
    return [
        float(shift)
        for shift in shifts
        if np.abs(scene.heights(room_points(shift)) - first).max() < 1e-9
    ]


@pytest.mark.parametrize("seed", SEEDS)
def test_twin_rooms_are_equal(seed: int) -> None:
    world = world_of("twin_rooms", seed)
    scene = world.scene()
    (apart,) = shifts_of_equal_rooms(scene)
    assert 9.0 <= apart <= 10.0
    assert len(np.unique(scene.heights(room_points()).round(3))) >= 6  # furnished
    # Away from the doors, scans are equal as well.
    for x, y, yaw in ((0.0, 0.0, -1.57), (3.0, 0.1, -1.4), (3.2, 2.5, -1.6)):
        first, second = (
            seen_from(scene, LEVEL, pose(x + shift, y, yaw=yaw)) for shift in (0.0, apart)
        )
        np.testing.assert_allclose(second, first, atol=1e-6)
    # Both are driven through, along the same lap.
    for shift in (0.0, apart):
        lap = np.array([(2.0, 0.0), (3.4, 1.5), (2.0, 2.9)]) + (shift, 0.0)
        near = np.linalg.norm(dense(world.way)[:, None] - lap, axis=2).min(axis=0)
        assert near.max() < 0.1


def dense(path: np.ndarray) -> np.ndarray:
    return np.concatenate([np.linspace(a, b, 100) for a, b in pairwise(path)])


# Slip


def driven(noise: OdometryNoise, seed: int, T: list[np.ndarray]) -> np.ndarray:
    odometer = Odometer(noise, np.random.default_rng(seed))
    for before, after in pairwise(T):
        odometer.advance(before, after, 0.3)
    return odometer.T


def slipping(slip: float) -> OdometryNoise:
    return OdometryNoise(
        translation_bias=0.0, rotation_bias=0.0, heading_bias=0.0, heading_walk=0.0,
        tilt_sigma=0.0, slip=slip,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("slip", [0.055, 0.165])
def test_slip_has_the_spread_of_a_gauss_markov_error(slip: float) -> None:
    """Its integral over a distance d: variance 2 s^2 l (d - l (1 - exp(-d / l)))."""
    distance, lasts = 15.0, OdometryNoise().slip_length
    T = [pose(x) for x in np.linspace(0.0, distance, 61)]
    errors = [driven(slipping(slip), seed, T)[0, 3] - distance for seed in range(400)]
    expected = slip * sqrt(2.0 * lasts * (distance - lasts * (1.0 - exp(-distance / lasts))))
    assert np.std(errors) == pytest.approx(expected, rel=0.12)
    assert np.mean(errors) == pytest.approx(0.0, abs=3.0 * expected / 20.0)


def test_slip_on_a_slope_is_along_the_slope() -> None:
    pitch = radians(6.0)
    ahead = np.array([cos(pitch), 0.0, sin(pitch)])
    T = [pose(*(s * ahead), pitch=-pitch) for s in np.linspace(0.0, 15.0, 31)]
    error = driven(slipping(0.165), 4, T)[:3, 3] - 15.0 * ahead
    assert np.linalg.norm(error) > 0.1
    np.testing.assert_allclose(np.cross(error, ahead), 0.0, atol=1e-9)


def test_slip_of_the_options() -> None:
    noise = recording.noise_of(noise_free=False, true_odometry=False, slip=0.165)
    assert noise.odometry == OdometryNoise(slip=0.165)
    assert noise.ranges == recording.noise_of(noise_free=False, true_odometry=False).ranges
    exact = recording.noise_of(noise_free=False, true_odometry=True)
    assert exact.odometry == EXACT_ODOMETRY
    assert recording.noise_of(noise_free=False, true_odometry=False, slip=0.0) != exact
