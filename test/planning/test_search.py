# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import time
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from literal_transitions import AROUND, distances, steps_closed
from small_terrain import SEEDS, drawn, graph, random_cells, random_graph

from heightmap25d_ros.planning.search import (
    _SLICE,
    CLOSED,
    LARGEST_COST,
    LARGEST_SIDE,
    UNREACHABLE,
    SearchTimeoutError,
    cost_to_go,
)

OPEN = np.ones((8, 8), bool)


def field(enterable, goal, **terrain):
    return cost_to_go(graph(enterable, **terrain).incoming, goal).dense()


def incoming_cost(incoming, before, cell):
    k = AROUND.index((before[0] - cell[0], before[1] - cell[1]))
    return int(incoming[cell[0] + 1, cell[1] + 1, k])


def path_cost(incoming, path):
    """Of a path (N, 2); it must be contiguous and open."""
    total = 0
    for before, cell in pairwise(map(tuple, path.tolist())):
        cost = incoming_cost(incoming, before, cell)
        assert cost != CLOSED
        total += cost
    return total


def random_incoming(seed):
    """Costs of transitions that go with no ground at all: every direction its own."""
    rng = np.random.default_rng(seed)
    shape = tuple(int(side) for side in rng.integers(1, 13, 2))
    lowest = np.array([70, 99] * 4)
    highest = rng.choice([100, 150, 1000, LARGEST_COST])
    costs = rng.integers(lowest, highest, (*shape, 8), endpoint=True)
    costs[rng.random(costs.shape) < rng.choice([0.0, 0.2, 0.6])] = CLOSED
    incoming = np.zeros((shape[0] + 2, shape[1] + 2, 8), np.uint16)
    for cell in np.ndindex(shape):
        for k, (dy, dx) in enumerate(AROUND):
            if 0 <= cell[0] + dy < shape[0] and 0 <= cell[1] + dx < shape[1]:
                incoming[cell[0] + 1, cell[1] + 1, k] = costs[(*cell, k)]
    goal, start = (tuple(int(side) for side in rng.integers(0, shape)) for _ in range(2))
    return incoming, goal, start


def test_open_ground():
    assert field(OPEN, (0, 0)).tolist() == [
        [0, 70, 140, 210, 280, 350, 420, 490],
        [70, 99, 169, 239, 309, 379, 449, 519],
        [140, 169, 198, 268, 338, 408, 478, 548],
        [210, 239, 268, 297, 367, 437, 507, 577],
        [280, 309, 338, 367, 396, 466, 536, 606],
        [350, 379, 408, 437, 466, 495, 565, 635],
        [420, 449, 478, 507, 536, 565, 594, 664],
        [490, 519, 548, 577, 606, 635, 664, 693],
    ]


def test_a_wall_with_a_gap():
    enterable = drawn(
        "........",
        "........",
        "........",
        "#######.",
        "........",
        "........",
        "........",
        "........",
    )
    assert field(enterable, (0, 7)).tolist() == [
        [490, 420, 350, 280, 210, 140, 70, 0],
        [519, 449, 379, 309, 239, 169, 99, 70],
        [548, 478, 408, 338, 268, 198, 169, 140],
        [-1, -1, -1, -1, -1, -1, -1, 210],
        # No diagonal cuts the corner of the wall: straight through the gap, then away.
        [770, 700, 630, 560, 490, 420, 350, 280],
        [799, 729, 659, 589, 519, 449, 379, 350],
        [828, 758, 688, 618, 548, 478, 449, 420],
        [857, 787, 717, 647, 577, 548, 519, 490],
    ]


def test_an_island_and_a_goal_that_nothing_may_enter():
    enterable = drawn(
        "....#...",
        "....#...",
        "....#...",
        "....####",
        "........",
        "........",
        "........",
        "........",
    )
    reached = field(enterable, (0, 7)) != UNREACHABLE
    expected = np.zeros((8, 8), bool)
    expected[:3, 5:] = True
    assert (reached == expected).all()
    nothing = cost_to_go(graph(enterable).incoming, (0, 4))
    assert nothing[0, 4] == 0
    assert (nothing.dense() == UNREACHABLE).sum() == 63
    assert nothing[7, 7] == UNREACHABLE
    assert nothing.cheapest_path((7, 7)).shape == (0, 2)
    assert nothing.direction((7, 7)) == -1


def test_a_blocked_step_closes_that_step_and_the_diagonals_around_it():
    blocked = steps_closed((8, 8), [((4, 3), (4, 4))])
    costs = field(OPEN, (4, 4), blocked=blocked)
    assert costs[4, 3] == 3 * 70  # up, right, down
    # The cells on both sides of the step stay open to their other neighbours.
    assert costs[4, 5] == costs[3, 4] == costs[5, 4] == 70
    assert costs[3, 5] == costs[5, 5] == 99
    # Their diagonals over the corner of that step are closed: two straight steps.
    assert costs[3, 3] == costs[5, 3] == 140
    assert costs[4, 2] == 99 + 140
    # Only the straight steps between (4, 3) and (4, 4) and those four diagonals differ.
    changed = graph(OPEN, blocked=blocked).incoming != graph(OPEN).incoming
    assert changed.sum() == 2 * (1 + 4)


def test_a_blocked_diagonal_closes_nothing_else():
    blocked = steps_closed((8, 8), [((3, 3), (4, 4))])
    costs = field(OPEN, (4, 4), blocked=blocked)
    assert costs[3, 3] == 140
    assert costs[3, 4] == costs[4, 3] == 70
    assert costs[3, 5] == costs[5, 3] == 99
    assert costs[2, 2] == 99 + 140
    assert (graph(OPEN, blocked=blocked).incoming != graph(OPEN).incoming).sum() == 2


@pytest.mark.parametrize("corner", [(3, 4), (4, 3)])
def test_a_diagonal_needs_both_its_corners(corner):
    enterable = OPEN.copy()
    enterable[corner] = False
    costs = field(enterable, (4, 4))
    assert costs[3, 3] == 140
    assert costs[5, 5] == 99


def test_uphill_is_dearer_than_downhill():
    gradient = np.zeros((2, 8, 8), np.float32)
    gradient[0] = 0.5  # up along x
    terrain = {"gradient": gradient, "slope_weights": (2.0, 1.0, 0.0)}
    # 70 (sqrt(1.25) + 2 * 0.5) = 148.26, 70 (sqrt(1.25) + 0.5) = 113.26, across 70.
    up, down = field(OPEN, (0, 7), **terrain), field(OPEN, (0, 0), **terrain)
    assert up[0].tolist() == [148 * n for n in range(7, -1, -1)]
    assert down[0].tolist() == [113 * n for n in range(8)]
    assert field(OPEN, (7, 0), **terrain)[:, 0].tolist() == [70 * n for n in range(7, -1, -1)]


def test_a_path_and_its_directions_written_out():
    enterable = drawn(
        "........",
        ".#######",
        "........",
        "#######.",
        "........",
        "........",
        "........",
        "........",
    )
    result = cost_to_go(graph(enterable).incoming, (0, 7))
    assert result.cheapest_path((4, 7)).tolist() == [
        [4, 7], [3, 7], [2, 7], [2, 6], [2, 5], [2, 4], [2, 3], [2, 2], [2, 1], [2, 0],
        [1, 0], [0, 0], [0, 1], [0, 2], [0, 3], [0, 4], [0, 5], [0, 6], [0, 7],
    ]  # fmt: skip
    assert result[4, 7] == 18 * 70
    assert [result.direction(cell) for cell in ((4, 7), (2, 7), (2, 0), (0, 0))] == [6, 4, 6, 0]
    assert result.direction((0, 7)) == -1
    assert result.cheapest_path((0, 7)).tolist() == [[0, 7]]


def assert_exact(incoming, goal, start):
    expected = distances(incoming, goal)
    whole = cost_to_go(incoming, goal)
    assert (whole.dense() == expected).all()
    guided = cost_to_go(incoming, goal, start=start)
    assert whole[start] == guided[start] == expected[start]
    for result in (whole, guided):
        path = result.cheapest_path(start)
        if expected[start] < 0:
            assert path.shape == (0, 2)
            continue
        assert tuple(path[0]) == start
        assert tuple(path[-1]) == goal
        assert path_cost(incoming, path) == expected[start]
        for cell, after in pairwise(map(tuple, path.tolist())):
            assert AROUND[result.direction(cell)] == (after[0] - cell[0], after[1] - cell[1])
            assert result[cell] == expected[cell]
    for cell in np.ndindex(expected.shape):
        k = whole.direction(cell)
        if expected[cell] <= 0:
            assert k == -1
        else:
            after = cell[0] + AROUND[k][0], cell[1] + AROUND[k][1]
            assert expected[after] == expected[cell] - incoming_cost(incoming, cell, after)
            assert 0 <= expected[after] < expected[cell]


@given(SEEDS)
@settings(max_examples=400)
def test_the_field_is_dijkstras_and_the_guided_search_agrees(seed):
    terrain = random_graph(seed)
    cells = random_cells(terrain, seed, 2)
    if cells:
        assert_exact(terrain.incoming, *cells)


@given(SEEDS)
@settings(max_examples=300)
def test_costs_that_go_with_no_ground_are_searched_just_as_exactly(seed):
    assert_exact(*random_incoming(seed))


@given(seed=SEEDS, largest=st.sampled_from([75, 110, 300, LARGEST_COST]))
@settings(max_examples=30)
def test_the_guided_search_on_larger_grids(seed, largest):
    rng = np.random.default_rng(seed)
    shape = 70, 90
    weight = rng.uniform(1, largest / 70, shape).astype(np.float32)
    enterable = rng.random(shape) > 0.25
    terrain = graph(enterable, weight=weight)
    start, goal = random_cells(terrain, seed, 2)
    expected = distances(terrain.incoming, goal)
    assert (cost_to_go(terrain.incoming, goal).dense() == expected).all()
    guided = cost_to_go(terrain.incoming, goal, start=start)
    assert guided[start] == expected[start]
    assert path_cost(terrain.incoming, guided.cheapest_path(start)) == max(expected[start], 0)


def test_a_guided_search_never_says_too_little():
    for seed in range(40):
        incoming, goal, start = random_incoming(seed)
        expected = distances(incoming, goal)
        found = cost_to_go(incoming, goal, start=start).dense()
        assert (found[found >= 0] >= expected[found >= 0]).all()
        assert (expected[found >= 0] >= 0).all()


def test_the_dearest_transitions():
    weight = np.full((8, 8), 1000.0, np.float32)
    assert field(OPEN, (0, 0), weight=weight)[7, 7] == 7 * LARGEST_COST
    assert field(OPEN, (0, 0), weight=weight)[0, 7] == 7 * LARGEST_COST
    incoming = graph(OPEN, weight=weight).incoming
    assert incoming.max() == LARGEST_COST
    assert cost_to_go(incoming, (0, 0), start=(7, 3))[7, 3] == 7 * LARGEST_COST


def octile(shape, goal):
    dy, dx = (np.abs(np.arange(side) - at) for side, at in zip(shape, goal, strict=True))
    return 70 * np.maximum.outer(dy, dx) + 29 * np.minimum.outer(dy, dx)


def test_a_search_in_several_slices():
    shape, goal, start = (1100, 1100), (3, 1090), (1098, 2)
    assert shape[0] * shape[1] > _SLICE
    incoming = graph(np.ones(shape, bool)).incoming
    expected = octile(shape, goal)
    far_ahead = time.monotonic() + 3600.0
    result = cost_to_go(incoming, goal, deadline=far_ahead)
    assert (result.dense() == expected).all()
    assert cost_to_go(incoming, goal, start=start)[start] == expected[start]
    with pytest.raises(SearchTimeoutError):
        cost_to_go(incoming, goal, deadline=time.monotonic() - 1.0)


def test_a_path_that_is_too_long_to_be_counted_is_not_found():
    side = 801
    enterable = np.ones((side, side), bool)
    enterable[1::4, :-1] = enterable[3::4, 1:] = False  # one way, to and fro
    incoming = graph(enterable, weight=np.full((side, side), 1000.0, np.float32)).incoming
    result = cost_to_go(incoming, (0, 0)).dense()
    cells = np.concatenate(
        [
            [(y, x) for x in (range(side) if y % 4 == 0 else range(side - 1, -1, -1))]
            if y % 2 == 0
            else [(y, side - 1 if y % 4 == 1 else 0)]
            for y in range(side)
        ]
    )
    found = result[tuple(cells.T)]
    expected = LARGEST_COST * np.arange(len(cells), dtype=np.int64)
    assert expected[-1] > 2**31
    is_near = expected < 2**31 - 3 * LARGEST_COST
    assert (found[is_near] == expected[is_near]).all()
    assert (found[expected >= 2**31] == UNREACHABLE).all()
    assert (result[~enterable] == UNREACHABLE).all()


def test_a_long_thin_grid():
    shape = (1, LARGEST_SIDE - 2)
    result = cost_to_go(graph(np.ones(shape, bool)).incoming, (0, 0))
    assert result.dense()[0].tolist() == [70 * n for n in range(shape[1])]


@pytest.mark.parametrize("shape", [(3, LARGEST_SIDE + 1), (LARGEST_SIDE + 1, 3)])
def test_a_grid_with_too_long_a_side_is_refused(shape):
    with pytest.raises(ValueError, match=f"{shape[0]} x {shape[1]}"):
        cost_to_go(np.zeros((*shape, 8), np.uint16), (0, 0))
