# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from literal_transitions import LiteralGround, steps_closed
from properties import draws
from small_terrain import SEEDS, drawn, graph, random_cells, random_graph

from heightmap25d_ros.planning.search import UNREACHABLE, cost_to_go
from heightmap25d_ros.planning.smoothing import (
    headings,
    round_corners,
    sampled,
    string_pull,
)

MOST = draws(200)


def pulled(terrain, start, goal):
    """(vertices, cells, field) of a path, or None."""
    field = cost_to_go(terrain.incoming, goal)
    if field[start] == UNREACHABLE:
        return None
    cells = field.cheapest_path(start)
    return string_pull(terrain, field, cells), cells, field


def some_path(seed, **options):
    """A random graph with the vertices, cells and field of a path over it, or None."""
    terrain = random_graph(seed, **options)
    ends = random_cells(terrain, seed, 2)
    result = pulled(terrain, *ends) if ends else None
    return (terrain, *result) if result else None


def length(points):
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


@given(SEEDS)
@draws(200)
def test_lines_by_exact_fractions(seed):
    terrain = random_graph(seed, share_closed=0.15)
    literal = LiteralGround.of(terrain)
    rng = np.random.default_rng(seed)
    for _ in range(10):
        if rng.random() < 0.5:  # from centre to centre: often over corners of cells
            start, end = rng.integers(0, terrain.enterable.shape, (2, 2)) + 0.5
        else:
            start, end = rng.uniform(0, terrain.enterable.shape, (2, 2))
        cost = terrain.line_cost(start, end)
        if literal.line_is_open(start, end):
            assert cost == pytest.approx(literal.line_cost(start, end), rel=1e-4, abs=1e-5)
        else:
            assert cost < 0


def test_a_line_over_the_corner_of_a_closed_cell_is_closed():
    terrain = graph(drawn("...", ".#.", "..."))
    corner_to_corner = np.array([0.5, 1.5]), np.array([1.5, 0.5])
    assert terrain.line_cost(*corner_to_corner) < 0
    assert terrain.line_cost(*corner_to_corner[::-1]) < 0
    assert terrain.line_cost(np.array([0.5, 0.5]), np.array([0.5, 2.5])) == 2
    assert terrain.line_cost(np.array([0.2, 0.1]), np.array([0.2, 0.1])) == 0


def test_a_line_over_a_blocked_step_is_closed_and_beside_it_open():
    terrain = graph(np.ones((4, 4), bool), blocked=steps_closed((4, 4), [((1, 1), (1, 2))]))
    assert terrain.line_cost(np.array([1.5, 0.5]), np.array([1.5, 3.5])) < 0
    assert terrain.line_cost(np.array([1.01, 3.5]), np.array([1.99, 0.5])) < 0
    assert terrain.line_cost(np.array([0.5, 0.5]), np.array([0.5, 3.5])) == 3
    assert terrain.line_cost(np.array([2.5, 0.5]), np.array([2.5, 3.5])) == 3
    assert terrain.line_cost(np.array([1.5, 0.5]), np.array([1.5, 1.99])) > 0


@given(SEEDS)
@MOST
def test_a_pulled_path_is_open_and_to_half_a_percent_no_dearer_than_the_cells(seed):
    path = some_path(seed)
    if path is None:
        return
    terrain, vertices, cells, field = path
    literal = LiteralGround.of(terrain)
    assert (vertices[0] == cells[0] + 0.5).all()
    assert (vertices[-1] == cells[-1] + 0.5).all()
    numbers = [int(np.flatnonzero((cells + 0.5 == v).all(axis=1))[0]) for v in vertices]
    assert numbers == sorted(numbers)
    total = 0.0
    for (i, p), (j, q) in pairwise(zip(numbers, vertices, strict=True)):
        assert literal.line_is_open(p, q)
        cost = literal.line_cost(p, q)
        if j == i + 1:  # the transition itself costs its two cells' means
            cost = min(cost, literal.cost(tuple(cells[i]), tuple(cells[j])))
        total += cost
    # Transitions are whole numbers of 70ths, between 70 and 7900.
    steps = [field[tuple(cell)] for cell in cells]
    if all(before - after < 7900 for before, after in pairwise(steps)):
        assert total <= steps[0] / 70 * 1.005 + len(cells) / 140


def test_paths_over_open_ground_become_shorter_than_8_directions_allow():
    terrain = graph(np.ones((64, 64), bool))
    rng = np.random.default_rng(1)
    before, after, straight = [], [], []
    for start, goal in rng.integers(0, 64, (200, 2, 2)):
        if (start == goal).all():
            continue
        vertices, cells, _ = pulled(terrain, tuple(map(int, start)), tuple(map(int, goal)))
        before.append(length(cells))
        after.append(length(vertices))
        straight.append(math.hypot(*(goal - start)))
    np.testing.assert_allclose(after, straight, rtol=1e-9)
    assert np.sum(after) <= 0.96 * np.sum(before)


def test_paths_around_obstacles_become_shorter():
    enterable = np.ones((60, 60), bool)
    enterable[10:50, 20:22] = enterable[20:60, 40:43] = False
    vertices, cells, _ = pulled(graph(enterable), (30, 2), (55, 57))
    assert length(vertices) < 0.98 * length(cells)
    assert 3 <= len(vertices) <= 10


def test_a_path_around_dear_ground_is_not_pulled_over_it():
    weight = np.ones((21, 41), np.float32)
    weight[:16, 15:26] = 20.0
    terrain = graph(np.ones((21, 41), bool), weight=weight)
    vertices, _, _ = pulled(terrain, (10, 2), (10, 38))
    literal = LiteralGround.of(terrain)
    cells = {cell for p, q in pairwise(vertices) for cell, share in literal.pieces(p, q) if share}
    assert all(weight[cell] == 1.0 for cell in cells)


@given(SEEDS, st.sampled_from([0.1, 0.125, 0.05]))
@MOST
def test_rounded_corners_stay_on_open_transitions(seed, resolution):
    path = some_path(seed, most_side=24, share_closed=0.25, resolution=resolution)
    if path is None:
        return
    terrain, vertices, *_ = path
    literal = LiteralGround.of(terrain)
    points = round_corners(terrain, vertices)
    assert (points[0] == vertices[0]).all()
    assert (points[-1] == vertices[-1]).all()
    assert length(points) <= length(vertices) + 1e-9
    for p, q in pairwise(points):
        assert literal.line_is_open(p, q)


def test_a_right_angle_becomes_a_curve_within_the_corner():
    vertices = np.array([[5.5, 5.5], [5.5, 25.5], [25.5, 25.5]])
    points = round_corners(graph(np.ones((32, 32), bool)), vertices)
    looks = np.arctan2(*np.diff(points, axis=0).T)
    assert np.abs(np.diff(looks)).max() < math.radians(20)
    assert (np.diff(looks) >= -1e-9).all()
    # It begins at most 0.8 m before the corner, and lies inside of it.
    assert np.hypot(*(points[1:-1] - vertices[1]).T).max() <= 0.8 / 0.125 + 1e-9
    assert (points[:, 0] >= 5.5).all()
    assert (points[:, 1] <= 25.5).all()


def test_a_corner_of_a_path_one_cell_wide_is_rounded_within_it():
    enterable = np.zeros((12, 12), bool)
    enterable[2, 2:10] = enterable[2:10, 9] = True
    vertices = np.array([[2.5, 2.5], [2.5, 9.5], [9.5, 9.5]])
    points = round_corners(graph(enterable), vertices)
    literal = LiteralGround.of(graph(enterable))
    assert all(literal.line_is_open(p, q) for p, q in pairwise(points))
    assert len(points) > len(vertices)


@given(
    points=st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=1, max_size=6),
    spacing=st.sampled_from([0.1, 0.8, 3.0]),
)
def test_sampled_points_are_on_the_line_and_no_farther_apart_than_asked(points, spacing):
    points = np.array(points)
    result = sampled(points, spacing)
    np.testing.assert_allclose(result[0], points[0])
    np.testing.assert_allclose(result[-1], points[-1], atol=1e-8)
    steps = np.hypot(*np.diff(result, axis=0).T)
    assert (steps <= spacing + 1e-6).all()
    assert (steps > 0).all()
    assert length(result) == pytest.approx(length(points), rel=1e-9, abs=1e-7)
    # Every vertex is still there.
    for point in points:
        assert np.hypot(*(result - point).T).min() < 1e-8


def test_points_between_are_even():
    result = sampled(np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 1.0], [0.5, 1.0]]), 0.3)
    np.testing.assert_allclose(
        result, [[0, 0], [0, 0.25], [0, 0.5], [0, 0.75], [0, 1], [0.25, 1], [0.5, 1]]
    )


def test_headings_look_along_the_line_that_follows():
    points = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    right = math.pi / 2
    np.testing.assert_allclose(headings(points, None, None), [0, right, math.pi, -right, -right])
    np.testing.assert_allclose(headings(points, 0.3, -2.0), [0.3, right, math.pi, -right, -2.0])
    assert headings(points[:1], None, None).tolist() == [0.0]
    assert headings(points[:1], 1.0, None).tolist() == [1.0]
    assert headings(points[:1], 1.0, 2.0).tolist() == [2.0]


def test_a_curve_that_touches_the_corner_of_a_closed_cell():
    enterable = np.ones((12, 12), bool)
    enterable[6, 4] = False
    terrain = graph(enterable, resolution=0.1)
    vertices = np.array([[5.5, 1.5], [5.5, 5.5], [9.5, 5.5]])
    literal = LiteralGround.of(terrain)
    points = round_corners(terrain, vertices)
    cells = [cell for p, q in pairwise(points) for cell, _ in literal.pieces(p, q)]
    assert all(literal.is_open(a, b) for a, b in pairwise(cells) if a != b)


def test_a_line_that_ends_on_the_border_behind_a_blocked_step():
    blocked = steps_closed((3, 6), [((1, 2), (1, 3))])
    terrain = graph(np.ones((3, 6), bool), blocked=blocked)
    assert terrain.line_cost(np.array([1.5, 1.5]), np.array([1.5, 3.0])) < 0
