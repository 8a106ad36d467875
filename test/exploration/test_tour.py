# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The shortest tour against all orders."""

from __future__ import annotations

from itertools import pairwise, permutations

import numpy as np
import pytest

from heightmap25d_ros.exploration.tour import MOST, least_between, shortest_tour


def length(order, first, between):
    return first[order[0]] + sum(between[a, b] for a, b in pairwise(order))


@pytest.mark.parametrize("count", [1, 2, 5, 6])
def test_no_order_is_shorter(count):
    rng = np.random.default_rng(count)
    for _ in range(5):
        first, between = rng.uniform(0.0, 9.0, count), rng.uniform(0.0, 9.0, (count, count))
        order = shortest_tour(first, between)
        assert sorted(order) == list(range(count))
        best = min(length(o, first, between) for o in permutations(range(count)))
        assert length(order, first, between) == pytest.approx(best)


def test_places_beside_the_way_come_first():
    """Though the one far off is nearer to the robot than the last one of the others."""
    at = np.array([[6.0, 0.0], [2.0, 0.0], [4.0, 0.0], [-5.0, 0.0]])
    first = np.hypot(*at.T)
    assert shortest_tour(first, least_between(first, at)) == [3, 1, 2, 0]


def test_behind_a_wall_ways_are_not_straight():
    at = np.array([[1.0, 0.0], [1.0, 0.5]])
    assert least_between(np.array([1.0, 9.0]), at)[0, 1] == 8.0


def test_too_many_places_and_none():
    with pytest.raises(ValueError, match=f"{MOST + 1} places"):
        shortest_tour(np.ones(MOST + 1), np.ones((MOST + 1, MOST + 1)))
    assert shortest_tour(np.empty(0), np.empty((0, 0))) == []
