# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of one place in frames of their own: found in one another, and made one."""

import numpy as np
import pytest
from landmark_worlds import mapped

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.localization.landmarks import landmarks_of
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.map_merge import merge_maps
from heightmap25d_ros.slam.map_registration import Outcome, RegisteredMap, register_maps

PARAMS = Params()
ROOM = (
    ((-6, -3.5), (6, -3.2)), ((-6, 3.5), (6, 2.6)), ((-6, -3.5), (-6, 3.5)), ((6, -3.2), (6, 2.6)),
    ((-4.2, -3.5), (-3.6, -1.4)), ((-3.1, 3.3), (-3.4, 1.9)), ((-1.5, -2.1), (0.4, -1.7)),
    ((-0.9, 3.2), (0.2, 1.4)), ((0.2, 1.4), (1.1, 1.6)), ((2.3, -3.3), (2.9, -1.2)),
    ((3.0, 0.6), (4.5, 1.3)),
)  # fmt: skip
SQUARE = tuple(
    ((x, y), (-y, x)) for x, y in ((-3.0, -3.0), (3.0, -3.0), (3.0, 3.0), (-3.0, 3.0))
)  # fmt: skip
T_HERE_THERE = se3.from_xyz_rpy([2.3, -1.7, 0.4, 0.0, 0.0, 2.1])


def returns_of(walls, part, seed):
    """Ground and walls (N, 3) of a part (x0, x1) of a world, one every 3 cm or so."""
    rng = np.random.default_rng(seed)
    ground = np.column_stack([rng.uniform(*part, 12_000), rng.uniform(-3.5, 3.5, 12_000)])
    floor = np.column_stack([ground, rng.normal(0.0, 0.005, len(ground))])
    places = [
        np.array(a) + np.linspace(0, 1, int(40 * np.hypot(*np.subtract(b, a))))[:, None]
        * np.subtract(b, a) for a, b in walls
    ]  # fmt: skip
    xy = np.concatenate(places)
    xy = np.repeat(xy[(part[0] <= xy[:, 0]) & (xy[:, 0] <= part[1])], 4, axis=0)
    xy = xy + rng.normal(0.0, 0.005, xy.shape)
    return floor, np.column_stack([xy, rng.uniform(0.3, 0.8, len(xy))])


def map_of(walls, part, seed=1, T=None):
    returns = returns_of(walls, part, seed)
    moved = returns if T is None else [se3.transform_points(T, ends) for ends in returns]
    return RegisteredMap(*mapped(*moved), PARAMS)


def error(T):
    """x, y, z [m], yaw [rad] between a pose of the moved map and the true one."""
    return se3.to_xyz_rpy(T @ T_HERE_THERE)[[0, 1, 2, 5]]


@pytest.fixture(scope="module")
def west():
    return map_of(ROOM, (-6, 2))


@pytest.mark.slow
@pytest.mark.parametrize("begin", [-3.0, -1.0])  # overlap of 5 m, and of 3 m
def test_maps_that_overlap_become_one(west, begin):
    east = map_of(ROOM, (begin, 6), 2, T_HERE_THERE)
    found = register_maps(west, east, PARAMS)
    assert found.outcome is Outcome.REGISTERED
    np.testing.assert_allclose(error(found.T_fixed_moving), 0.0, atol=0.03)
    merged = merge_maps([west, east], [np.eye(4), found.T_fixed_moving], PARAMS)
    height_map, geometry = merged.height_map, merged.height_map.geometry
    for x, y, z in ((-5.0, 0.0, 0.0), (5.0, 0.0, 0.0), (0.5, 0.0, 0.0)):
        assert height_map.metres[tuple(geometry.cell_at((x, y)))] == pytest.approx(z, abs=0.03)
    walls = landmarks_of(height_map, merged.layers).walls
    south = walls[np.abs(walls[:, 1] - (-3.35 + 0.025 * walls[:, 0])) < 0.1]
    assert np.ptp(south[:, 0]) > 11.0
    away = south[:, 5] - (-3.35 + 0.025 * south[:, 4])
    np.testing.assert_allclose(np.nanmedian(np.abs(away)), 0.0, atol=0.01)
    assert 0.3 < height_map.metres[tuple(geometry.cell_at((3.75, 0.95)))] < 0.85


@pytest.mark.slow
def test_heights_alone_register_as_well(west):
    east = map_of(ROOM, (-3, 6), 2, T_HERE_THERE)
    plain = [RegisteredMap(m.height_map, None, PARAMS) for m in (west, east)]
    found = register_maps(*plain, PARAMS)
    assert found.outcome is Outcome.REGISTERED
    np.testing.assert_allclose(error(found.T_fixed_moving), 0.0, atol=0.08)
    merged = merge_maps(plain, [np.eye(4), found.T_fixed_moving], PARAMS)
    assert merged.layers is None


@pytest.mark.slow
def test_maps_of_other_places_are_refused(west):
    other = (((-2, -3), (3, -3)), ((-2, 3), (0, 1)), ((0, 3), (3, 2)), ((2, -3), (2.5, 0)))
    found = register_maps(west, map_of(other, (-2, 3), 3, T_HERE_THERE), PARAMS)
    assert found.outcome is Outcome.NO_PLACE


@pytest.mark.slow
def test_a_room_that_looks_the_same_from_all_sides_is_ambiguous():
    fixed, moving = map_of(SQUARE, (-3, 3)), map_of(SQUARE, (-3, 3), 2, T_HERE_THERE)
    found = register_maps(fixed, moving, PARAMS)
    assert found.outcome is Outcome.AMBIGUOUS
    assert len(found.rivals) == 3


def test_nothing_to_hold_on_to_is_no_place():
    flat = RegisteredMap(HeightMap.from_metres(np.zeros((60, 60))), None, PARAMS)
    assert register_maps(flat, flat, PARAMS).outcome is Outcome.NO_PLACE


def merged_of(first, second, T=None):
    maps = [RegisteredMap(m, None, PARAMS) for m in (first, second)]
    return merge_maps(maps, [np.eye(4), np.eye(4) if T is None else T], PARAMS)


def test_equal_evidence_adds_up_and_what_stands_in_one_stands():
    unknown = np.nan
    first = HeightMap.from_metres([[0.00, 0.0, 0.0, 0.0, 0.0, 0.5, unknown, unknown]] * 3)
    second = HeightMap.from_metres([[0.04, 0.0, 0.0, 0.6, 0.0, 0.0, 0.2, unknown]] * 3)
    merged = merged_of(first, second)
    found = merged.height_map.height[0]
    np.testing.assert_array_equal(found[:7], [2, 0, 0, 60, 0, 50, 20])
    np.testing.assert_array_equal(merged.known_by[0], [2, 2, 2, 2, 2, 2, 1, 0])
    np.testing.assert_array_equal(np.flatnonzero(merged.differs[0]), [3, 5])
    assert not merged.height_map.known[0, 7]


def test_an_edge_that_was_rounded_to_the_cell_beside_is_not_doubled():
    first = HeightMap.from_metres([[0.0, 0.0, 0.5, 0.5]])
    second = HeightMap.from_metres([[0.0, 0.5, 0.5, 0.5]])
    np.testing.assert_array_equal(merged_of(first, second).height_map.height, [[0, 0, 50, 50]])


def test_a_turned_map_with_a_deck_lies_where_it_is_told_and_without_holes():
    source = HeightMap.from_metres(np.full((16, 24), 5.0), origin=(1.0, 2.0), ground_zero=5.0)
    deck = UpperSurfaces.of([(2, 3), (2, 4)], [240, 240], [210, 210])
    source = HeightMap(
        geometry=source.geometry, height=source.height, probability=source.probability, upper=deck
    )
    first = HeightMap.from_metres(np.ones((4, 4)))
    T = se3.from_xyz_rpy([0.5, 0.25, -4.0, 0.0, 0.0, np.radians(30)])
    merged = merged_of(first, source, T).height_map
    assert set(np.round(merged.metres[merged.known], 2)) == {1.0}
    inside = source.geometry.cell_center(np.argwhere(np.ones((14, 22)))) + 0.125
    there = merged.geometry.cell_at(inside @ T[:2, :2].T + T[:2, 3])
    assert merged.known[tuple(there.T)].all()
    places = merged.geometry.cell_center(merged.upper.cell)
    expected = T[:2, :2] @ source.geometry.cell_center((2, 3.5)) + T[:2, 3]
    np.testing.assert_allclose(places.mean(axis=0), expected, atol=0.13)
    assert set(merged.upper.top) == {340}  # 2.4 m above 5 m, 4 m lower, above ground zero at 0
