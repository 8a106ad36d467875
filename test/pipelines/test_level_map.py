# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map that comes once, and what changes of it afterwards."""

from dataclasses import replace

import numpy as np
import pytest
from bag_writer import rclpy_type
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros.grid.height_map import Area, HeightMap
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.io import encode
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.level_map import LevelMap

SECOND = 10**9
FLAT = HeightMap.from_metres(np.zeros((6, 9)), origin=(-2.0, 3.0))
RAISED = HeightMap.from_metres(np.full((6, 9), 0.5), origin=(-2.0, 3.0))


def message(height_map, stamp, loaded=1):
    result = rclpy_type("heightmap25d_msgs/msg/HeightGrid")()
    loaded *= SECOND
    encode.fill_height_grid(result, height_map, stamp * SECOND, "map", loaded=loaded)
    return result


def with_raised(*areas):
    """Heights of the flat map, raised in areas."""
    metres = np.zeros((6, 9))
    for area in areas:
        metres[area.slices(Area(0, 0, 6, 9))] = 0.5
    return metres


@pytest.fixture
def levels():
    return LevelMap("map", Drops())


FIRST, SECOND_PART = Area(1, 2, 2, 3), Area(2, 4, 3, 5)


def test_an_update_takes_the_place_of_its_cells(levels):
    before = levels.take_lowest(message(FLAT, 1))
    after = levels.take_update(message(RAISED.part(FIRST), 2))
    assert np.array_equal(after.metres, with_raised(FIRST))
    after = levels.take_update(message(RAISED.part(SECOND_PART), 3))
    assert np.array_equal(after.metres, with_raised(FIRST, SECOND_PART))
    assert np.array_equal(before.metres, FLAT.metres)


def test_updates_that_come_before_their_map_wait_for_it(levels):
    assert levels.take_update(message(RAISED.part(FIRST), 2, loaded=5)) is None
    assert levels.take_update(message(RAISED.part(SECOND_PART), 3, loaded=5)) is None
    after = levels.take_lowest(message(FLAT, 1, loaded=5))
    assert np.array_equal(after.metres, with_raised(FIRST, SECOND_PART))


def test_updates_of_another_map_are_not_used(levels):
    assert levels.take_update(message(RAISED.part(FIRST), 2, loaded=5)) is None  # never came
    assert levels.take_update(message(RAISED.part(SECOND_PART), 3, loaded=7)) is None
    levels.take_lowest(message(FLAT, 1, loaded=7))
    assert levels.take_update(message(RAISED.part(FIRST), 2, loaded=5)) is None
    after = levels.take_update(message(FLAT.part(Area(0, 0, 1, 1)), 4, loaded=7))
    assert np.array_equal(after.metres, with_raised(SECOND_PART))


@pytest.mark.parametrize(
    "part",
    [
        replace(FLAT, geometry=replace(FLAT.geometry, origin=(-1.875, 3.0))),
        replace(FLAT, geometry=replace(FLAT.geometry, resolution=0.25)),
        replace(FLAT, geometry=replace(FLAT.geometry, ground_zero=7.0)),
        replace(FLAT, probability_threshold=0.9),
    ],
)
def test_what_is_no_part_of_the_map_is_counted(part):
    dropped = Drops()
    levels = LevelMap("map", dropped)
    levels.take_lowest(message(FLAT, 1))
    assert levels.take_update(message(part, 2)) is None
    assert dict(dropped) == {"map update: bad info": 1}


def test_upper_surfaces_belong_to_an_update_of_their_stamp(levels):
    levels.take_lowest(message(FLAT, 1))
    deck = replace(FLAT, upper=UpperSurfaces.of([(3, 4)], top=[300], bottom=[280]))
    above = rclpy_type("heightmap25d_msgs/msg/UpperSurfaces")()
    encode.fill_upper_surfaces(above, deck, 2 * SECOND, "map")
    assert levels.take_upper(above) is None  # the lowest ones of that stamp are still to come
    after = levels.take_update(message(RAISED.part(FIRST), 2))
    assert after.upper.cell.tolist() == [[3, 4]]
    assert np.array_equal(after.metres, with_raised(FIRST))


@draws(20)
@given(st.integers(0, 2**32 - 1))
def test_a_map_and_its_updates_are_the_map_as_it_is(seed):
    rng = np.random.default_rng(seed)
    levels, metres = LevelMap("map", Drops()), rng.choice([0.0, 1.0, np.nan], (20, 30))
    shown = levels.take_lowest(message(HeightMap.from_metres(metres), 1))
    for stamp in range(2, 8):
        iy, ix = rng.integers(0, (20, 30))
        metres[iy : iy + 4, ix : ix + 5] = rng.choice([0.0, 2.0, np.nan])
        here = Area(int(iy), int(ix), 4, 5).within(Area(0, 0, 20, 30))
        update = HeightMap.from_metres(metres).part(here)
        shown = levels.take_update(message(update, stamp))
        assert np.array_equal(shown.metres, metres, equal_nan=True)
