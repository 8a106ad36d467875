# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The score of a hypothesis: by a slow reading of its definition, and on exact small maps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros.localization.matching import (
    Cost,
    RegistrationPoints,
    Window,
    descend,
    match,
    search,
)
from heightmap25d_ros.localization.surface import Surface, edges

NAN = math.nan
COST = Cost(clip=0.3, unknown=1.0, z_range=1.0)


def surface(heights, resolution=0.5, origin=(-1.0, 2.0), step=0.15):
    heights = np.array(heights, np.float32)
    return Surface(heights, edges(heights, step), origin, resolution)


def points(rows, is_edge=None, weight=None):
    xyz = np.array(rows, np.float64).reshape(-1, 3)
    return RegistrationPoints(
        xyz,
        np.zeros(len(xyz), bool) if is_edge is None else np.array(is_edge),
        np.ones(len(xyz)) if weight is None else np.array(weight, np.float64),
    )


def slow_score(some, hypothesis, over, pivot, cost, z):
    """Point by point, cell by cell, with the error of z given."""
    x, y, yaw = hypothesis
    total = counted = 0.0
    for (px, py, pz), is_edge, weight in zip(*some.arrays, strict=True):
        qx = pivot[0] + x + math.cos(yaw) * px - math.sin(yaw) * py
        qy = pivot[1] + y + math.sin(yaw) * px + math.cos(yaw) * py
        for iy, ix in np.ndindex(*[side + 4 for side in over.heights.shape]):
            cx = over.origin[0] + (ix - 2 + 0.5) * over.resolution
            cy = over.origin[1] + (iy - 2 + 0.5) * over.resolution
            share = max(0.0, 1 - abs(qx - cx) / over.resolution)
            share *= max(0.0, 1 - abs(qy - cy) / over.resolution)
            rows, columns = over.heights.shape
            is_inside = 0 <= iy - 2 < rows and 0 <= ix - 2 < columns
            height = over.heights[iy - 2, ix - 2] if is_inside else NAN
            if math.isnan(height):
                if not is_edge:  # all of this small map is near known cells
                    continue
                cost_here = cost.unknown * cost.clip
            elif is_edge and over.is_edge[iy - 2, ix - 2]:
                cost_here = 0.0
            else:
                cost_here = min(abs(height - pz - z), cost.clip)
            total += share * weight * cost_here
            counted += share * weight
    missing = max(0.0, sum(some.weight) / 2 - counted)
    return (total + missing * cost.unknown * cost.clip) / (counted + missing)


@st.composite
def situations(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    heights = rng.uniform(-0.5, 0.5, (6, 7)).astype(np.float32)
    heights[rng.random(heights.shape) < 0.2] = NAN
    count = draw(st.integers(1, 12))
    # Within the map and two cells around it, where the slow score looks.
    some = RegistrationPoints(
        np.column_stack([rng.uniform(-0.8, 0.8, (count, 2)), rng.uniform(-0.4, 0.4, count)]),
        rng.random(count) < 0.5,
        rng.uniform(0.1, 1.0, count),
    )
    return some, rng.uniform(-0.2, 0.2, 3), surface(heights)


@draws(60)
@given(situations())
def test_score_is_the_slow_one(situation):
    some, hypothesis, over = situation
    pivot = (0.75, 3.5)
    found = match(some._replace(pivot=pivot), hypothesis, over, COST)
    assert found.score == pytest.approx(
        slow_score(some, hypothesis, over, pivot, COST, found.z), abs=1e-9
    )
    assert -1e-12 <= found.score <= COST.clip + 1e-12
    assert 0.0 <= found.overlap <= 1.0 + 1e-12


@draws(30)
@given(situations(), st.floats(-0.4, 0.4))
def test_an_error_of_z_is_found_and_costs_nothing(situation, z):
    some, _, _ = situation
    flat = surface(np.full((8, 8), 0.25))
    some = RegistrationPoints(
        np.column_stack([some.xyz[:, :2], np.full(len(some.xyz), z)]), *some[1:]
    )
    found = match(some._replace(pivot=(1.0, 4.0)), np.zeros(3), flat, COST)
    assert found.z == pytest.approx(0.25 - z, abs=2 / 256)
    assert found.score <= 2 / 256


def test_edges_stand_above_a_neighbour():
    heights = np.zeros((6, 6), np.float32)
    heights[2, 2] = 0.5
    heights[5, 5] = NAN
    expected = np.zeros((6, 6), bool)
    expected[2, 2] = True  # not where the ground ends
    np.testing.assert_array_equal(edges(heights, 0.15), expected)


def test_edges_are_thin_among_unknown_cells():
    drawn = (
        "..........",
        ".###......",  # a wall: three cells long, one thin
        "..........",
        "....####..",  # ground of four by three cells
        "....####..",
        "....####..",
        "..........",
        ".##.......",  # a wall in slanting steps
        "...##.....",
        "..........",
    )
    heights = np.array([[0.0 if c == "#" else NAN for c in row] for row in drawn], np.float32)
    expected = ~np.isnan(heights)
    expected[3:6, 4:8] = False
    expected[4, 4:8] = True  # unknown cells within two, above and below
    np.testing.assert_array_equal(edges(heights, 0.15), expected)


@pytest.mark.parametrize("is_edge", [True, False])
def test_what_lies_beyond_the_map_draws_nowhere(is_edge):
    """A wall is known for 16 m; the robot sees it go on for 16 m, where the map has nothing."""
    heights = np.full((9, 128), NAN, np.float32)
    heights[4] = 0.3
    over = surface(heights, resolution=0.125)
    x = over.origin[0] + 1.0 + 0.125 * (np.arange(240) + 0.5)
    wall = points([(at, 2.5625, 0.3) for at in x], is_edge=[is_edge] * len(x))
    scores = [
        match(wall, np.array([-0.125 * cells, 0.0, 0.0]), over, COST).score for cells in range(8)
    ]
    # Were the points beyond all counted, each cell would gain a clip's 240th.
    assert np.abs(np.diff(scores)).max() < COST.clip / 240 / 5
    # And what the map cannot cover is no lack of overlap.
    assert match(wall, np.zeros(3), over, COST).overlap > 0.9
    across = match(wall, np.array([0.0, 0.25, 0.0]), over, COST)
    assert across.score > scores[0] + COST.clip / 2


def test_two_edges_of_different_height_cost_nothing():
    heights = np.zeros((5, 5))
    heights[2, 2] = 0.4
    over = surface(heights)
    on_the_post = [(0.25 - 1.0 + 1.0, 3.25, 0.9), *[(0.75, 3.25, 0.0)] * 4]
    some = points(on_the_post, is_edge=[True, False, False, False, False])
    at_post = match(some, np.zeros(3), over, COST)
    assert at_post.score == pytest.approx(0.0, abs=1e-2)
    plain = points(on_the_post)
    assert match(plain, np.zeros(3), over, COST).score == pytest.approx(COST.clip / 5, abs=1e-2)


def test_unknown_cells_cost_their_part():
    over = surface(np.full((4, 4), NAN))
    some = points([(0.0, 3.0, 0.0)])
    for unknown in (0.0, 0.25, 1.0):
        cost = Cost(clip=0.2, unknown=unknown, z_range=1.0)
        found = match(some, np.zeros(3), over, cost)
        assert found.score == pytest.approx(0.2 * unknown)
        assert found.overlap == 0.0


def test_search_is_the_score_where_points_are_on_centres():
    rng = np.random.default_rng(3)
    over = surface(rng.uniform(-0.3, 0.3, (9, 9)))
    centres = np.array([(-1.0 + 0.5 * (ix + 0.5), 2.0 + 0.5 * (iy + 0.5)) for ix in range(3, 6)
                        for iy in range(3, 6)])  # fmt: skip
    some = points(np.column_stack([centres, rng.uniform(-0.3, 0.3, 9)]))
    steps = np.arange(-2, 3)
    scores = search(some, Window(steps, steps, np.zeros(1)), over, COST)
    assert scores.shape == (1, 5, 5)
    for j, dy in enumerate(steps):
        for i, dx in enumerate(steps):
            hypothesis = np.array([0.5 * dx, 0.5 * dy, 0.0])
            expected = match(some, hypothesis, over, COST).score
            assert scores[0, j, i] == pytest.approx(expected, abs=1e-9)


def test_descent_ends_where_waves_lie_on_themselves():
    def wave(x, y):
        return 0.2 * np.sin(2.1 * x + 0.4 * y) + 0.2 * np.cos(1.3 * y - 0.5 * x)

    x = (np.arange(64) + 0.5) * 0.125 - 4.0
    waves = surface(wave(x[None, :], x[:, None]), 0.125, (-4.0, -4.0), step=9.0)
    xy = np.random.default_rng(4).uniform(-2.5, 2.5, (600, 2))
    some = points(np.column_stack([xy, wave(xy[:, 0] - 0.31, xy[:, 1] + 0.17)]))
    steps = np.outer((1, 1 / 2, 1 / 4, 1 / 8, 1 / 16), (0.125, 0.125, 0.06))
    found = descend(some, np.zeros(3), steps, waves, COST)
    assert found == pytest.approx((-0.31, 0.17, 0.0), abs=0.02)
