# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where maps differ."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros.grid.height_map import SUSPECTED, Area, HeightMap
from heightmap25d_ros.grid.map_changes import changed_blocks

FLAT = HeightMap.from_metres(np.zeros((5, 7)))


def with_cell(height, probability):
    """A flat map with another cell in its last corner."""
    heights, probabilities = FLAT.height.copy(), FLAT.probability.copy()
    heights[4, 6], probabilities[4, 6] = height, probability
    return replace(FLAT, height=heights, probability=probabilities)


@pytest.mark.parametrize(
    ("before", "after", "is_change"),
    [
        (FLAT, FLAT, False),
        (FLAT, with_cell(0, 60000), False),  # as high, and known as well
        (FLAT, with_cell(1, 65535), True),
        (FLAT, with_cell(0, 0), True),
        (with_cell(3, 0), with_cell(9, 10), False),  # heights of unknown cells have no meaning
        (with_cell(3, 0), with_cell(SUSPECTED, 0), True),
        (with_cell(SUSPECTED, 0), with_cell(SUSPECTED, 0), False),
        (FLAT, replace(with_cell(0, 60000), probability_threshold=0.99), True),
    ],
)
def test_a_cell_has_changed_where_the_map_says_otherwise(before, after, is_change):
    expected = np.zeros((2, 3), bool)
    expected[1, 2] = is_change
    assert np.array_equal(changed_blocks(before, after, side=3), expected)


@draws(20)
@given(st.integers(0, 2**32 - 1))
def test_blocks_are_those_of_changed_cells(seed):
    rng = np.random.default_rng(seed)
    world = rng.choice([0.0, 0.1, np.nan], (12, 17))
    after = HeightMap.from_metres(np.where(rng.random(world.shape) < 0.05, 0.2, world))
    before = HeightMap.from_metres(world).part(Area(2, 3, 8, 11))
    changed = np.ones(world.shape, bool)
    inner, earlier = after.metres[2:10, 3:14], before.metres
    changed[2:10, 3:14] = ~((inner == earlier) | (np.isnan(inner) & np.isnan(earlier)))
    for side in (1, 4):
        expected = np.zeros((-(-12 // side), -(-17 // side)), bool)
        iy, ix = np.nonzero(changed)
        expected[iy // side, ix // side] = True
        assert np.array_equal(changed_blocks(before, after, (2, 3), side), expected)
