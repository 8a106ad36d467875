# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from level_worlds import BRIDGE, bridge_height, overpass

from heightmap25d_ros.grid.height_map import SUSPECTED, HeightMap
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.terrain.slices import LevelFollower, SurfaceStack


def deck(height, bottom=None, cells=((0, 1),)):
    """Of one surface at each of these cells of a row [cm]."""
    bottom = height if bottom is None else bottom
    return UpperSurfaces.of(cells, [height] * len(cells), [bottom] * len(cells))


def row(*metres, upper=None):
    road = HeightMap.from_metres([metres])
    return SurfaceStack(road if upper is None else replace(road, upper=upper))


def heights(found):
    return np.where(found.layer < 0, -999, found.height_map.height)[0].tolist()


def test_a_map_of_one_level_is_its_own_slice():
    rng = np.random.default_rng(3)
    metres = np.where(rng.random((20, 30)) < 0.8, rng.uniform(-1.0, 2.0, (20, 30)), np.nan)
    one = HeightMap.from_metres(metres)
    stack = SurfaceStack(one)
    start = stack.surface_at(2.0, 1.0, None)
    for found in (stack.lowest(), stack.highest(), stack.followed(start)):
        np.testing.assert_array_equal(found.height_map.known, one.known)
        np.testing.assert_array_equal(found.height_map.height[one.known], one.height[one.known])
    assert len(stack.slices(1)) == 1


@pytest.mark.parametrize("bottom", [69, 70, 71])
def test_what_the_robot_does_not_fit_under_is_solid(bottom):
    stack = row(0.0, 0.0, 0.0, upper=deck(120, bottom))
    expected = [0, 0, 0] if bottom >= 70 else [0, 120, 0]
    assert heights(stack.followed((0, 0, 0))) == expected


def test_from_a_deck_the_ground_beside_it_is_met_and_that_below_it_is_not():
    stack = row(0.0, 0.0, 0.0, 0.0, upper=deck(240, 210, [(0, 1), (0, 2)]))
    assert heights(stack.followed((1, 0, 1))) == [0, 240, 240, 0]
    assert heights(stack.followed((0, 0, 0))) == [0, 0, 0, 0]


def test_ground_below_a_deck_that_nothing_has_seen_is_unknown():
    stack = row(0.0, np.nan, 0.0, upper=deck(240))
    assert heights(stack.followed((0, 0, 0))) == [0, -999, 0]


def plate(lowest, holes=(), z=240, side=9):
    """A deck over all cells of a square, but for holes, above what is lowest there [m]."""
    cells = [tuple(cell) for cell in np.ndindex(side, side) if tuple(cell) not in holes]
    ground = np.zeros((side, side))
    for cell, height in lowest.items():
        ground[cell] = height
    return SurfaceStack(replace(HeightMap.from_metres(ground), upper=deck(z, cells=cells)))


@pytest.mark.parametrize("holes", [[(4, 4)], [(4, 4), (4, 5), (5, 4)]])
def test_where_the_ground_below_a_deck_was_not_seen_in_a_narrow_place_it_is_no_wall(holes):
    stack = plate(dict.fromkeys(holes, 2.4), holes)
    below, above = stack.followed((0, 0, 0)).height_map, stack.followed((1, 0, 0)).height_map
    assert [below.known[cell] for cell in holes] == [False] * len(holes)
    assert [above.height[cell] for cell in holes] == [240] * len(holes)
    assert len(stack.slices(9)) == 2


@pytest.mark.parametrize(
    ("holes", "others"),
    [
        ([(y, x) for y in (3, 4, 5) for x in (3, 4, 5)], {}),  # too wide: nobody knows
        ([(4, 4)], {(4, 5): 0.4}),  # what stands beside it was seen from below: a pillar
        ([(4, 4)], {(4, 4): 2.8}),  # no deck: it is higher
    ],
)
def test_what_may_be_a_pillar_stays_one(holes, others):
    stack = plate({**dict.fromkeys(holes, 2.4), **others}, holes)
    below = stack.followed((0, 0, 0)).height_map
    assert below.known[4, 4]
    assert below.height[4, 4] >= 240


def test_ground_that_is_seen_through_a_hole_in_a_deck_is_not_on_its_level():
    """Though a ramp leads down to it, by which the walk comes to it first."""
    ground = np.zeros((9, 40))
    ground[:, 9:36] = np.linspace(2.4, 0.0, 27)
    cells = [cell for cell in np.ndindex(9, 9) if cell != (4, 4)]
    stack = SurfaceStack(replace(HeightMap.from_metres(ground), upper=deck(240, cells=cells)))
    found = stack.followed((1, 0, 0)).height_map
    assert not found.known[4, 4]
    assert (found.height[:, :9][found.known[:, :9]] == 240).all()
    beside = stack.followed((0, 0, 0)).height_map
    assert beside.height[4, 4] == 0


def test_a_crevice_in_solid_ground_stays_one():
    stack = row(0.0, 0.0, 0.0, -2.0, 0.0, 0.0, 0.0, upper=deck(500))
    assert heights(stack.followed((0, 0, 0))) == [0, 0, 0, -200, 0, 0, 0]


def test_a_wall_that_a_deck_joins_stays_one():
    stack = row(0.0, 0.0, 1.9, upper=deck(240, 210, [(0, 1), (0, 2)]))
    assert heights(stack.followed((0, 0, 0))) == [0, 0, 240]


def test_a_surface_is_followed_across_a_gap_and_no_farther():
    upper = deck(240, cells=[(0, 0), (0, 1), (0, 4), (0, 9)])
    stack = row(*[0.0] * 12, upper=upper)
    found = stack.followed((1, 0, 0)).layer[0].tolist()
    assert found[:5] == [1, 1, -1, -1, 1]  # what is below the deck is not on its level
    assert found[5:9] == [0, 0, 0, 0]  # beside the deck is the ground
    assert found[9] == 1


def test_three_surfaces_are_three_layers():
    upper = UpperSurfaces.of([(0, 1), (0, 1)], [500, 240], [470, 210])
    stack = row(0.0, 0.0, 0.0, upper=upper)
    assert stack.layers_at((0, 1)) == [0, 1, 2]
    assert heights(stack.highest()) == [0, 500, 0]
    assert heights(stack.followed((1, 0, 1))) == [0, 240, 0]


def test_slices_of_an_overpass_hold_all_surfaces_and_overlap():
    stack = SurfaceStack(overpass())
    found = stack.slices(50)
    assert len(found) == 2
    held = np.zeros(stack.top.shape, bool)
    for one in found:
        y, x = np.nonzero(one.layer >= 0)
        held[one.layer[y, x], y, x] = True
    np.testing.assert_array_equal(held, stack.top < 1 << 20)
    # Below the bridge they differ, on the ramps they do not.
    (x0, x1), (y0, y1) = BRIDGE
    iy, ix = stack.geometry.cell_at(((x0 + x1) / 2, (y0 + y1) / 2))
    assert {int(one.layer[iy, ix]) for one in found} == {0, 1}
    ramp = tuple(stack.geometry.cell_at((2.0, (y0 + y1) / 2)))
    assert found[0].layer[ramp] == found[1].layer[ramp]


def test_patches_on_which_the_robot_does_not_fit_get_no_slice():
    stack = row(*[0.0] * 8, upper=deck(240, cells=[(0, 2), (0, 3)]))
    assert len(stack.slices(3)) == 1
    assert len(stack.slices(2)) == 2


def test_the_surface_of_a_pose_is_the_nearest_in_height():
    stack = row(0.0, 0.0, 0.0, upper=deck(240, 210))
    middle = 0.19, 0.06
    assert stack.surface_at(*middle, 2.3) == (1, 0, 1)
    assert stack.surface_at(*middle, 0.1) == (0, 0, 1)
    assert stack.surface_at(*middle, None) == (0, 0, 1)
    assert stack.surface_at(50.0, 50.0, 0.0) is None


def test_the_level_is_followed_though_z_drifts():
    stack = SurfaceStack(overpass())
    (_, _), (y0, y1) = BRIDGE
    y, follower = (y0 + y1) / 2, LevelFollower()
    x = np.arange(0.5, 11.5, 0.25)
    for step, (at, true) in enumerate(zip(x, bridge_height(x), strict=True)):
        drifted = true - 0.05 * step  # 2.2 m in the end
        layer, iy, ix = follower.surface(stack, at, y, drifted)
        assert stack.top[layer, iy, ix] == pytest.approx(100 * true, abs=8)


def test_suspected_drop_offs_stay_suspected():
    road = HeightMap.from_metres([[0.0, np.nan, 0.0, 0.0]])
    height = road.height.copy()
    height[0, 1] = SUSPECTED
    stack = SurfaceStack(replace(road, height=height, upper=deck(240, 210, [(0, 3)])))
    for found in (stack.followed((0, 0, 0)), stack.lowest(), stack.highest()):
        assert found.height_map.suspected.tolist() == [[False, True, False, False]]
