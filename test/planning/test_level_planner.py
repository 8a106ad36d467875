# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from level_worlds import BRIDGE, bridge_height, overpass
from properties import draws
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.planning.level_graph import LevelGraph, Place
from heightmap25d_ros.planning.level_planner import LevelPlanner, planner_over
from heightmap25d_ros.planning.plan import Pose2D, Status
from heightmap25d_ros.planning.planner import Planner
from heightmap25d_ros.terrain.steps import NEIGHBOURS

SLOPES = TraversabilityParams(max_slope=0.6)
TIMELESS = PlannerParams(timeout=600.0)


@pytest.fixture(scope="module")
def planner():
    return planner_over(overpass(), terrain=SLOPES, params=TIMELESS)


def on_overpass(x, y):
    """z of the bridge at x, y, and of the ground elsewhere."""
    (_, _), (y0, y1) = BRIDGE
    return np.where((y > y0) & (y < y1), bridge_height(x), 0.0)


def test_a_map_of_one_level_has_the_ordinary_planner():
    flat = HeightMap.from_metres(np.zeros((32, 64)))
    assert isinstance(planner_over(flat), Planner)
    assert isinstance(planner_over(overpass()), LevelPlanner)


def test_the_road_leads_under_the_bridge(planner):
    plan = planner.plan(Pose2D(6.0, 1.0, z=0.0), Pose2D(6.0, 9.0, z=0.0))
    assert plan.found
    assert np.abs(plan.poses[:, 2, 3]).max() < 0.05
    assert plan.length == pytest.approx(8.0, abs=0.05)


def test_the_bridge_leads_over_the_road(planner):
    plan = planner.plan(Pose2D(4.0, 5.0, z=1.5), Pose2D(8.0, 5.0, z=1.5))
    assert plan.found
    x, y, z = plan.poses[:, :3, 3].T
    np.testing.assert_allclose(z, on_overpass(x, y), atol=0.2)
    assert z.max() == pytest.approx(2.0, abs=0.02)


def test_from_under_the_bridge_onto_it(planner):
    """The path passes below its own end."""
    plan = planner.plan(Pose2D(6.0, 1.0, z=0.0), Pose2D(6.0, 5.0, z=2.0))
    assert plan.found
    steps = np.diff(plan.poses[:, :3, 3], axis=0)
    assert np.hypot(*steps[:, :2].T).max() < 0.2
    assert np.abs(steps[:, 2]).max() < 0.15
    assert plan.poses[-1, 2, 3] == pytest.approx(2.0, abs=0.05)
    assert plan.poses[0, 2, 3] == pytest.approx(0.0, abs=0.05)
    assert plan.climb == pytest.approx(2.0, abs=0.3)
    assert planner.cost_along(plan.poses, Pose2D(6.0, 1.0)) == pytest.approx(plan.cost, rel=0.05)


def test_a_goal_without_z_is_on_the_lowest_level_that_can_be_reached(planner):
    assert planner.plan((6.0, 1.0), (6.0, 5.0)).poses[-1, 2, 3] == pytest.approx(0.0, abs=0.02)
    closed = overpass()
    _, (y0, y1) = BRIDGE
    walls = closed.height.copy()
    for y in (y0 - 0.3, y1 + 0.2):  # across the road on either side
        walls[round(y / 0.125), :] = 150
    shut = planner_over(replace(closed, height=walls), terrain=SLOPES, params=TIMELESS)
    plan = shut.plan(Pose2D(0.6, 5.0, z=0.0), Pose2D(6.0, 5.0))
    assert plan.found
    assert plan.poses[-1, 2, 3] == pytest.approx(2.0, abs=0.02)
    refused = shut.plan(Pose2D(0.6, 5.0, z=0.0), Pose2D(6.0, 5.0, z=0.0))
    assert refused.status is Status.NO_VALID_PATH
    assert "on the lower level" in refused.reason


@pytest.mark.parametrize(("seen", "z", "ends_at"), [
    ([], 2.0, None),  # under the hole in the deck the ground is known, and is not the deck
    ([], 0.0, 0.0),
    ([(8, 8)], 2.0, 2.0),
])  # fmt: skip
def test_a_goal_with_a_z_is_on_that_level_or_nowhere(seen, z, ends_at):
    """A deck with a hole of 0.6 m, over level ground."""
    shape = 24, 32
    is_hole = np.zeros(shape, bool)
    is_hole[6:11, 6:11] = True
    cells = np.argwhere(~is_hole)
    if seen:
        cells = np.argwhere(np.ones(shape, bool))
    deck = UpperSurfaces.of(cells, [200] * len(cells), [200] * len(cells))
    height_map = replace(HeightMap.from_metres(np.zeros(shape)), upper=deck)
    x, y = height_map.geometry.cell_center((8, 8)).tolist()
    plan = planner_over(height_map).plan(Pose2D(3.0, 2.0, z=z), Pose2D(x, y, z=z))
    assert plan.found == (ends_at is not None)
    if plan.found:
        assert plan.poses[-1, 2, 3] == pytest.approx(ends_at, abs=0.01)
    else:
        assert plan.status == Status.GOAL_OCCUPIED
        assert "another level" in plan.reason


def test_a_goal_where_its_level_alone_is_unknown_may_be_in_a_gap_of_it():
    """Beside the goal the ground is known, and in its cell only the deck above."""
    known = np.zeros((24, 32))
    known[8, 8] = np.nan
    cells = np.argwhere(np.ones(known.shape, bool))
    deck = UpperSurfaces.of(cells, [200] * len(cells), [200] * len(cells))
    height_map = replace(HeightMap.from_metres(known), upper=deck)
    x, y = height_map.geometry.cell_center((8, 8)).tolist()
    plan = planner_over(height_map).plan(Pose2D(3.0, 2.0, z=0.0), Pose2D(x, y, z=0.0))
    assert plan.found
    assert plan.poses[-1, 2, 3] == pytest.approx(0.0, abs=0.01)


def test_a_deck_without_a_ramp_cannot_be_reached():
    ground = HeightMap.from_metres(np.zeros((64, 64)))
    cells = np.argwhere(np.ones((64, 24), bool)) + (0, 20)
    deck = UpperSurfaces.of(cells, [240] * len(cells), [210] * len(cells))
    planner = planner_over(replace(ground, upper=deck), params=TIMELESS)
    refused = planner.plan(Pose2D(1.0, 4.0), Pose2D(4.0, 4.0, z=2.4))
    assert refused.status is Status.NO_VALID_PATH
    assert "on the upper level" in refused.reason
    assert planner.plan(Pose2D(1.0, 4.0), Pose2D(4.0, 4.0, z=0.0)).found


@pytest.mark.parametrize(("clear", "is_open"), [(0.60, False), (0.69, False), (0.80, True)])
def test_a_gate_is_open_where_the_robot_fits_below(clear, is_open):
    ground = HeightMap.from_metres(np.zeros((32, 64)))
    cells = [(y, x) for y in range(32) for x in (30, 31)]
    top = round(100 * clear) + 30
    lintel = UpperSurfaces.of(cells, [top] * len(cells), [top - 30] * len(cells))
    planner = planner_over(replace(ground, upper=lintel), params=TIMELESS)
    assert planner.plan((1.0, 2.0), (7.0, 2.0)).found == is_open


@draws(10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_costs_equal_dijkstra_over_all_surfaces(seed):
    """Every surface is a node; its edges are those that any slice has."""
    rng = np.random.default_rng(seed)
    levels = random_levels(rng)
    graph = LevelGraph(levels, terrain=SLOPES, params=TIMELESS)
    shape = graph.stack.top.shape
    nodes = np.arange(np.prod(shape)).reshape(shape)
    begin, end, costs = [], [], []
    for slice_graph, layer in zip(graph.graphs, graph.layers, strict=True):
        inner = slice_graph.incoming[1:-1, 1:-1]
        for iy, ix, k in np.argwhere(inner > 0):
            dy, dx = NEIGHBOURS[k]
            begin.append(nodes[layer[iy + dy, ix + dx], iy + dy, ix + dx])
            end.append(nodes[layer[iy, ix], iy, ix])
            costs.append(int(inner[iy, ix, k]))
    order = np.argsort(costs)[::-1]  # of two costs of one edge the last, lower one counts
    edges = dict(zip(zip(np.array(end)[order], np.array(begin)[order], strict=True),
                     np.array(costs)[order], strict=True))  # fmt: skip
    rows, columns = np.array(list(edges)).T
    matrix = sparse.csr_array((list(edges.values()), (rows, columns)), (nodes.size,) * 2)
    enterable = np.argwhere(graph.graphs[-1].enterable & (graph.layers[-1] >= 0))
    iy, ix = (int(i) for i in enterable[rng.integers(len(enterable))])
    goal = Place(len(graph.graphs) - 1, (iy, ix))
    fields = graph.cost_to_go(goal, graph.graphs, np.inf)
    expected = dijkstra(matrix, indices=nodes[graph.layers[-1][iy, ix], iy, ix])
    for number, (field, layer) in enumerate(zip(fields, graph.layers, strict=True)):
        y, x = np.nonzero(layer >= 0)
        truth = expected[nodes[layer[y, x], y, x]]
        found = field.dense()[y, x].astype(float)
        np.testing.assert_array_equal(np.where(found < 0, np.inf, found), truth)
        for cell in zip(y[::97].tolist(), x[::97].tolist(), strict=True):
            places = graph.route(fields, Place(number, cell))
            assert bool(places) == (field[cell] >= 0)


def random_levels(rng):
    """Ground with boxes, and two decks with a ramp each; what is on them is random as well."""
    metres = np.zeros((48, 64))
    for _ in range(4):
        y, x = rng.integers(48), rng.integers(64)
        metres[y : y + rng.integers(2, 8), x : x + rng.integers(2, 8)] = rng.uniform(0.2, 1.5)
    upper = []
    for height in (1.6, 3.2):
        y0, x0 = rng.integers(0, 16), rng.integers(0, 20)
        y1, x1 = y0 + rng.integers(14, 28), x0 + rng.integers(14, 30)
        upper += [(y, x, height) for y in range(y0, min(y1, 48)) for x in range(x0, min(x1, 64))]
        rise = 0.06 * np.arange(1, 64 - x0 if x0 < 64 else 1)
        middle = (y0 + min(y1, 48)) // 2
        for n, fall in enumerate(rise):
            z, x = height - fall, min(x1, 64) + n
            if z > 0.0 and x < 64:
                upper += [(y, x, z) for y in range(max(middle - 6, 0), min(middle + 6, 48))]
    upper = [entry for entry in upper if rng.random() < 0.98]
    cells = np.array([entry[:2] for entry in upper])
    tops = np.round(100 * np.array([entry[2] for entry in upper]))
    keep = tops > 85
    grown = metres.copy()
    np.maximum.at(grown, tuple(cells[~keep].T), tops[~keep] / 100)
    surfaces = UpperSurfaces.of(cells[keep], tops[keep], tops[keep] - 10)
    return replace(HeightMap.from_metres(grown), upper=surfaces)
