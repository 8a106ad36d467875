# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from literal_traversability import LiteralTerrain

from heightmap25d_ros.grid.height_map import HEIGHT_LIMIT
from heightmap25d_ros.terrain.steps import (
    NEIGHBOURS,
    cropped,
    padded_surface,
    step_obstacles,
    transitions,
)

# Heights of a few steps, of any size, and at both limits.
HEIGHTS = st.one_of(
    st.integers(-25, 25),
    st.integers(-HEIGHT_LIMIT, HEIGHT_LIMIT),
    st.sampled_from([-HEIGHT_LIMIT, HEIGHT_LIMIT]),
)


@st.composite
def terrains(draw):
    shape = draw(arrays.array_shapes(min_dims=2, max_dims=2, max_side=9))
    height = draw(arrays.arrays(np.int16, shape, elements=HEIGHTS))
    known = draw(arrays.arrays(np.bool_, shape))
    return height, known, draw(st.sampled_from([1, 10, 1000]))


def padded_transitions(height, known, max_step):
    return (cropped(array, 1) for array in transitions(padded_surface(height, known, 1), max_step))


@given(terrains())
def test_transitions_and_obstacles_by_the_definition(case):
    height, known, max_step = case
    literal = LiteralTerrain.of(height, known, max_step, 0)
    blocked, step = padded_transitions(height, known, max_step)
    occupancy = step_obstacles(height, known, max_step)
    for cell in np.ndindex(height.shape):
        if known[cell]:
            assert blocked[cell] == literal.blocked(cell)
            assert step[cell] == literal.largest_step(cell)
            assert occupancy[cell] == (100 if literal.is_upper_end(cell) else 0)
        else:
            assert (blocked[cell], step[cell], occupancy[cell]) == (0, 0, -1)


@given(terrains())
def test_a_blocked_transition_is_so_both_ways_and_ends_in_an_occupied_cell(case):
    height, known, max_step = case
    blocked, _ = padded_transitions(height, known, max_step)
    occupancy = step_obstacles(height, known, max_step)
    for cell in np.ndindex(height.shape):
        for k, (dy, dx) in enumerate(NEIGHBOURS):
            if blocked[cell] >> k & 1:
                other = cell[0] + dy, cell[1] + dx
                assert blocked[other] >> NEIGHBOURS.index((-dy, -dx)) & 1
                assert {occupancy[cell], occupancy[other]} & {100}


@pytest.mark.parametrize("columns", [1, 15, 16, 31, 32, 33, 127, 128, 129, 4095, 4097, 5000])
def test_every_width_of_the_vector_loops(columns):
    rng = np.random.default_rng(columns)
    height = rng.integers(-40, 40, (5, columns)).astype(np.int16)
    known = rng.random(height.shape) < 0.9
    occupancy = step_obstacles(height, known, 30)
    blocked, _ = padded_transitions(height, known, 30)

    # By whole arrays in place of loops.
    around = np.pad(np.where(known, height, 9999).astype(int), 1, constant_values=9999)
    is_upper_end, bits = np.zeros(height.shape, bool), np.zeros(height.shape, np.uint8)
    for k, (dy, dx) in enumerate(NEIGHBOURS):
        there = around[1 + dy : 6 + dy, 1 + dx : columns + 1 + dx]
        both = known & (there != 9999)
        is_upper_end |= both & (height - there > 30)
        bits |= (both & (abs(height - there) > 30)).astype(np.uint8) << k
    assert (occupancy == np.where(known, np.where(is_upper_end, 100, 0), -1)).all()
    assert (blocked == bits).all()


def test_views_and_read_only_arrays_are_taken():
    height = np.arange(12, dtype=np.int16).reshape(3, 4) * 11
    known = np.ones((3, 4), bool)
    height.setflags(write=False)
    expected = step_obstacles(np.ascontiguousarray(height.T), np.ascontiguousarray(known.T), 10)
    assert (step_obstacles(height.T, known.T, 10) == expected).all()
