# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Hypotheses in two rooms, of which one has two walls more than the other."""

from __future__ import annotations

import numpy as np
import pytest
from landmark_worlds import Wall, beams_to, ground_returns, mapped, wall_returns

from heightmap25d_ros import se3
from heightmap25d_ros.localization.hypotheses import Hypotheses
from heightmap25d_ros.localization.long_term_map import LongTermMap
from heightmap25d_ros.localization.odometry_errors import unknown_errors
from heightmap25d_ros.localization.pose_filter import PoseFilter
from heightmap25d_ros.localization.scan_filter import ScanFilter
from heightmap25d_ros.localization.tracker import Tracker
from heightmap25d_ros.params.sections import LocalizationParams, Params

PARAMS = Params()
APART = 8.0  # [m] from one room to the other, along x


def room(x: float, *, has_walls: bool) -> tuple[Wall, ...]:
    corners = [(x - 2.4, -1.2), (x + 2.4, -1.2), (x + 2.4, 1.3), (x - 2.4, 1.3)]
    walls = tuple(zip(corners, corners[1:] + corners[:1], strict=True))
    inner = tuple(((x + d, -1.2), (x + d, 1.0)) for d in (-0.9, 0.7))
    return (*walls, *inner) if has_walls else walls


def returns_in(x: float, rng, count: int, *, has_walls: bool):
    ground = ground_returns(rng, count // 2, half=(2.3, 1.1), noise=0.01) + (x, 0.0, 0.0)
    return np.concatenate([
        ground, wall_returns(rng, 3 * count // 2, room(x, has_walls=has_walls), noise=0.01)
    ])  # fmt: skip


def mapped_rooms(*, is_second_known: bool = True, is_second_equal: bool = False):
    """Map and layers of a room with walls at x = 0, and of one like it, or without, at `APART`."""
    rng = np.random.default_rng(1)
    first = returns_in(0.0, rng, 80000, has_walls=True)
    second = returns_in(APART, rng, 80000, has_walls=is_second_equal)
    if not is_second_known:
        second = second[second[:, 0] < APART - 0.5]
    return mapped(first, second)


def rooms(**kinds: bool):
    return LongTermMap.of(*mapped_rooms(**kinds), PARAMS)


def poses(*xs: float) -> list[ScanFilter]:
    spread = np.diag(np.square([0.15, 0.15, 0.03]))
    return [
        ScanFilter(PARAMS, se3.from_xyz_rpy([x, 0, 0, 0, 0, 0]), spread, unknown_errors(PARAMS))
        for x in xs
    ]


def held(hypotheses: Hypotheses, long_term, updates: int, *, has_walls: bool) -> Hypotheses:
    """A robot at the middle of a room sees it again and again."""
    for k in range(updates):
        seen = returns_in(0.0, np.random.default_rng(10 + k), 800, has_walls=has_walls)
        if len(hypotheses):
            hypotheses.update(seen, np.eye(4), long_term)
    return hypotheses


def test_the_place_where_the_robot_is_remains():
    hypotheses = held(Hypotheses(poses(0.05, APART)), rooms(), 12, has_walls=True)
    assert len(hypotheses) == 1
    assert hypotheses.weights == (1.0,)
    at = hypotheses.best.estimate.T_map_odom[:3, 3]
    np.testing.assert_allclose(at, 0.0, atol=0.02)


def test_walls_that_the_robot_does_not_see_do_not_speak_against_a_place():
    """They may be behind something, or gone; only what is seen counts."""
    hypotheses = held(Hypotheses(poses(0.0, APART)), rooms(), 12, has_walls=False)
    assert len(hypotheses) == 2


def test_places_that_are_equal_stay_side_by_side_however_long_it_takes():
    long_term = rooms(is_second_equal=True)
    hypotheses = held(Hypotheses(poses(0.0, APART)), long_term, 100, has_walls=True)
    assert len(hypotheses) == 2
    assert hypotheses.weights[0] < 0.7
    assert sum(hypotheses.weights) == pytest.approx(1.0)


def test_what_the_map_does_not_know_drops_no_place():
    """Of the second room the map has a part, and all that it has is as the robot sees it."""
    long_term = rooms(is_second_known=False)
    hypotheses = held(Hypotheses(poses(0.0, APART)), long_term, 30, has_walls=True)
    assert len(hypotheses) == 2
    assert hypotheses.best.estimate.T_map_odom[0, 3] < 1.0


def test_two_that_meet_are_one():
    hypotheses = Hypotheses(poses(0.1, -0.1, APART))
    assert len(held(hypotheses, rooms(is_second_equal=True), 1, has_walls=True)) == 2


def test_a_place_without_anything_that_fits_is_not_kept_for_want_of_others():
    hypotheses = Hypotheses(poses(0.0))
    hypotheses.clear()
    assert len(hypotheses) == 0
    assert hypotheses.weights == ()


def test_they_follow_the_odometry():
    hypotheses = Hypotheses(poses(0.0, APART))
    moved = se3.from_xyz_rpy([0.5, 0, 0, 0, 0, 0.2])
    before = hypotheses.best.estimate.deviation
    hypotheses.predict(np.eye(4), moved, 0.6)
    assert hypotheses.best.estimate.deviation > before


def test_only_scans_tell_several_apart():
    estimate = PoseFilter(LocalizationParams(), np.eye(4), np.eye(3))
    with pytest.raises(TypeError, match="ScanFilter"):
        Hypotheses([estimate]).update(np.zeros((1, 3)), np.eye(4), rooms())


def test_a_map_without_landmarks_that_comes_meanwhile_begins_the_search_anew():
    height_map, layers = mapped_rooms(is_second_equal=True)
    tracker = Tracker(PARAMS, np.eye(4), np.diag(np.square([0.3, 0.3, 0.1])))
    tracker.set_long_term(LongTermMap.of(height_map, layers, PARAMS))
    tracker.request_search()
    weights = []
    for k in range(60):
        T_odom_base = se3.from_xyz_rpy([0.02 * k, 0, 0, 0, 0, 0])
        tracker.move(T_odom_base)
        seen = returns_in(0.0, np.random.default_rng(k), 1600, has_walls=True)
        attempt = tracker.integrate(beams_to(seen), T_odom_base, k * 50_000_000)
        if attempt is not None:
            weights.append(len(attempt.weights))
            if weights[-1] == 2:
                tracker.set_long_term(LongTermMap.of(height_map, None, PARAMS))
    assert 2 in weights
    assert weights[-1] == 0


@pytest.mark.parametrize("off", [(0.0, 0.12), (0.05, 0.12), (0.0, -0.1)])
def test_the_far_side_of_a_wall_is_not_taken_for_the_near_one(off):
    """The map knows both sides of a thick wall; the robot, found between them, sees one."""
    near, far = ((-2.4, 1.3), (2.4, 1.3)), ((-2.4, 1.5), (2.4, 1.5))
    sides = tuple(((x, -1.2), (x, 1.3)) for x in (-2.4, 2.4))

    def returns(rng, count, walls):
        return np.concatenate([
            ground_returns(rng, count // 2, half=(2.3, 1.1), noise=0.01),
            wall_returns(rng, 3 * count // 2, walls, noise=0.01),
        ])  # fmt: skip

    whole = mapped(returns(np.random.default_rng(1), 60000, (near, far, *sides)))
    (pose,) = poses(off[0])
    pose.T_map_odom[1, 3] = off[1]
    seen = returns(np.random.default_rng(2), 800, (near, *sides))
    Hypotheses([pose]).update(seen, np.eye(4), LongTermMap.of(*whole, PARAMS))
    np.testing.assert_allclose(pose.T_map_odom[:2, 3], 0.0, atol=0.03)
