# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.path import Path
from planner_worlds import route_planner
from properties import draws

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import Geometry
from heightmap25d_ros.planning.boundary import Boundary, confined
from heightmap25d_ros.planning.planner import Planner

GEOMETRY = Geometry(resolution=0.5, origin=(-3.0, 2.0), shape=(9, 13))


@draws(60)
@given(st.integers(0, 2**32 - 1), st.integers(3, 8))
def test_cells_are_inside_as_matplotlib_has_it(seed, corners):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))  # simple: a star around a point
    radius = rng.uniform(0.3, 6.0, corners)
    polygon = np.column_stack([radius * np.cos(angle), 4.0 + radius * np.sin(angle)])
    centers = GEOMETRY.cell_center(np.argwhere(np.ones(GEOMETRY.shape)))
    expected = Path(polygon).contains_points(centers).reshape(GEOMETRY.shape)
    assert np.array_equal(Boundary.of(polygon).mask(GEOMETRY), expected)


def test_without_corners_everything_is_inside():
    assert Boundary.of([]).mask(GEOMETRY).all()
    assert Boundary.of([]).contains(1e6, -1e6)


def test_points():
    square = Boundary.of([0, 0, 2, 0, 2, 2, 0, 2])
    assert square.contains(1.0, 1.9)
    assert not square.contains(1.0, 2.1)
    assert not square.contains(-0.1, 1.0)


@pytest.mark.parametrize(
    ("corners", "told"),
    [
        ([0.0, 1.0, 2.0], "pairs"),
        ([0, 0, 1, 1], "2 corners"),
        ([0, 0, 1, 1, 2, 2], "on a line"),
        ([0, 0, 1, 0, 1, np.nan], "not a place"),
        ([0, 0, 1, 0, 1, 1e300], "not a place"),
    ],
)
def test_what_is_no_polygon_is_refused(corners, told):
    with pytest.raises(InputError, match=f"boundary: .*{told}"):
        Boundary.of(corners)


def test_paths_stay_inside_where_a_straight_line_would_not():
    planner = route_planner(np.zeros((80, 80)))
    bay = Boundary.of([(0, 0), (10, 0), (10, 10), (6, 10), (6, 3), (4, 3), (4, 10), (0, 10)])
    inside = Planner(confined(planner.graph, bay))
    plan = inside.plan((2.0, 8.0), (8.0, 8.0))
    assert plan.found
    assert plan.length > 10.0
    assert all(bay.contains(*T[:2, 3]) for T in plan.poses)
    assert not inside.plan((2.0, 8.0), (5.0, 8.0)).found


def test_a_robot_that_is_outside_may_come_in():
    planner = route_planner(np.zeros((80, 80)))
    inside = Planner(confined(planner.graph, Boundary.of([0, 0, 10, 0, 10, 5, 0, 5])))
    assert inside.plan((5.0, 5.2, -1.57), (5.0, 2.0), is_robot_there=True).found
