# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The shortest tour against all orders."""

from __future__ import annotations

from itertools import pairwise, permutations

import numpy as np
import pytest

from heightmap25d_ros.exploration.tour import MOST, least_between, soonest_tour


def waited(order, first, between, worth):
    ways = np.cumsum([first[order[0]], *(between[a, b] for a, b in pairwise(order))])
    return ways[-1] + ways @ worth[list(order)] / worth.sum()


@pytest.mark.parametrize("count", [1, 2, 5, 6])
def test_in_no_order_most_comes_sooner(count):
    rng = np.random.default_rng(count)
    for _ in range(5):
        first, between = rng.uniform(0.0, 9.0, count), rng.uniform(0.0, 9.0, (count, count))
        worth = rng.uniform(0.1, 5.0, count)
        order = soonest_tour(first, between, worth)
        assert sorted(order) == list(range(count))
        best = min(waited(o, first, between, worth) for o in permutations(range(count)))
        assert waited(order, first, between, worth) == pytest.approx(best)


def test_places_beside_the_way_come_first_but_not_at_any_price():
    at = np.array([[6.0, 0.0], [2.0, 0.0], [-2.5, 0.0]])
    first = np.hypot(*at.T)
    between = least_between(first, at)
    assert soonest_tour(first, between, np.array([5.0, 1.0, 1.0])) == [2, 1, 0]
    assert soonest_tour(first, between, np.array([30.0, 1.0, 1.0])) == [1, 0, 2]


def test_behind_a_wall_ways_are_not_straight():
    at = np.array([[1.0, 0.0], [1.0, 0.5]])
    assert least_between(np.array([1.0, 9.0]), at)[0, 1] == 8.0


def test_too_many_places_and_none():
    with pytest.raises(ValueError, match=f"{MOST + 1} places"):
        soonest_tour(np.ones(MOST + 1), np.ones((MOST + 1, MOST + 1)), np.ones(MOST + 1))
    assert soonest_tour(np.empty(0), np.empty((0, 0)), np.empty(0)) == []
