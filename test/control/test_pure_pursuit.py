# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controller drives an ideal unicycle: exact motion along arcs, with the commanded velocity."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws
from scipy.spatial import cKDTree

from heightmap25d_ros.control.pure_pursuit import PathFollower, Surroundings
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.params.sections import PathFollowerParams

PARAMS = PathFollowerParams()
STEP = 0.02


def pose(x, y, yaw):
    T = np.eye(4)
    T[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    T[:2, 3] = x, y
    return T


def path(*points, yaw=None):
    """A path along straight lines, with the heading of the last one unless another is given."""
    points = np.array(points, float)
    step = np.diff(points, axis=0)
    heading = np.arctan2(step[:, 1], step[:, 0]) if len(step) else np.zeros(0)
    last = (heading[-1] if len(step) else 0.0) if yaw is None else yaw
    return np.column_stack([points, np.append(heading, last)])


def drive(followed, start, *, params=PARAMS, around=None, seconds=90.0):
    """States (N, 5): x, y, yaw, speed, turn rate, until the path's end."""
    follower = PathFollower(followed, params)
    x, y, yaw = start
    states = []
    for _ in range(round(seconds / STEP)):
        velocity = follower.command(pose(x, y, yaw), STEP, around)
        if follower.is_done and not velocity.speed and not velocity.turn_rate:
            break
        middle = yaw + 0.5 * velocity.turn_rate * STEP
        x += velocity.speed * STEP * math.cos(middle)
        y += velocity.speed * STEP * math.sin(middle)
        yaw += velocity.turn_rate * STEP
        states.append((x, y, yaw, velocity.speed, velocity.turn_rate))
    assert follower.is_done
    return np.array(states)


def distance_to(followed, states):
    """Largest distance of the driven points from the path."""
    points = followed[:, :2]
    at = np.linspace(0, len(points) - 1, 1000)
    fine = np.column_stack([np.interp(at, np.arange(len(points)), points[:, n]) for n in (0, 1)])
    return cKDTree(fine).query(states[:, :2])[0].max()


def test_a_straight_line():
    states = drive(path((0, 0), (5, 0)), (0, 0, 0))
    assert states[-1, 0] == pytest.approx(5.0, abs=PARAMS.goal_tolerance)
    assert np.abs(states[:, 1]).max() < 1e-9
    assert states[:, 3].max() == pytest.approx(PARAMS.max_speed)


@draws(40)
@given(st.integers(0, 2**32 - 1))
def test_limits_hold_on_any_path_and_its_end_is_reached(seed):
    rng = np.random.default_rng(seed)
    steps = rng.uniform(-1.5, 1.5, (rng.integers(1, 6), 2))
    followed = path((0, 0), *np.cumsum(steps, axis=0), yaw=float(rng.uniform(-3, 3)))
    states = drive(followed, (0, 0, float(rng.uniform(-3, 3))))
    away = math.hypot(*(states[-1, :2] - followed[-1, :2]))
    off = math.remainder(states[-1, 2] - followed[-1, 2], 2 * math.pi)
    assert away < PARAMS.goal_tolerance + 0.05
    assert abs(off) < PARAMS.yaw_tolerance + 0.05
    speed, rate = states[:, 3], states[:, 4]
    assert speed.min() >= -1e-9
    assert speed.max() <= PARAMS.max_speed + 1e-9
    assert np.abs(rate).max() <= PARAMS.max_turn_rate + 1e-9
    assert np.abs(np.diff(speed)).max(initial=0) <= PARAMS.max_acceleration * STEP + 1e-9
    assert np.abs(np.diff(rate)).max(initial=0) <= PARAMS.max_turn_acceleration * STEP + 1e-9


@draws(30)
@given(st.integers(0, 2**32 - 1))
def test_it_stays_near_its_path(seed):
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.6, 2.0, (4, 2)) * rng.choice([-1, 1], (4, 2))
    followed = path((0, 0), *np.cumsum(steps, axis=0))
    states = drive(followed, (0, 0, followed[0, 2]))
    assert distance_to(followed, states) < 0.2


def test_a_sharp_corner_is_turned_at_on_the_spot():
    followed = path((0, 0), (2, 0), (2, 2))
    states = drive(followed, (0, 0, 0))
    assert distance_to(followed, states) < 0.1
    turning = (np.abs(states[:, 4]) > 0.3) & (np.abs(states[:, 2] - math.pi / 4) < 0.3)
    assert states[turning, 3].max() < PARAMS.min_speed + 1e-9


def test_a_gentle_curve_is_driven_through():
    angle = np.linspace(0, math.pi / 2, 30)
    arc = np.column_stack([3 * np.sin(angle), 3 - 3 * np.cos(angle)])
    states = drive(path(*arc), (0, 0, 0))
    middle = states[len(states) // 3 : -len(states) // 3]
    assert middle[:, 3].min() > 0.8 * PARAMS.max_speed
    assert distance_to(path(*arc), states) < 0.1


@pytest.mark.parametrize("turn", [0.5, -2.5, 3.1])
def test_one_pose_is_turned_to_on_the_spot(turn):
    states = drive(path((0.2, 0.1), yaw=turn), (0, 0, 0))
    assert np.abs(states[:, :2]).max() < 1e-9
    assert math.remainder(states[-1, 2] - turn, 2 * math.pi) == pytest.approx(0, abs=0.15)


def test_it_is_slower_on_slopes_and_beside_obstacles():
    line = path((0, 0), (8, 0))
    free = drive(line, (0, 0, 0))[:, 3].max()
    steep = drive(line, (0, 0, 0), around=Surroundings(slope=0.3))[:, 3].max()
    near = drive(line, (0, 0, 0), around=Surroundings(clearance=0.1))[:, 3].max()
    assert steep == pytest.approx(free * (1 - 0.3 / PARAMS.slope_stop))
    assert near == pytest.approx(free * 0.1 / PARAMS.slow_distance)
    touching = drive(line, (0, 0, 0), around=Surroundings(clearance=-0.2))[:, 3].max()
    assert touching == pytest.approx(PARAMS.min_speed)


def test_it_stops_before_the_end_and_not_behind_it():
    states = drive(path((0, 0), (6, 0)), (0, 0, 0), params=PathFollowerParams(max_speed=2.0))
    assert states[:, 0].max() < 6.0 + 0.02


def test_a_path_that_crosses_itself_is_followed_in_order():
    eight = path((0, 0), (4, 0), (4, 2), (2, 2), (2, -2))
    states = drive(eight, (0, 0, 0))
    assert states[:, 0].max() > 3.9
    assert np.hypot(*(states[-1, :2] - (2, -2))) < 0.15


@pytest.mark.parametrize("values", [{"min_speed": 2.0}, {"min_lookahead": 2.0}])
def test_limits_that_contradict_each_other_are_refused(values):
    with pytest.raises(InputError, match=r"path_follower\.min_"):
        PathFollowerParams(**values)
