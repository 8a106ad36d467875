# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulator against closed forms: where beams end, how wheels stand, how sensors err."""

from __future__ import annotations

from itertools import pairwise
from math import atan2, cos, degrees, hypot, inf, pi, radians, sin, tan

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from heightmap25d_ros.simulation import goals
from heightmap25d_ros.simulation.lasers import (
    ANGLES,
    BEAMS,
    DOWN,
    EXACT_RANGES,
    LEVEL,
    NODDING,
    RANGE_MAX,
    SCAN_DURATION,
    RangeNoise,
    beam_times,
    measured,
    take_scan,
)
from heightmap25d_ros.simulation.odometry import EXACT_ODOMETRY, Odometer, OdometryNoise
from heightmap25d_ros.simulation.recording import BUILDERS, world_of
from heightmap25d_ros.simulation.robot import MAX_STEP, Robot
from heightmap25d_ros.simulation.scene import Mover, Scene, Solid, Terrain, box, cylinder, ramp
from heightmap25d_ros.simulation.worlds import distance_to_way, floor

RNG = np.random.default_rng(0)


def standing(x: float = 0.0, y: float = 0.0, yaw: float = 0.0, count: int = BEAMS) -> np.ndarray:
    T = np.eye(4)
    T[:2, :2] = [[cos(yaw), -sin(yaw)], [sin(yaw), cos(yaw)]]
    T[:2, 3] = x, y
    return np.broadcast_to(T, (count, 4, 4))


def exact_ranges(laser, scene, T):
    return take_scan(laser, scene, 0.0, T, EXACT_RANGES, np.random.default_rng(0)).ranges


# Beams


def test_wall_at_a_known_distance() -> None:
    scene = Scene([box((5.0, 5.2), (-50.0, 50.0), (-1.0, 3.0))])
    ranges = exact_ranges(LEVEL, scene, standing())
    with np.errstate(divide="ignore"):
        expected = (5.0 - LEVEL.position[0]) / np.cos(ANGLES)
    expected[expected > RANGE_MAX] = inf
    inside = np.abs(np.degrees(ANGLES)) < 80.0
    np.testing.assert_allclose(ranges[inside], expected[inside], rtol=1e-9)
    assert ranges[0] == ranges[-1] == inf


def test_ground_below_a_pitched_laser() -> None:
    ranges = exact_ranges(DOWN, Scene([floor()]), standing())
    drop = np.cos(ANGLES) * sin(DOWN.pitch)
    expected = np.full(BEAMS, inf)
    np.divide(DOWN.position[2], drop, where=drop > DOWN.position[2] / RANGE_MAX, out=expected)
    np.testing.assert_allclose(ranges, expected, rtol=1e-9)


def test_robot_pitched_down_sees_the_ground_with_its_level_laser() -> None:
    pitch = radians(8.0)
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("y", pitch).as_matrix()
    ranges = exact_ranges(LEVEL, Scene([floor()]), np.broadcast_to(T, (BEAMS, 4, 4)))
    laser_z = LEVEL.position[2] * cos(pitch) - LEVEL.position[0] * sin(pitch)
    assert ranges[BEAMS // 2] == pytest.approx(laser_z / sin(pitch), rel=1e-9)


def test_cylinder_ellipsoid_and_turned_box() -> None:
    scene = Scene(
        [
            cylinder(4.0, 0.0, 0.5, (0.0, 2.0)),
            Solid(kind="ellipsoid", center=(0.0, 4.0, 0.4), size=(1.0, 0.5, 0.3)),
            box((-5.0, -3.0), (-1.0, 1.0), (0.0, 1.0), yaw=pi / 4),
        ]
    )
    directions = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    ranges, _ = scene.ranges([0.0, 0.0, 0.4], directions)
    np.testing.assert_allclose(ranges, [3.5, 3.5, 4.0 - 2.0**0.5, inf], rtol=1e-6)


def test_height_field_is_met_where_it_is() -> None:
    x, y = np.arange(61) * 0.1 - 2.0, np.arange(81) * 0.1 - 3.0
    height = 0.3 * x[None, :] - 0.2 * y[:, None] + 0.5
    scene = Scene([], Terrain(height=height, origin=(-2.0, -3.0), spacing=0.1))
    points = RNG.uniform([-1.9, -2.9], [3.9, 4.9], (200, 2))
    expected = 0.3 * points[:, 0] - 0.2 * points[:, 1] + 0.5
    np.testing.assert_allclose(scene.heights(points), expected, atol=1e-5)


def test_each_beam_has_its_own_pose() -> None:
    """While turning fast, a beam points where the robot points at its own time."""
    scene = Scene([box((5.0, 5.2), (-50.0, 50.0), (-1.0, 3.0))])
    yaws = 1.5 * beam_times(0.0)
    T = np.array([standing(yaw=yaw, count=1)[0] for yaw in yaws])
    scan = take_scan(LEVEL, scene, 0.0, T, EXACT_RANGES, np.random.default_rng(0))
    origins = T[:, :3, :3] @ np.array(LEVEL.position)
    inside = np.abs(np.degrees(ANGLES)) < 70.0
    expected = (5.0 - origins[:, 0]) / np.cos(ANGLES + yaws)
    np.testing.assert_allclose(scan.ranges[inside], expected[inside], rtol=1e-9)
    assert degrees(yaws[-1]) > 1.0
    assert beam_times(3.0)[-1] == pytest.approx(3.0 + SCAN_DURATION * 360 / 361)


def test_nodding_laser_nods() -> None:
    pitch = np.array(
        [-np.arcsin(T[2, 0]) for T in NODDING.T_base_sensor(np.array([0.0, 0.75, 2.25]))]
    )
    np.testing.assert_allclose(np.degrees(pitch), [25.0, 50.0, 0.0], atol=1e-9)


def test_what_moves_is_met_where_it_is_then() -> None:
    here = Mover(
        solid=box((-0.5, 0.5), (-0.5, 0.5), (-0.5, 0.5)),
        center_at=lambda seconds: (3.0 + seconds, 0.0, 0.5) if seconds < 5.0 else None,
    )
    scene = Scene([floor()], movers=[here])
    ahead = np.array([[1.0, 0.0, 0.0]])
    for seconds, expected in ((0.0, 2.5), (2.0, 4.5), (6.0, inf)):
        scene.set_time(seconds)
        ranges, mover = scene.ranges([0.0, 0.0, 0.5], ahead)
        assert ranges[0] == pytest.approx(expected)
        assert mover[0] == (0 if expected < inf else -1)


# Noise


def test_exact_ranges_are_exact() -> None:
    ranges = np.array([1.0, 29.9, 30.1, inf, 0.01])
    expected = [1.0, 29.9, inf, inf, inf]
    np.testing.assert_array_equal(measured(ranges, EXACT_RANGES, RNG), expected)


def test_range_noise_has_its_spread_and_steps() -> None:
    noise = RangeNoise(dropout=0.0, short=0.0, mixed=0.0)
    error = measured(np.full(100_000, 5.0), noise, np.random.default_rng(1)) - 5.0
    assert error.mean() == pytest.approx(0.0, abs=1e-4)
    assert error.std() == pytest.approx(0.01, rel=0.02)
    np.testing.assert_allclose(error * 1000, np.rint(error * 1000), atol=1e-6)


def test_dropouts_and_short_returns_are_as_many_as_said() -> None:
    noise = RangeNoise(sigma=0.0, step=0.0, mixed=0.0, dropout=0.02, short=0.01)
    result = measured(np.full(200_000, 10.0), noise, np.random.default_rng(2))
    assert np.isinf(result).mean() == pytest.approx(0.02 * 1.0, rel=0.1)
    is_short = result < 10.0
    assert is_short.mean() == pytest.approx(0.01, rel=0.1)
    # Uniform over the way: mean in the middle, spread of a twelfth.
    assert result[is_short].mean() == pytest.approx(5.0, rel=0.05)
    assert result[is_short].std() == pytest.approx(10.0 / 12**0.5, rel=0.05)


def test_mixed_pixels_lie_between_their_neighbours() -> None:
    noise = RangeNoise(sigma=0.0, step=0.0, dropout=0.0, short=0.0)
    true = np.where(np.arange(200_000) // 10 % 2 == 0, 2.0, 6.0)
    result = measured(true, noise, np.random.default_rng(3))
    changed = np.flatnonzero(result != true)
    assert len(changed) == pytest.approx(0.15 * 19_999, rel=0.05)
    assert ((result[changed] > 2.0) & (result[changed] < 6.0)).all()
    assert set(changed % 10) == {0, 9}  # beside a step only
    near = np.abs(np.arange(200_000) % 10 * 0.0) + 2.0 + 0.05 * (np.arange(200_000) % 2)
    np.testing.assert_array_equal(measured(near, noise, RNG), near)


def test_only_ranges_and_infinity_by_rep_117() -> None:
    true = np.where(np.arange(BEAMS) % 3 == 0, inf, RNG.uniform(0.06, 40.0, BEAMS))
    result = measured(true, RangeNoise(short=0.05, dropout=0.05), RNG)
    finite = np.isfinite(result)
    assert (result[~finite] == inf).all()
    assert ((result[finite] >= 0.05) & (result[finite] <= RANGE_MAX)).all()


# Robot


def drive(robot: Robot, speed: float, turn_rate: float, seconds: float) -> None:
    for _ in range(round(seconds / 0.005)):
        robot.move(speed, turn_rate, 0.005)


def test_robot_goes_straight_and_around() -> None:
    robot = Robot(Scene([floor()]))
    drive(robot, 1.0, 0.0, 3.0)  # a second to come to speed
    np.testing.assert_allclose(robot.T[:3, 3], [2.5, 0.0, 0.0], atol=0.01)
    drive(robot, 0.0, 0.0, 1.5)
    drive(robot, 0.0, 1.0, 2.0)
    assert atan2(robot.T[1, 0], robot.T[0, 0]) == pytest.approx(2.0 - 0.5 / 3.0, abs=0.01)


def test_robot_stands_on_a_ramp() -> None:
    slope = radians(10.0)
    scene = Scene([floor(), ramp((1.0, 11.0), (-2.0, 2.0), (0.0, 10 * tan(slope)), thickness=3.0)])
    robot = Robot(scene)
    drive(robot, 1.0, 0.0, 4.5)
    x, y, z = robot.T[:3, 3]
    assert 3.0 < x < 4.5
    assert y == pytest.approx(0.0, abs=1e-9)
    assert z == pytest.approx((x - 1.0) * tan(slope), abs=1e-6)
    roll, pitch, _ = Rotation.from_matrix(robot.T[:3, :3]).as_euler("xyz")
    assert pitch == pytest.approx(-slope, abs=1e-6)
    assert roll == pytest.approx(0.0, abs=1e-6)


def test_robot_leans_on_a_side_slope() -> None:
    x = np.arange(-30, 90) * 0.1
    height = np.broadcast_to(0.2 * (np.arange(80) * 0.1 - 4.0)[:, None], (80, len(x)))
    robot = Robot(Scene([], Terrain(height=height, origin=(x[0], -4.0), spacing=0.1)))
    roll = Rotation.from_matrix(robot.T[:3, :3]).as_euler("xyz")[0]
    assert roll == pytest.approx(atan2(0.2, 1.0), abs=1e-4)


@pytest.mark.parametrize(
    ("step", "passes"), [(0.05, True), (0.095, True), (0.105, False), (0.15, False), (-0.15, False)]
)
def test_robot_climbs_low_steps_only(step: float, passes: bool) -> None:
    assert MAX_STEP == 0.10
    robot = Robot(Scene([floor(-1.0), box((-5.0, 2.0), (-5.0, 5.0), (-1.0, 0.0)),
                         box((2.0, 9.0), (-5.0, 5.0), (-1.0, step))]))  # fmt: skip
    drive(robot, 0.8, 0.0, 6.0)
    assert robot.is_blocked is not passes
    assert bool(robot.T[0, 3] > 3.5) is passes
    if passes:
        assert robot.T[2, 3] == pytest.approx(step, abs=1e-9)
    else:
        assert robot.speed == 0.0
        drive(robot, -0.8, 0.0, 1.5)
        assert not robot.is_blocked  # back it can


@pytest.mark.parametrize(("clear", "passes"), [(0.6, False), (0.8, True)])
def test_robot_passes_gates_that_are_high_enough(clear: float, passes: bool) -> None:
    lintel = box((2.0, 2.3), (-1.0, 1.0), (clear, clear + 0.3), is_overhead=True)
    robot = Robot(Scene([floor(), lintel]))
    drive(robot, 0.8, 0.0, 6.0)
    assert bool(robot.T[0, 3] > 3.5) is passes
    assert robot.T[2, 3] == pytest.approx(0.0, abs=1e-9)


def test_body_does_not_pass_through_posts() -> None:
    robot = Robot(Scene([floor(), cylinder(2.0, 0.0, 0.05, (0.0, 1.0))]))
    drive(robot, 0.8, 0.0, 6.0)
    assert robot.is_blocked
    assert robot.T[0, 3] == pytest.approx(1.95 - 0.39, abs=0.06)


# Odometry


def lap(count: int = 1500) -> np.ndarray:
    """A level ring of the length of a lap in the paper's room, 26.4 m, as poses at 50 Hz."""
    radius, angle = 26.4 / (2 * pi), np.linspace(0.0, 2 * pi, count)
    T = np.array([standing(yaw=a, count=1)[0] for a in angle])
    T[:, 0, 3], T[:, 1, 3] = radius * np.sin(angle), radius * (1.0 - np.cos(angle))
    return T


def test_exact_odometry_keeps_the_lap() -> None:
    T, odometer = lap(), Odometer(EXACT_ODOMETRY, RNG)
    for before, after in pairwise(T):
        odometer.advance(before, after, 0.02)
    np.testing.assert_allclose(odometer.T, T[-1], atol=1e-3)


@pytest.mark.slow
def test_drift_over_a_lap_is_that_of_the_paper() -> None:
    """0.69 m and 6 degrees there; here the root mean squares over 30 drives."""
    T = lap(700)
    ends = []
    for seed in range(30):
        odometer = Odometer(OdometryNoise(), np.random.default_rng(seed))
        for before, after in pairwise(T):
            odometer.advance(before, after, 26.4 / 700)
        yaw = atan2(odometer.T[1, 0], odometer.T[0, 0])
        ends.append((*(odometer.T - T[-1])[:3, 3], degrees(yaw)))
    x, y, z, yaw = np.sqrt((np.array(ends) ** 2).mean(axis=0))
    assert hypot(x, y) == pytest.approx(0.69, abs=0.20)
    assert yaw == pytest.approx(6.0, abs=1.5)
    assert 0.005 < z < 0.08


def test_inclinometer_errs_by_its_sigma() -> None:
    odometer = Odometer(OdometryNoise(), np.random.default_rng(5))
    poses = [odometer.advance(np.eye(4), np.eye(4), 0.02) for _ in range(8000)]
    tilt = Rotation.from_matrix(np.array(poses)[:, :3, :3]).as_euler("xyz")[:, :2]
    assert np.degrees(tilt.std()) == pytest.approx(0.3, rel=0.15)
    assert odometer.T[:3, 3].tolist() == [0.0, 0.0, 0.0]  # standing, it does not drift


# Worlds and their truth


@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_world_starts_level_on_ground_zero(name: str) -> None:
    for seed in (1, 2):
        world = world_of(name, seed)
        np.testing.assert_allclose(Robot(world.scene()).T, np.eye(4), atol=2e-3)
        np.testing.assert_array_equal(world.way[0], [0.0, 0.0])
        np.testing.assert_array_equal(np.mod(np.array(world.area), 0.125), 0.0)


@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_seed_varies_the_world(name: str) -> None:
    first, again, other = (world_of(name, seed).scene() for seed in (1, 1, 2))
    points = np.random.default_rng(0).uniform((0.0, -3.0), (15.0, 6.0), (4000, 2))
    np.testing.assert_array_equal(first.heights(points), again.heights(points))
    assert (first.heights(points) != other.heights(points)).any()


def sampled(height, each=8):
    """Samples of a surface that is level in each of its cells."""
    return height.repeat(each, axis=-2).repeat(each, axis=-1)


def test_goals_beyond_a_wall_are_not_reachable() -> None:
    height = np.zeros((64, 96))
    height[:, 60:62] = 0.3
    seen = np.ones(height.shape, bool)
    seen[:, 30:33] = False
    driven = np.array([[32, column] for column in range(10, 20)])
    z = np.zeros(len(driven))
    pairs = goals.choose(
        height[None], sampled(height[None]), seen[None], driven, z, np.random.default_rng(0)
    )
    assert not pairs.goal[:, 0].any()
    reachable, beyond = pairs.goal[pairs.reachable, 1:], pairs.goal[~pairs.reachable, 1:]
    assert len(reachable) == len(beyond) == goals.WANTED
    assert (reachable[:, 1] < 60 - 5).all()
    assert (beyond[:, 1] > 61).mean() > 0.9
    np.testing.assert_array_equal(pairs.observed[pairs.reachable], reachable[:, 1] < 30)


def test_ground_of_both_levels_is_reachable_by_either_of_them():
    """Beside the edge of a deck the ramp is closed as seen from below it."""
    lower = np.tile(np.clip(0.05 * (np.arange(96) - 20), 0.0, 2.0), (64, 1))
    upper = lower.copy()
    lower[:, 60:] = 0.0  # below the deck, to which the ramp leads up
    seen = np.ones((2, *lower.shape), bool)
    driven = np.array([[32, column] for column in range(10, 60)])
    z = upper[tuple(driven.T)]
    levels = np.stack([lower, upper])
    pairs = goals.choose(levels, sampled(levels), seen, driven, z, np.random.default_rng(0))
    level, _, column = pairs.goal[~pairs.reachable].T
    assert ((level == 0) & (column >= 60 - 1)).all()


def test_free_is_a_disc_from_steps_and_from_steep_slopes() -> None:
    height = np.zeros((40, 80))
    height[20, 20] = 0.11
    height[20, 60] = 0.09
    is_free = goals.free(height, 0.5)
    assert not is_free[20, 24]
    assert is_free[20, 20 + 6]
    assert is_free[20, 56:65].all()
    x = np.arange(80) * 0.125
    for slope, expected in ((0.40, True), (0.48, False)):
        ramp_up = np.broadcast_to(np.tan(slope) * x, (40, 80))
        assert goals.free(ramp_up * 1.0, 0.0)[20, 40] == (expected and 0.125 * tan(slope) < 0.1)


def test_distance_to_way() -> None:
    way = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]])
    x, y = np.array([2.0, 6.0, -3.0]), np.array([1.0, 2.0, 4.0])
    np.testing.assert_allclose(distance_to_way(way, x, y), [1.0, 2.0, 5.0])
