# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The squares that a sweep finds are those whose bounds, one by one, are within the limit."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros.localization.branch_and_bound import ROOT, bounds, ground_of, turned
from heightmap25d_ros.localization.height_pyramid import LEVELS
from heightmap25d_ros.localization.matching import Cost, RegistrationPoints
from heightmap25d_ros.localization.surface import Surface, edges
from heightmap25d_ros.localization.sweep import Sweep

CELL = 0.25
COST = Cost(clip=0.3, unknown=1.0, z_range=1.0)
YAWS = np.linspace(0.0, 5.0, 3)
EVERYWHERE = 0.0, 0.0, math.inf


def prepared(seed: int, side: int, *, is_z_known: bool):
    """Points, map and windows; the points reach beyond the map on all sides."""
    rng = np.random.default_rng(seed)
    heights = (0.01 * rng.integers(-4, 60, (side, 2 * side))).astype(np.float32)
    heights[rng.random(heights.shape) < 0.5] = math.nan
    heights[: side // 3] = math.nan
    over = Surface(heights, edges(heights, 0.15), (0.0, 0.0), CELL)
    xyz = rng.normal(0.0, 4.0, (40, 3)) * (1.0, 1.0, 0.1)
    points = RegistrationPoints(xyz, rng.random(40) < 0.5, rng.uniform(0.1, 1.0, 40))
    seen = turned(points, YAWS, CELL, 0.0)
    return seen, over.pyramid, ground_of(over.pyramid, COST, is_z_known=is_z_known)


def found_by(sweep: Sweep, limit: float) -> set[tuple[int, ...]]:
    roots = [sweep.roots(strip, 100.0 * limit) for strip in sweep.strips]
    return {tuple(root) for root in np.concatenate(roots).tolist()} if roots else set()


@draws(40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(6, 90), st.floats(0.02, 0.3), st.booleans())
def test_squares_within_a_limit_are_those_bounded_one_by_one(seed, side, limit, is_z_known):
    seen, pyramid, ground = prepared(seed, side, is_z_known=is_z_known)
    rows, columns = ground.levels[-1].shape[:2]
    squares = np.array([
        (w, LEVELS - 1, ROOT * y, ROOT * x) for w, y, x in np.ndindex(len(YAWS), rows, columns)
    ], np.int32)  # fmt: skip
    bound = bounds(seen, squares, ground, limit)
    found = found_by(Sweep(seen, pyramid.phases, ground, EVERYWHERE), limit)
    rounding = 1e-6
    assert {tuple(s) for s in squares[bound <= limit - rounding].tolist()} <= found
    assert found <= {tuple(s) for s in squares[bound <= limit + rounding].tolist()}


def test_with_a_circle_only_squares_that_reach_into_it_are_found():
    seen, pyramid, ground = prepared(1, 60, is_z_known=False)
    everywhere = found_by(Sweep(seen, pyramid.phases, ground, EVERYWHERE), COST.clip)
    inside = found_by(Sweep(seen, pyramid.phases, ground, (20.0, 33.0, 9.0)), COST.clip)

    def distance(y, x):
        return math.hypot(max(y - 20.0, 20.0 - y - ROOT, 0.0), max(x - 33.0, 33.0 - x - ROOT, 0.0))

    near = {root for root in everywhere if distance(*root[2:]) < 9.0}
    assert near <= inside <= everywhere
    assert len(inside) < 2 * len(near)


def test_a_circle_beside_the_map_leaves_nothing_to_sweep():
    seen, pyramid, ground = prepared(1, 20, is_z_known=True)
    for circle in ((-9.0, 5.0, 3.0), (5.0, -9.0, 3.0), (90.0, 5.0, 3.0), (5.0, 90.0, 3.0)):
        assert not Sweep(seen, pyramid.phases, ground, circle).strips
