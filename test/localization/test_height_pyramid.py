# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The windows of a map, cell by cell, and the ground that the robot can stand on."""

from __future__ import annotations

import numpy as np
import pytest

from heightmap25d_ros.localization.height_pyramid import (
    BEYOND,
    EDGE,
    KNOWN,
    LEVELS,
    NEAR_KNOWN,
    NOTHING,
    memory_of,
)
from heightmap25d_ros.localization.surface import BORDER, Surface, edges


def small_map() -> Surface:
    rng = np.random.default_rng(1)
    heights = (0.01 * rng.integers(-20, 90, (9, 14))).astype(np.float32)
    heights[2:6, 5:12] = np.nan
    return Surface(heights, edges(heights, 0.15), (0.0, 0.0), 0.125)


@pytest.mark.parametrize("level", range(LEVELS))
def test_windows_hold_what_is_in_their_cells(level):
    over = small_map()
    pyramid = over.pyramid
    heights, is_edge, counts = over.bordered
    side = 2**level + 2
    for y, x in [(-12, -12), (-3, -2), (0, 0), (2, 5), (4, 6), (8, 13), (12, 20)]:
        low, high, flags = pyramid.windows[level, y + pyramid.pad, x + pyramid.pad].tolist()
        cells = (slice(max(y + BORDER, 0), max(y + BORDER + side, 0)),
                 slice(max(x + BORDER, 0), max(x + BORDER + side, 0)))  # fmt: skip
        known = heights[cells][~np.isnan(heights[cells])]
        assert bool(flags & KNOWN) == (len(known) > 0)
        assert bool(flags & EDGE) == bool(is_edge[cells].any())
        is_unknown = np.isnan(heights[cells])
        assert bool(flags & NEAR_KNOWN) == bool((is_unknown & counts[cells]).any())
        is_outside = is_unknown.size < side * side
        assert bool(flags & BEYOND) == bool((is_unknown & ~counts[cells]).any() or is_outside)
        if len(known):
            assert 0.01 * low <= known.min() - pyramid.base + 1e-6 <= 0.01 * low + 0.01
            assert 0.01 * high - 0.01 <= known.max() - pyramid.base + 1e-6 <= 0.01 * high + 1e-5
        else:
            assert (low, high) == (NOTHING, -NOTHING)


def test_ground_is_that_of_the_nearest_cell_that_is_no_edge():
    heights = np.full((20, 20), np.nan, np.float32)
    heights[:8] = 0.25
    heights[3:5, 3:5] = 1.0
    over = Surface(heights, edges(heights, 0.15), (0.0, 0.0), 0.125)
    rows, columns = np.array([3, 7, 11, 12]), np.array([3, 10, 10, 10])
    np.testing.assert_allclose(
        over.pyramid.ground_at(rows, columns), [0.25, 0.25, 0.25, np.nan], atol=1e-6
    )
    for level, block in enumerate(over.pyramid.ground):
        low = np.full_like(block[..., 0], NOTHING)
        for y, x in np.ndindex(20, 20):
            at = y >> level, x >> level
            low[at] = min(low[at], over.pyramid.ground[0][y, x, 0])
        np.testing.assert_array_equal(block[..., 0], low)


def test_memory_is_estimated_before_it_is_taken():
    over = small_map()
    assert over.pyramid.windows.nbytes <= memory_of(over.bordered[0].shape)
    assert memory_of((2000, 2000)) < 300e6
