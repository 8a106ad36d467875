# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from literal_transitions import AROUND, LiteralGround, random_steps
from literal_traversability import LiteralTerrain
from scipy import ndimage
from small_terrain import SEEDS, graph, height_map, random_graph

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import Area
from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.planning.collision import collision_free
from heightmap25d_ros.planning.graph import transition_graph
from heightmap25d_ros.planning.transition_costs import incoming_costs
from heightmap25d_ros.terrain.gap_filling import fill_gaps

CELL = 0.125
ONLY_LENGTH = {
    "climb_weight": 0.0,
    "descent_weight": 0.0,
    "cross_slope_weight": 0.0,
    "roughness_weight": 0.0,
    "clearance_weight": 0.0,
}


def planned(height_cm, known=None, terrain=None, **planner):
    return transition_graph(
        height_map(height_cm, known), terrain or TraversabilityParams(), PlannerParams(**planner)
    )


def assert_costs_by_the_definition(terrain):
    literal = LiteralGround.of(terrain)
    rows, columns = terrain.enterable.shape
    assert terrain.incoming.shape == (rows + 2, columns + 2, 8)
    inner = np.zeros(terrain.incoming.shape, bool)
    inner[1:-1, 1:-1] = True
    assert (terrain.incoming[~inner] == 0).all()
    for cell in np.ndindex(rows, columns):
        for k, (dy, dx) in enumerate(AROUND):
            before = cell[0] + dy, cell[1] + dx
            cost = int(terrain.incoming[cell[0] + 1, cell[1] + 1, k])
            if not literal.is_enterable(before) or not literal.is_open(before, cell):
                assert cost == 0
            else:
                exact = min(70 * literal.cost(before, cell), 7900)
                assert abs(cost - exact) <= 0.5 + 1e-4 * exact  # rounded; 99 is not 70 sqrt(2)
                assert cost >= (70, 99)[k % 2]


@given(SEEDS)
@settings(max_examples=60)
def test_costs_by_the_definition(seed):
    assert_costs_by_the_definition(random_graph(seed, most_side=9))


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (2, 2)])
def test_costs_of_narrow_maps(shape):
    assert_costs_by_the_definition(graph(np.ones(shape, bool)))


def test_costs_up_down_and_across_a_plane():
    gradient = np.zeros((2, 3, 3), np.float32)
    gradient[1] = 0.3  # up along y
    costs = incoming_costs(
        np.ones((3, 3), bool), np.zeros((3, 3), np.uint8), gradient,
        np.full((3, 3), 1.5, np.float32), (2.0, 1.0, 3.0),
    )[2, 2]  # fmt: skip
    along = 1.5 * math.sqrt(1.09)
    assert costs[6] == round(70 * (along + 2.0 * 0.3))  # from below, up
    assert costs[2] == round(70 * (along + 1.0 * 0.3))  # from above, down
    assert costs[0] == costs[4] == round(70 * (1.5 + 3.0 * 0.3))
    part = 0.3 / math.sqrt(2)
    diagonal = 1.5 * math.sqrt(1 + part**2) + 3.0 * part
    assert costs[5] == costs[7] == round(99 * (diagonal + 2.0 * part))
    assert costs[1] == costs[3] == round(99 * (diagonal + 1.0 * part))


@given(SEEDS)
@settings(max_examples=150)
def test_a_part_put_in_place_is_as_if_all_were_built_anew(seed):
    terrain = random_graph(seed)
    rng = np.random.default_rng(seed + 1)
    rows, columns = terrain.enterable.shape
    iy, ix = int(rng.integers(rows)), int(rng.integers(columns))
    area = Area(iy, ix, int(rng.integers(rows - iy + 1)), int(rng.integers(columns - ix + 1)))
    where = np.s_[iy : iy + area.rows, ix : ix + area.columns]
    before = {entry.name: np.copy(getattr(terrain, entry.name)) for entry in fields(terrain)[1:]}
    arrays = {name: before[name].copy() for name in ("enterable", "occupied", "forbidden")}
    for array in arrays.values():
        array[where] = rng.random(area.shape) < 0.6
    parts = {name: array[where].copy() for name, array in arrays.items()}
    blocked = terrain.blocked
    if rng.random() < 0.5 and area == terrain.area:
        blocked = parts["blocked"] = random_steps(rng, (rows, columns), 0.2)
    changed = terrain.with_part(area, **parts)

    expected = graph(
        arrays["enterable"],
        blocked=blocked,
        gradient=terrain.gradient,
        weight=terrain.weight,
        slope_weights=terrain.slope_weights,
    )
    assert (changed.incoming == expected.incoming).all()
    assert (changed.blocked == blocked).all()
    for name, array in arrays.items():
        assert (getattr(changed, name) == array).all()
    for name, array in before.items():
        assert np.array_equal(getattr(terrain, name), array), "the original has changed"


def test_steps_that_are_opened_in_a_part():
    terrain = random_graph(3, most_side=14)
    terrain = graph(
        np.ones((9, 9), bool), blocked=random_steps(np.random.default_rng(3), (9, 9), 0.5)
    )
    inside = np.zeros((9, 9), bool)
    inside[2:5, 3:7] = True
    # Both ends of every step in the part are opened.
    blocked = terrain.blocked.copy()
    for cell in np.argwhere(inside):
        for k, (dy, dx) in enumerate(AROUND):
            if inside[cell[0] + dy, cell[1] + dx]:
                blocked[tuple(cell)] &= ~np.uint8(1 << k)
    area = Area(2, 3, 3, 4)
    changed = terrain.with_part(
        area, enterable=np.ones(area.shape, bool), blocked=blocked[2:5, 3:7]
    )
    assert (changed.incoming == graph(np.ones((9, 9), bool), blocked=blocked).incoming).all()


@given(
    seed=SEEDS,
    radius=st.sampled_from([0.0, 0.1, 0.125, 0.25, 0.3, 0.5]),
    margin=st.sampled_from([0.0, 0.125, 0.2, 0.375]),
)
def test_where_the_robot_fits_by_distances(seed, radius, margin):
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, 30, 2))
    occupied, forbidden = (rng.random(shape) < rng.choice([0.0, 0.01, 0.1]) for _ in range(2))
    expected = np.ones(shape, bool)
    for cells, distance in ((occupied, radius), (forbidden, margin)):
        if cells.any():
            expected &= ndimage.distance_transform_edt(~cells) * CELL > distance + 1e-9
    assert (collision_free(occupied, forbidden, radius, margin, CELL) == expected).all()


def filled(*rows, max_gap=0.25):
    """Heights [cm] of a map given in text after filling; '?' is unknown."""
    table = [row.split() for row in rows]
    known = np.array([[entry != "?" for entry in row] for row in table])
    height = np.array([[0 if entry == "?" else int(entry) for entry in row] for row in table])
    result = fill_gaps(height_map(height, known), max_gap)
    return [
        " ".join(str(h) if k else "?" for h, k in zip(heights, knowns, strict=True))
        for heights, knowns in zip(result.height, result.known, strict=True)
    ]


def test_a_gap_in_the_ground_is_filled_at_its_height():
    rows = ["5 5 5 5 5"] * 5
    assert filled(*rows[:2], "5 5 ? 5 5", *rows[:2]) == rows
    assert filled(*rows[:2], "5 ? ? 5 5", "5 ? ? 5 5", rows[0]) == rows


def test_a_gap_beside_a_wall_becomes_ground():
    assert filled(*["0 0 0 ? 200 200"] * 5) == ["0 0 0 0 200 200"] * 5
    assert filled(*["200 ? 3 3 3 ? 200"] * 5) == ["200 3 3 3 3 3 200"] * 5


def test_the_gap_of_a_drop_off_gets_the_lower_height():
    assert filled(*["0 0 ? -80 -80"] * 5) == ["0 0 -80 -80 -80"] * 5
    low = filled(*["0 0 0 ? ? -80 -80 -80"] * 5)
    assert low == ["0 0 0 0 -80 -80 -80 -80"] * 5 or low == ["0 0 0 -80 -80 -80 -80 -80"] * 5


def test_gaps_that_are_too_wide_stay():
    wide = ["1 1 1 ? ? ? 1 1 1"] * 9
    assert filled(*wide) == wide
    assert filled(*wide, max_gap=0.5) == ["1 1 1 1 1 1 1 1 1"] * 9
    narrow = ["1 1 ? 1 1"] * 5
    assert filled(*narrow, max_gap=0.1) == narrow
    assert filled(*narrow, max_gap=0.0) == narrow


def test_unknown_cells_at_the_edge_of_the_map_are_no_gaps():
    rows = ["? 1 1 1 1"] * 3 + ["? ? ? 1 1"]
    assert filled(*rows) == rows


def test_what_was_known_stays_when_gaps_are_filled():
    rng = np.random.default_rng(4)
    before = height_map(rng.integers(-300, 300, (40, 50)), rng.random((40, 50)) < 0.7)
    after = fill_gaps(before, 0.25)
    assert (after.height[before.known] == before.height[before.known]).all()
    assert after.known[before.known].all()
    gap = after.known & ~before.known
    assert gap.any()
    lowest = np.where(before.known, before.height, 30000)
    for iy, ix in np.argwhere(gap):
        around = np.s_[max(iy - 4, 0) : iy + 5, max(ix - 4, 0) : ix + 5]
        assert lowest[around].min() <= after.height[iy, ix]
        assert (before.height[around][before.known[around]] == after.height[iy, ix]).any()


FLAT = np.zeros((30, 40), np.int16)


@pytest.mark.parametrize(("margin", "rings"), [(0.0, 0), (0.1, 0), (0.125, 1), (0.2, 1), (0.3, 2)])
def test_beyond_the_map_all_is_unknown(margin, rings):
    expected = np.zeros(FLAT.shape, bool)
    expected[rings : 30 - rings, rings : 40 - rings] = True
    assert (planned(FLAT, unknown_margin=margin).enterable == expected).all()
    assert planned(FLAT, unknown_margin=margin, unknown="cost").enterable.all()


def hole():
    known = np.ones(FLAT.shape, bool)
    known[10:18, 12:22] = False
    return known


def test_unknown_ground_is_forbidden():
    terrain = planned(FLAT, hole(), unknown_margin=0.2)
    assert (terrain.forbidden == ~hole()).all()
    assert not terrain.occupied.any()
    expected = ndimage.distance_transform_edt(np.pad(hole(), 1)) * CELL > 0.2
    assert (terrain.enterable == expected[1:-1, 1:-1]).all()


def test_unknown_ground_costs_more():
    height = FLAT + 50
    terrain = planned(height, hole(), unknown="cost", unknown_weight=2.5)
    assert terrain.enterable.all()
    assert not terrain.forbidden.any()
    np.testing.assert_allclose(terrain.weight, np.where(hole(), 1.0, 3.5), rtol=1e-6)
    np.testing.assert_allclose(terrain.height, 0.5, rtol=1e-6)  # continued into the hole
    assert terrain.incoming[15 + 1, 17 + 1, 0] == 70 * 3.5


def test_a_map_of_which_nothing_is_known():
    nothing = np.zeros(FLAT.shape, bool)
    assert not planned(FLAT, nothing).enterable.any()
    assert planned(FLAT, nothing, unknown="cost").enterable.all()


def test_a_plane_has_its_slope_and_costs_what_it_says():
    y, x = np.indices((40, 40))
    terrain = planned(2.0 * x - 1.0 * y + 300, unknown="cost", roughness_weight=0.0)
    inside = np.s_[8:-8, 8:-8]
    np.testing.assert_allclose(terrain.gradient[0][inside], 0.02 / CELL, atol=1e-4)
    np.testing.assert_allclose(terrain.gradient[1][inside], -0.01 / CELL, atol=1e-4)
    np.testing.assert_allclose(terrain.height, 0.02 * x - 0.01 * y + 3.0, atol=1e-5)
    s, c = 0.16, 0.08
    east = math.sqrt(1 + s * s) + 2.0 * s + 3.0 * c
    west = math.sqrt(1 + s * s) + 1.0 * s + 3.0 * c
    assert terrain.incoming[21, 21, 4] == round(70 * east)  # from the west neighbour
    assert terrain.incoming[21, 21, 0] == round(70 * west)


def walled():
    height = np.zeros((40, 60), np.int16)
    height[:, 30] = 150
    return height


def test_a_wall_is_occupied_and_the_robot_keeps_its_radius_from_it():
    terrain = planned(walled(), unknown="cost", terrain=TraversabilityParams(robot_radius=0.5))
    assert (terrain.occupied == (walled() > 0)).all()
    away = np.abs(np.arange(60) - 30)
    assert (terrain.enterable == (away * CELL > 0.5)).all()


def test_closeness_to_a_wall_costs_from_full_to_nothing():
    terrain = planned(
        walled(), unknown="cost", clearance=1.0, clearance_weight=3.0, roughness_weight=0.0,
        terrain=TraversabilityParams(robot_radius=0.5),
    )  # fmt: skip
    away = np.abs(np.arange(60) - 30) * CELL
    expected = 1.0 + 3.0 * np.interp(away, [0.5, 1.5], [1.0, 0.0])
    np.testing.assert_allclose(terrain.weight, np.tile(expected, (40, 1)), rtol=1e-5)
    free = planned(walled(), unknown="cost", clearance=0.0, roughness_weight=0.0)
    assert (free.weight == 1.0).all()


def test_closeness_to_a_pillar_is_by_distance_within_a_twelfth():
    height = np.zeros((61, 61), np.int16)
    height[30, 30] = 200
    terrain = planned(height, unknown="cost", clearance=2.0, roughness_weight=0.0)
    y, x = np.indices(height.shape) - 30
    away = np.hypot(y, x) * CELL
    nearest = 1.0 + np.interp(away, [0.5, 2.5], [1.0, 0.0])
    farthest = 1.0 + np.interp(away * 1.0824, [0.5, 2.5], [1.0, 0.0])
    assert (terrain.weight <= nearest + 1e-5).all()
    assert (terrain.weight >= farthest - 1e-5).all()
    np.testing.assert_allclose(terrain.weight, terrain.weight[::-1], rtol=1e-5)
    np.testing.assert_allclose(terrain.weight, terrain.weight.T, rtol=1e-5)


def test_closeness_counts_from_forbidden_cells_too():
    terrain = planned(FLAT, hole(), clearance=0.5, roughness_weight=0.0)
    assert terrain.weight[14, 10] > 1.0  # 2 cells beside the hole
    assert terrain.weight[14, 2] == 1.0


def test_rough_ground_costs_more():
    rng = np.random.default_rng(6)
    height = rng.integers(-4, 5, (24, 24)).astype(np.int16)
    literal = LiteralTerrain.of(height, np.ones(height.shape, bool), 10, 16)
    limits = TraversabilityParams(max_roughness=0.03, robot_radius=0.5)
    terrain = planned(height, unknown="cost", roughness_weight=4.0, clearance=0.0, terrain=limits)
    for cell in rng.integers(0, 24, (25, 2)):
        _, roughness, _ = literal.plane(tuple(map(int, cell)))
        expected = 1.0 + 4.0 * min(roughness / 3.0, 1.0)
        assert terrain.weight[tuple(cell)] == pytest.approx(expected, rel=1e-4)


def test_a_kerb_is_a_blocked_step_both_ways_and_a_low_one_is_not():
    height = np.zeros((40, 40), np.int16)
    height[:, 20:] = 11
    kerb = planned(height, terrain=TraversabilityParams(robot_radius=0.0), **ONLY_LENGTH)
    low = planned(height - (height > 0), terrain=TraversabilityParams(robot_radius=0.0))
    east, west = np.uint8(1 << 0), np.uint8(1 << 4)
    assert (kerb.blocked[:, 19] & east != 0).all()
    assert (kerb.blocked[:, 20] & west != 0).all()
    assert (kerb.incoming[1:-1, 21, 4] == 0).all()
    assert kerb.occupied[:, 20].all()
    assert not low.blocked.any()
    assert not low.occupied.any()
    assert (low.incoming[3:-3, 21, 4] > 0).all()


def test_ground_that_is_too_steep_is_occupied():
    x = np.indices((30, 30))[1]
    limits = TraversabilityParams(max_slope=math.atan(0.5))
    assert not planned(6 * x, terrain=limits).occupied.any()  # 0.48
    assert planned(7 * x, terrain=limits).occupied[5:-5, 5:-5].all()  # 0.56


def test_a_robot_of_more_than_100_cells_is_refused():
    fine = replace(height_map(FLAT), geometry=replace(height_map(FLAT).geometry, resolution=0.001))
    with pytest.raises(InputError, match="robot_radius"):
        transition_graph(fine, TraversabilityParams(), PlannerParams())


def test_a_gap_of_two_cells_beside_a_wall_becomes_ground():
    assert filled(*["0 0 0 ? ? 200 200"] * 5) == ["0 0 0 0 0 200 200"] * 5


def test_a_gap_of_three_cells_that_is_as_wide_as_allowed():
    assert filled(*["1 1 1 ? ? ? 1 1 1"] * 9, max_gap=0.375) == ["1 1 1 1 1 1 1 1 1"] * 9


def test_a_gap_of_one_cell_that_is_narrower_than_allowed():
    assert filled(*["1 1 ? 1 1"] * 5, max_gap=0.2) == ["1 1 1 1 1"] * 5
