# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from literal_transitions import rectangle_holds, squares_overlap
from properties import draws
from scipy.spatial import cKDTree
from small_terrain import SEEDS

from heightmap25d_ros.planning.collision import first_free, first_overlap, least_clearance, swept
from heightmap25d_ros.planning.smoothing import headings

MOST = draws(200)
QUARTER = math.pi / 2


def at(y, x, heading, length, width):
    return np.array([[y, x, heading, length / 2, width / 2]])


def continuous(points, heading):
    """Poses of a robot along a path, a twentieth of a cell and half a degree apart."""
    along = np.arctan2(*np.diff(points, axis=0).T)
    for i, point in enumerate(points):
        turns = [*along[i - 1 : i][: i > 0], heading[i], *along[i : i + 1]]
        for before, after in pairwise(turns):
            turn = math.remainder(after - before, 2 * math.pi)
            for share in np.linspace(0, 1, math.ceil(abs(turn) / math.radians(0.5)) + 1):
                yield (*point, before + share * turn)
        if i < len(along):
            step = points[i + 1] - point
            for share in np.linspace(0, 1, math.ceil(np.hypot(*step) / 0.05) + 1):
                yield (*(point + share * step), along[i])


def tips(rectangles):
    """(N, 4, 2) corners of rectangles as of `swept`."""
    y, x, heading, half_length, half_width = rectangles.T
    ahead = np.stack([np.sin(heading), np.cos(heading)], axis=-1) * half_length[:, None]
    left = np.stack([np.cos(heading), -np.sin(heading)], axis=-1) * half_width[:, None]
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    center = np.stack([y, x], axis=-1)
    return np.stack([center + a * ahead + b * left for a, b in signs], axis=1)


@given(SEEDS)
@draws(30)
def test_swept_rectangles_cover_the_robot_everywhere_and_little_more(seed):
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.uniform(-0.8, 0.8, (rng.integers(2, 5), 2)), axis=0) + 20
    heading = headings(points, *rng.uniform(-9, 9, 2))
    length, width = rng.uniform(0.3, 12, 2)
    rectangles = swept(points, heading, length, width)
    np.testing.assert_allclose(rectangles[0], (*points[0], heading[0], length / 2, width / 2))
    poses = np.array(list(continuous(points, heading)))
    robots = np.column_stack([poses, np.tile((length / 2, width / 2), (len(poses), 1))])
    reached = tips(robots).reshape(-1, 2)
    is_covered = np.zeros(len(reached), bool)
    for *pose, half_length, half_width in rectangles:
        larger = 2 * half_length + 1e-6, 2 * half_width + 1e-6
        is_covered |= rectangle_holds(pose, larger, reached)[0]
    assert is_covered.all()
    tree = cKDTree(reached)
    assert tree.query(tips(rectangles).reshape(-1, 2))[0].max() < 0.1


def test_a_turn_on_the_spot_goes_the_shorter_way():
    points = np.array([[0.0, 0.0], [0.0, 1.0]])
    rectangles = swept(points, np.array([math.radians(-170), math.radians(170)]), 2.0, 1.0)
    at_start = np.degrees(rectangles[rectangles[:, 1] == 0.0, 2])
    assert at_start.min() >= -170 - 1e-9
    assert at_start.max() <= 1e-9
    at_end = np.degrees(rectangles[rectangles[:, 1] == 1.0, 2])
    assert at_end.min() >= -1e-9
    assert at_end.max() <= 170 + 1e-9


@given(SEEDS)
@MOST
def test_overlaps_by_separating_axes(seed):
    rng = np.random.default_rng(seed)
    shape = rng.integers(1, 25, 2)
    solid = rng.random(shape) < rng.choice([0.003, 0.02, 0.1])
    length, width = rng.uniform(0.5, 9.0, 2)
    centers = rng.uniform(-3, shape + 3, (12, 2))
    poses = np.column_stack([centers, rng.uniform(-9, 9, 12)])
    rectangles = np.column_stack([poses, np.tile((length / 2, width / 2), (12, 1))])
    expected = [squares_overlap(pose, (length, width), np.argwhere(solid)).any() for pose in poses]
    assert first_overlap(solid, rectangles) == (expected.index(True) if any(expected) else -1)
    assert first_free(solid, rectangles) == (expected.index(False) if not all(expected) else -1)


def test_the_rectangle_is_long_where_it_looks():
    solid = np.zeros((11, 11), bool)
    solid[5, 8] = True
    along_x, along_y = at(5.5, 5.5, 0.0, 7.0, 1.0), at(5.5, 5.5, QUARTER, 7.0, 1.0)
    assert first_overlap(solid, along_x) == 0
    assert first_overlap(solid, along_y) == -1
    assert first_overlap(solid.T, along_x) == -1
    assert first_overlap(solid.T, along_y) == 0
    assert first_overlap(solid, np.concatenate([along_y, along_y, along_x])) == 2
    assert first_overlap(solid, np.empty((0, 5))) == -1


def test_a_corner_in_the_square_overlaps_however_far_the_centre_is():
    solid = np.zeros((11, 11), bool)
    solid[5, 8] = True
    for ahead, expected in ((2.49, -1), (2.51, 0)):
        assert first_overlap(solid, at(5.5, 5.5, 0.0, 2 * ahead, 1.0)) == expected
    # Turned by an eighth, its corner stands in the square of (5, 8), but not on its centre.
    side = 2.6 * math.sqrt(2)
    assert first_overlap(solid, at(5.5, 5.5, math.pi / 4, side, side)) == 0
    assert first_overlap(solid, at(5.5, 5.5, 0.0, side, side)) == -1


def test_a_turn_on_the_spot_is_checked_between_its_headings():
    solid = np.zeros((21, 21), bool)
    solid[12, 15] = True
    length, width = 10.3, 1.0
    for look in (0.0, QUARTER):
        assert first_overlap(solid, at(10.5, 10.5, look, length, width)) == -1
    line = np.array([[10.5, 10.5], [10.5, 10.6]])
    turning = swept(line, np.array([QUARTER, 0.0]), length, width)
    assert first_overlap(solid, turning) > 0


@given(SEEDS, st.sampled_from([0.5, 3.0, 40.0]))
def test_the_least_clearance_by_all_distances(seed, reach):
    rng = np.random.default_rng(seed)
    shape = rng.integers(1, 25, 2)
    solid = rng.random(shape) < rng.choice([0.0, 0.01, 0.1])
    points = rng.uniform(0, shape, (7, 2))
    away = np.hypot(*(points[:, None] - (np.argwhere(solid) + 0.5)).T)
    expected = min(away.min(initial=np.inf), reach)
    assert least_clearance(solid, points, reach) == pytest.approx(expected, rel=1e-12)
