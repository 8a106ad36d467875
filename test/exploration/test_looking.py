# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros.exploration.looking import full_turn, headings_to_see
from heightmap25d_ros.planning.plan import Pose2D

BLIND = 1.4


def turned_over(yaw, headings):
    """The headings that the robot has on its way, turning by the smaller angle each time."""
    at, result = yaw, [yaw]
    for heading in headings:
        turn = math.remainder(heading - at, 2 * math.pi)
        result += list(at + np.linspace(0.0, turn, 200))
        at += turn
    return np.array(result)


def crossed(points, robot, headings):
    """Whether the line across the robot, at the blind radius ahead, went over each point."""
    yaws = turned_over(robot.yaw, headings)
    ahead = np.cos(yaws)[:, None] * (points[:, 0] - robot.x)
    ahead += np.sin(yaws)[:, None] * (points[:, 1] - robot.y)
    side = np.sign(ahead - BLIND)
    return (side.min(axis=0) < 0) & (side.max(axis=0) > 0)


@draws(100)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_all_points_come_onto_the_line(seed, count):
    rng = np.random.default_rng(seed)
    robot = Pose2D(*rng.uniform(-5, 5, 2), yaw=float(rng.uniform(-3, 3)))
    angle, away = rng.uniform(-np.pi, np.pi, count), rng.uniform(1.5, 5.0, count)
    points = np.column_stack([robot.x + away * np.cos(angle), robot.y + away * np.sin(angle)])
    headings = headings_to_see(points, robot, BLIND)
    assert crossed(points, robot, headings).all()
    steps = np.diff([robot.yaw, *headings])
    assert (np.abs((steps + np.pi) % (2 * np.pi) - np.pi) < 2.01).all()


@draws(60)
@given(st.integers(0, 2**32 - 1))
def test_it_does_not_turn_farther_than_needed(seed):
    rng = np.random.default_rng(seed)
    robot = Pose2D(0.0, 0.0, yaw=float(rng.uniform(-3, 3)))
    angle, away = rng.uniform(-np.pi, np.pi, 3), rng.uniform(1.5, 5.0, 3)
    points = np.column_stack([away * np.cos(angle), away * np.sin(angle)])
    total = np.abs(np.diff(turned_over(robot.yaw, headings_to_see(points, robot, BLIND)))).sum()
    # Every turn to one side and then to another one, in steps of a degree.
    degrees = np.radians(np.arange(0, 361))
    best = math.inf
    for first in (1, -1):
        for far in degrees:
            one = robot.yaw + first * np.linspace(0.0, far, 200)
            if far + 0.0 >= best:
                break
            rest = [p for p, ok in zip(points, _line_passes(points, one), strict=True) if not ok]
            if not rest:
                best = min(best, far)
                break
            other = [_angle_to(p, robot.yaw, -first) for p in rest]
            best = min(best, 2 * far + max(other))
    assert total <= best + 3 * 0.36 + 0.05


def _line_passes(points, yaws):
    ahead = np.cos(yaws)[:, None] * points[:, 0] + np.sin(yaws)[:, None] * points[:, 1]
    side = np.sign(ahead - BLIND)
    return side.min(axis=0) != side.max(axis=0)


def _angle_to(point, yaw, sign):
    bearing, away = math.atan2(point[1], point[0]), math.hypot(*point)
    aside = math.acos(min(1.0, BLIND / away))
    return min((sign * (bearing + s - yaw)) % (2 * math.pi) for s in (-aside, aside))


def test_a_full_turn_comes_back():
    headings = full_turn(1.0)
    assert headings[-1] == pytest.approx(1.0)
    swept = turned_over(1.0, headings)
    assert swept[-1] - swept[0] == pytest.approx(2 * math.pi)
