# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The speed on ground of known slope and roughness."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.speed_limit import ahead_of, speed_share

CELL = 0.125
SHAPE = 80, 160  # 10 m x 20 m
X = (np.arange(SHAPE[1]) + 0.5) * CELL


def path(*xs, y=5.0):
    poses = np.tile(np.eye(4), (len(xs), 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = xs, y
    return poses


def share(profile, poses, **values):
    height = np.broadcast_to(profile, SHAPE)
    params = with_values(Params(), {f"planning.{name}": value for name, value in values.items()})
    return speed_share(poses, HeightMap.from_metres(height, resolution=CELL), params)


def slope(radians):
    return np.maximum(X - 10.0, 0.0) * math.tan(radians)


def test_level_ground_is_driven_at_full_speed():
    assert share(np.zeros(SHAPE[1]), path(2.0, 18.0)) == 1.0
    assert share(slope(0.3), path(2.0, 3.0, 8.0)) == 1.0


@pytest.mark.parametrize(
    ("radians", "expected"), [(0.05, 1.0), (0.09, 1.0), (0.27, 0.65), (0.42, 0.341)]
)
def test_the_speed_falls_from_gentle_to_the_steepest_slopes(radians, expected):
    """0.27 rad is half-way from 0.1 to 0.44: half-way from 1 to 0.3."""
    found = share(slope(radians), path(12.0, 13.0, 14.0))
    assert found == pytest.approx(expected, abs=0.015)
    assert share(slope(radians), path(12.0, 13.0), least_speed=1.0) == 1.0


def test_rough_ground_is_driven_slowly():
    rows, columns = np.indices(SHAPE)
    for centimetres, expected in ((1, 1.0), (3, 1.0 - 0.7 / 3), (5, 0.3)):
        rough = 0.01 * centimetres * (-1.0) ** (rows + columns)
        assert share(rough, path(5.0, 6.0)) == pytest.approx(expected, abs=0.03)


def test_unknown_ground_and_places_beyond_the_map_are_driven_at_least_speed():
    hole = np.zeros(SHAPE)
    hole[30:50, 80:100] = np.nan
    assert share(hole, path(9.0, 11.0)) == 0.3
    assert share(hole, path(9.0, 11.0, y=1.0)) == 1.0
    assert share(hole, path(18.0, 21.0), least_speed=0.5) == 0.5


def test_the_ground_is_that_of_the_level_on_which_the_path_is():
    rows, columns = (axis.ravel() for axis in np.mgrid[28:52, 0:160])
    top = np.rint(240 + 100 * X[columns] * math.tan(0.27)).astype(int)
    deck = UpperSurfaces.of(np.column_stack([rows, columns]), top, top - 20)
    ground = HeightMap.from_metres(np.zeros(SHAPE), resolution=CELL)
    below, above = path(5.0, 6.0), path(5.0, 6.0)
    above[:, 2, 3] = 2.4 + above[:, 0, 3] * math.tan(0.27)
    levels = replace(ground, upper=deck)
    assert speed_share(below, levels, Params()) == 1.0
    assert speed_share(above, levels, Params()) == pytest.approx(0.65, abs=0.015)


@draws(20)
@given(
    steps=st.lists(st.floats(0.05, 0.3), max_size=40),
    share_before=st.floats(0.0, 1.0),
    distance=st.floats(0.0, 6.0),
)
def test_only_what_lies_ahead_counts(steps, share_before, distance):
    poses = path(*np.concatenate([[0.0], np.cumsum(steps)]))
    first = int(share_before * len(steps))
    ahead = ahead_of(poses, first, distance)
    x = poses[first:, 0, 3]
    np.testing.assert_array_equal(ahead[:, 0, 3], x[: len(ahead)])
    assert x[len(ahead) - 1] - x[0] <= distance + 1e-9
    assert len(ahead) == len(x) or x[len(ahead)] - x[0] >= distance - 1e-9
