# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph of a map that grows and changes is that of the map as it is."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws
from scipy import ndimage

from heightmap25d_ros.exploration.explorer import Explorer
from heightmap25d_ros.grid.height_map import SUSPECTED, Area, HeightMap
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params, PlannerParams, TraversabilityParams
from heightmap25d_ros.planning import kept_graph
from heightmap25d_ros.planning.boundary import Boundary, confined
from heightmap25d_ros.planning.graph import transition_graph
from heightmap25d_ros.planning.kept_graph import KeptGraph
from heightmap25d_ros.planning.plan import Pose2D

CELL = 0.125
FIELDS = (
    "height", "gradient", "weight", "occupied", "forbidden", "enterable", "blocked", "incoming",
)  # fmt: skip
DEPTH = 0.4
COARSE = with_values(
    Params(), {"traversability.robot_radius": 0.25, "planner.clearance": 0.2},
)  # fmt: skip


def ground(rng, shape):
    """Rough ground with boxes; a third of it unknown, in patches."""
    metres = rng.normal(0.0, 0.02, shape)
    for _ in range(shape[0] * shape[1] // 300):
        y, x = rng.integers(0, shape[0]), rng.integers(0, shape[1])
        metres[y : y + rng.integers(1, 8), x : x + rng.integers(1, 8)] += rng.choice([0.2, -0.4, 2])
    metres[ndimage.uniform_filter(rng.random(shape), 7) < 0.47] = np.nan
    return metres


def shown(metres, corner, suspected):
    """A map that begins at a cell (iy, ix) of the world."""
    height_map = HeightMap.from_metres(
        metres, resolution=CELL, origin=(corner[1] * CELL, corner[0] * CELL)
    )
    height = height_map.height.copy()
    height[suspected & ~height_map.known] = SUSPECTED
    return replace(height_map, height=height)


def changed(rng, metres, suspected):
    """Some patches of a map are seen, seen otherwise, or forgotten."""
    metres, suspected = metres.copy(), suspected.copy()
    for _ in range(rng.integers(1, 4)):
        part = tuple(slice(n := int(rng.integers(0, side)), n + 3) for side in metres.shape)
        metres[part] = rng.choice([0.0, 0.3, np.nan]) + rng.normal(0.0, 0.01, metres[part].shape)
        suspected[part] = rng.random() < 0.3
    return metres, suspected


@pytest.fixture(scope="module", autouse=True)
def small_blocks():
    """No more is made anew than has to be, in several pieces."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kept_graph, "_BLOCK", 1)
        patch.setattr(kept_graph, "_PIECE", 40)
        yield


@draws(12)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["forbid", "cost"]), st.booleans())
def test_what_is_kept_and_renewed_is_the_graph_of_the_whole(seed, unknown, has_boundary):
    rng = np.random.default_rng(seed)
    params = with_values(COARSE, {"planner.unknown": unknown})
    boundary = Boundary.of([(1, 1), (9, 2), (8, 12), (2, 9)] if has_boundary else [])
    kept = KeptGraph(params.traversability, params.planner, boundary, DEPTH)
    world = ground(rng, (110, 130))
    suspected = rng.random(world.shape) < 0.02
    area = Area(20, 20, 70, 80)
    for _ in range(4):
        here = area.slices(Area(0, 0, *world.shape))
        height_map = shown(world[here], (area.iy, area.ix), suspected[here])
        graph = kept.of(height_map)
        whole = transition_graph(height_map, params.traversability, params.planner, DEPTH)
        whole = confined(whole, boundary)
        for name in FIELDS:
            values, expected = getattr(graph, name), getattr(whole, name)
            assert np.array_equal(values, expected, equal_nan=name == "height"), name
        world, suspected = changed(rng, world, suspected)
        area = area.hull(area.grown(int(rng.integers(0, 6)))).within(Area(0, 0, *world.shape))


def test_a_map_that_is_another_one_is_looked_at_anew():
    kept = KeptGraph(TraversabilityParams(), PlannerParams())
    large = kept.of(HeightMap.from_metres(np.zeros((30, 30))))
    small = kept.of(HeightMap.from_metres(np.zeros((10, 20))))
    assert large.enterable.shape == (30, 30)
    assert small.enterable.shape == (10, 20)
    assert kept.of(HeightMap.from_metres(np.zeros((20, 20)), resolution=0.5)).enterable.any()


def test_what_is_lent_stays_and_what_is_not_becomes_the_next():
    rng = np.random.default_rng(3)
    world, nothing = ground(rng, (60, 70)), np.zeros((60, 70), bool)
    kept = KeptGraph(COARSE.traversability, COARSE.planner)
    first = kept.of(shown(world, (0, 0), nothing))
    before = {name: getattr(first, name).copy() for name in FIELDS}
    kept.lend()
    world[20:30, 20:30] = 1.0
    second = kept.of(shown(world, (0, 0), nothing))
    for name in FIELDS:
        assert np.array_equal(getattr(first, name), before[name], equal_nan=name == "height")
    assert not np.array_equal(second.enterable, first.enterable)
    world[40:50, 20:30] = 1.0
    assert kept.of(shown(world, (0, 0), nothing)) is second


def test_unknown_cells_have_the_height_of_known_ones_that_are_near():
    metres = np.full((1, 9), np.nan)
    metres[0, 0], metres[0, 8] = 1.0, 3.0
    terrain, planner = COARSE.traversability, COARSE.planner
    graph = transition_graph(HeightMap.from_metres(metres, resolution=1.0), terrain, planner, 2.0)
    expected = [[1.0, 1.0, 1.0, np.nan, np.nan, np.nan, 3.0, 3.0, 3.0]]
    assert np.array_equal(graph.height, np.array(expected, np.float32), equal_nan=True)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_places_are_chosen_as_by_one_who_sees_the_map_for_the_first_time(seed):
    rng = np.random.default_rng(seed)
    world = ground(rng, (80, 100))
    world[20:60, 10:60] = rng.normal(0.0, 0.01, (40, 50))
    explorer, robot = Explorer(Params()), Pose2D(4.0, 5.0, yaw=0.3)
    for _ in range(4):
        height_map = HeightMap.from_metres(world, resolution=CELL)
        survey, anew = (one.survey(height_map, robot) for one in (explorer, Explorer(Params())))
        assert np.array_equal(survey.costs, anew.costs)
        assert np.array_equal(survey.scenery.wanted, anew.scenery.wanted)
        choice, other = explorer.choose(survey), Explorer(Params()).choose(anew)
        assert (choice.goal, choice.gain) == (other.goal, other.gain)
        assert choice.goal is not None
        world, _ = changed(rng, world, np.zeros(world.shape, bool))
