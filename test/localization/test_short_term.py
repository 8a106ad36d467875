# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Short-term maps: what they hold, and that one is always at hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from heightmap25d_ros import se3
from heightmap25d_ros.localization.short_term import ShortTermMap, ShortTermMaps, distance_travelled
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params

PARAMS = with_values(Params(), {"short_term.mature_cells": 10})


def fan(x: float, wall: float = 3.0, z: float = 0.4) -> Beams:
    """Level beams from (x, 0) to a wall at x = wall, one for each of 31 cells."""
    y = (np.arange(-15, 16) + 0.5) * 0.125
    ends = np.column_stack([np.full(31, wall), y, np.full(31, z)])
    return Beams(
        origins=np.tile((x, 0.0, z), (31, 1)),
        ends=ends,
        is_hit=np.ones(31, bool),
        is_lone=np.zeros(31, bool),
    )


def at(x: float, yaw: float = 0.0) -> se3.Matrix:
    return se3.from_xyz_rpy([x, 0.0, 0.0, 0.0, 0.0, yaw])


def test_places_are_the_newest_below_the_size_of_a_cell():
    short_term = ShortTermMap(np.array([100.0, -50.0, 7.0]), 0.0, 0, PARAMS)
    for way, wall in ((0.0, 103.01), (0.5, 103.03), (1.0, 103.07)):
        beams = fan(100.0, wall)
        shift = (0.0, -50.0, 7.0)
        moved = Beams(origins=beams.origins + shift, ends=beams.ends + shift,
                      is_hit=beams.is_hit, is_lone=beams.is_lone)  # fmt: skip
        short_term.integrate(moved, way)
    seen = short_term.local_cells(1.5)
    assert len(seen.xyz) == 31
    assert seen.xyz[:, 0] == pytest.approx(103.07, abs=1e-4)
    assert seen.xyz[:, 2] == pytest.approx(7.4, abs=0.011)
    assert seen.age == pytest.approx(0.5)
    assert seen.is_edge.all()


def test_a_height_map_of_it_lies_in_odom():
    short_term = ShortTermMap(np.array([1.03, 2.0, 0.5]), 0.0, 0, PARAMS)
    beams = fan(0.0)
    lifted = Beams(origins=beams.origins, ends=beams.ends + (0.0, 2.0, 0.5),
                   is_hit=beams.is_hit, is_lone=beams.is_lone)  # fmt: skip
    short_term.integrate(lifted, 0.0)
    height_map = short_term.height_map()
    cells = np.argwhere(height_map.known)
    centres = height_map.geometry.cell_center(cells)
    assert np.abs(centres[:, 0] - 3.0).max() <= 0.0626
    assert centres[:, 1].mean() == pytest.approx(2.0, abs=0.07)
    assert height_map.metres[height_map.known] == pytest.approx(0.9)


def test_known_errors_of_the_odometry_do_not_bend_it():
    """A robot drives round a post, and its odometry turns too little and runs too far."""
    post = np.array([5.0, 0.0, 0.4])
    errors = np.array([0.0, -0.04, 0.05, 0.03])  # what to add to what odometry tells
    maps = ShortTermMaps(PARAMS)
    maps.errors = errors
    true = told = np.eye(4)
    for step in range(60):
        beams = Beams(origins=true[None, :3, 3], ends=post[None], is_hit=np.array([True]),
                      is_lone=np.array([False]))  # fmt: skip
        in_odom = told @ se3.inverse(true)
        maps.integrate(
            replace(beams, origins=se3.transform_points(in_odom, beams.origins),
                    ends=se3.transform_points(in_odom, beams.ends)),
            told, step * 10**8,
        )  # fmt: skip
        forward, turn = 0.05, 0.03
        true = true @ se3.from_xyz_rpy([forward, 0.0, 0.0, 0.0, 0.0, turn])
        told_forward = forward / (1 + errors[1])
        told_turn = (turn - errors[3] * told_forward) / (1 + errors[2])
        told = told @ se3.from_xyz_rpy([told_forward, 0.0, 0.0, 0.0, 0.0, told_turn])
    seen = maps._maps[0].local_cells(maps.distance)
    at_post = se3.transform_points(in_odom, post[None])
    np.testing.assert_allclose(seen.xyz[:, :2], at_post[:, :2].repeat(len(seen.xyz), 0), atol=5e-3)
    assert np.linalg.norm(at_post - post) > 0.3  # so far odometry drifted


def test_one_is_always_mature_once_the_first_is():
    maps = ShortTermMaps(PARAMS)
    oldest = []
    for step in range(200):
        x = 0.05 * step
        maps.integrate(fan(x, wall=x + 3.0), at(x), step * 10**8)
        if maps.distance >= PARAMS.short_term.mature_distance:
            mature = maps.mature()
            assert mature is not None
            oldest.append(maps.distance - mature.distance)
    assert maps.distance == pytest.approx(9.95)
    assert max(oldest) <= PARAMS.short_term.length + 1e-9
    after = PARAMS.short_term.length * (1 - 1 / PARAMS.short_term.maps)
    assert min(oldest[50:]) >= after - 0.051


def test_a_robot_that_stands_gets_one_with_time():
    maps = ShortTermMaps(PARAMS)
    maps.integrate(fan(0.0), at(0.0), 0)
    assert maps.mature() is None
    maps.integrate(fan(0.0), at(0.0), round(PARAMS.short_term.mature_time * 1e9))
    assert maps.mature() is not None


def test_an_empty_one_is_not_mature():
    maps = ShortTermMaps(with_values(Params(), {"short_term.mature_cells": 32}))
    for step in range(30):
        maps.integrate(fan(0.0), at(0.05 * step), step)
    assert maps.mature() is None


def test_turning_counts_as_way_and_clearing_forgets():
    assert distance_travelled(at(0.0), at(1.0)) == pytest.approx(1.0)
    assert distance_travelled(at(0.0), at(0.0, yaw=1.0)) == pytest.approx(0.5)
    maps = ShortTermMaps(PARAMS)
    for step in range(30):
        maps.integrate(fan(0.0), at(0.05 * step), step)
    maps.clear()
    assert maps.mature() is None
    maps.integrate(fan(0.0), at(500.0), 31)
    assert maps.distance < 2.0
