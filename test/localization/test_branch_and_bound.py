# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bounds and search against a slow reading of their definition, on small random maps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros.localization.branch_and_bound import (
    ROOT,
    SLACK,
    Descent,
    bounds,
    ground_of,
    turned,
)
from heightmap25d_ros.localization.height_pyramid import LEVELS
from heightmap25d_ros.localization.matching import Cost, RegistrationPoints, match
from heightmap25d_ros.localization.surface import Surface, edges

CELL = 0.25
COST = Cost(clip=0.3, unknown=1.0, z_range=1.0)
YAWS = np.arange(5) * (2 * np.pi / 5)
EVERYWHERE = (0.0, 0.0, math.inf)
GROUND_Z = 0.3
NEAR = 8


@st.composite
def situations(draw):
    """A map of whole centimetres with a gap, and points about a robot somewhere in it."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rows, columns = rng.integers(6, 20, 2)
    centimetres = rng.integers(-4, 5, (rows, columns)).astype(np.float32)
    is_high = rng.random((rows, columns)) < 0.15
    centimetres[is_high] += rng.integers(20, 60, is_high.sum())
    heights = np.float32(0.01) * centimetres
    heights[rng.random((rows, columns)) < 0.1] = math.nan
    row, column = rng.integers(0, rows), rng.integers(0, columns)
    heights[row : row + 6, column : column + 6] = math.nan
    over = Surface(heights, edges(heights, 0.15), (-1.0, 2.0), CELL)
    count = int(rng.integers(5, 20))
    spread = rng.choice([0.5, 2.0, 6.0])
    points = RegistrationPoints(
        np.column_stack([rng.normal(0.0, spread, (count, 2)), rng.choice([0.3, 0.34, 0.7], count)]),
        rng.random(count) < 0.5, rng.uniform(0.1, 1.0, count),
    )  # fmt: skip
    return over, points, rng


def slow_ground(over: Surface, y: int, x: int) -> float | None:
    """The height [m] of the nearest known cell that is no edge, if it is within four cells."""
    is_ground = np.argwhere(~np.isnan(over.heights) & ~over.is_edge)
    distance = np.hypot(*(is_ground - (y, x)).T) if len(is_ground) else np.array([math.inf])
    if distance.min() > 4.0:
        return None
    nearest = {over.heights[tuple(cell)] for cell in is_ground[distance == distance.min()]}
    return nearest.pop() if len(nearest) == 1 else math.nan  # which of them is left open


def slow_bound(over, points, yaw, y, x, limit):
    """Least mean cost of a leaf: each point takes the cheapest that it can touch."""
    ground = slow_ground(over, y, x)
    if ground is None or math.isnan(ground):
        return math.inf if ground is None else math.nan
    least = math.inf
    weights = points.weight / points.weight.sum()
    for k in range(3):
        low = ground - SLACK + k * 2 * SLACK / 3 - GROUND_Z
        high = low + 2 * SLACK / 3
        total = uncounted = 0.0
        for (px, py, pz), is_edge, weight in zip(points.xyz, points.is_edge, weights, strict=True):
            u = x + (math.cos(yaw) * px - math.sin(yaw) * py) / CELL
            v = y + (math.sin(yaw) * px + math.cos(yaw) * py) / CELL
            choices, known, can_count = [], [], False
            for iy in range(math.floor(v - 0.5), math.floor(v - 0.5) + 3):
                for ix in range(math.floor(u - 0.5), math.floor(u - 0.5) + 3):
                    height, cost = slow_cell(over, iy, ix, is_edge)
                    known += [] if height is None else [height]
                    can_count |= height is not None or cost is not None
                    choices += [] if height is not None else [limit if cost is None else cost]
                    if is_edge and height is not None and over.is_edge[iy, ix]:
                        choices.append(0.0)
            if known:  # any height between the lowest and the highest
                off = max(pz + low - max(known), min(known) - pz - high, 0.0)
                choices.append(min(off, COST.clip))
            total += weight * min(choices)
            uncounted += 0.0 if can_count else weight
        total += max(uncounted - 0.5, 0.0) * (COST.unknown * COST.clip - limit)
        least = min(least, total)
    return least


def slow_cell(over, iy, ix, is_edge):
    """Height of a cell, or the cost [m] of a point over an unknown one; None: not counted."""
    rows, columns = over.heights.shape
    is_inside = 0 <= iy < rows and 0 <= ix < columns
    if is_inside and not math.isnan(over.heights[iy, ix]):
        return float(over.heights[iy, ix]), None
    around = over.heights[max(iy - NEAR, 0) : max(iy + NEAR + 1, 0),
                          max(ix - NEAR, 0) : max(ix + NEAR + 1, 0)]  # fmt: skip
    is_near = is_edge and not np.isnan(around).all()
    return None, COST.unknown * COST.clip if is_near else None


def prepared(over, points):
    seen = turned(points, YAWS, CELL, GROUND_Z)
    return seen, ground_of(over.pyramid, COST, is_z_known=True)


def roots_of(over):
    rows, columns = over.heights.shape
    return np.array([
        (w, LEVELS - 1, y, x) for w in range(len(YAWS)) for y in range(0, rows, ROOT)
        for x in range(0, columns, ROOT)
    ], np.int32)  # fmt: skip


def begun(over, seen, ground, within, room):
    """A search from all squares of the map."""
    descent = Descent(seen, ground, within, room)
    descent.begin(roots_of(over))
    return descent


def all_leaves(over):
    rows, columns = over.heights.shape
    cells = np.ndindex(len(YAWS), rows, columns)
    return np.array([(w, 0, y, x) for w, y, x in cells], np.int32)


def nodes_around(leaves):
    """The nodes (LEVELS * K, 4) that leaves (K, 4) are in."""
    level = np.arange(LEVELS)[:, None]
    y, x = (leaves[:, index] >> level << level for index in (2, 3))
    yaw = np.broadcast_to(leaves[:, 0], y.shape)
    return np.stack([yaw, np.broadcast_to(level, y.shape), y, x], axis=2).reshape(-1, 4)


def found_by(descent, limit, piece):
    while not descent.is_done:
        descent.divide(limit, piece)
    return {tuple(leaf) for leaf in descent.leaves.tolist()}


@draws(25, deadline=None)
@given(situations(), st.floats(0.02, 0.25))
def test_bounds_of_leaves_are_the_slow_ones(situation, limit):
    over, points, rng = situation
    seen, ground = prepared(over, points)
    leaves = all_leaves(over)
    leaves = leaves[rng.permutation(len(leaves))[:20]]
    for leaf, bound in zip(leaves, bounds(seen, leaves, ground, limit), strict=True):
        slow = slow_bound(over, points, YAWS[leaf[0]], leaf[2], leaf[3], limit)
        if math.isnan(slow):
            continue
        # Heights are kept in whole centimetres, and sums above the limit not to their end.
        assert min(bound, limit) == pytest.approx(min(slow, limit), abs=1e-5)


@draws(25, deadline=None)
@given(situations(), st.floats(1.0, 2.0))
def test_all_within_a_factor_of_the_best_are_found_and_no_others(situation, factor):
    over, points, _ = situation
    seen, ground = prepared(over, points)
    leaves = all_leaves(over)
    brute = bounds(seen, leaves, ground, COST.clip)
    if not np.isfinite(brute).any():
        return
    limit = min(max(factor * float(brute.min()), 0.01), COST.clip)
    brute = bounds(seen, leaves, ground, limit)
    # A node can be above what it contains: its slices of z are others.
    around = bounds(seen, nodes_around(leaves), ground, limit).reshape(LEVELS, -1)
    expected = {tuple(leaf) for leaf in leaves[(around[:-1] <= limit).all(axis=0)].tolist()}
    descent = begun(over, seen, ground, EVERYWHERE, len(leaves) + 8)
    assert found_by(descent, limit, 10**9) == expected
    sliced = begun(over, seen, ground, EVERYWHERE, len(leaves) + 8)
    assert found_by(sliced, limit, 7) == expected
    assert sliced.nodes == descent.nodes


@draws(100, deadline=None)
@given(situations(), st.floats(0.02, 0.3))
def test_no_pose_within_the_limit_is_in_a_node_above_it(situation, limit):
    over, points, rng = situation
    seen, ground = prepared(over, points)
    leaf = all_leaves(over)[rng.integers(0, len(YAWS) * over.heights.size)]
    height = over.pyramid.ground_at(leaf[2:3].astype(np.int64), leaf[3:4].astype(np.int64))[0]
    if math.isnan(height):
        return
    lifted = points._replace(xyz=points.xyz + (0.0, 0.0, height - GROUND_Z))
    for _ in range(20):
        x, y = over.origin + CELL * (leaf[[3, 2]] + rng.uniform(0.0, 1.0, 2))
        found = match(lifted, np.array([x, y, YAWS[leaf[0]]]), over, COST)
        if abs(found.z) <= SLACK and found.score < limit:
            assert (bounds(seen, nodes_around(leaf[None]), ground, limit) <= limit + 1e-5).all()


def test_only_leaves_within_the_circle_are_kept():
    heights = np.zeros((20, 30), np.float32)
    over = Surface(heights, edges(heights, 0.15), (0.0, 0.0), CELL)
    points = RegistrationPoints(np.full((5, 3), (0.0, 0.0, 0.3)), np.zeros(5, bool), np.ones(5))
    seen, ground = prepared(over, points)
    descent = begun(over, seen, ground, (8.0, 20.0, 5.0), 10_000)
    cells = {leaf[2:] for leaf in found_by(descent, 0.1, 1000)}
    rows, columns = np.mgrid[:20, :30]
    is_within = np.hypot(rows + 0.5 - 8.0, columns + 0.5 - 20.0) <= 5.0
    assert cells == set(zip(*(index.tolist() for index in np.nonzero(is_within)), strict=True))


def test_a_full_search_stops_and_drops_what_is_above_a_lower_limit():
    heights = np.zeros((20, 30), np.float32)
    heights[:, 15:] = 0.12
    over = Surface(heights, edges(heights, 0.15), (0.0, 0.0), CELL)
    xyz = np.column_stack(
        [np.linspace(-2, 2, 9), np.zeros(9), np.where(np.arange(9) < 5, 0.3, 0.5)]
    )
    points = RegistrationPoints(xyz, np.zeros(9, bool), np.ones(9))
    seen, ground = prepared(over, points)
    descent = begun(over, seen, ground, EVERYWHERE, 100)
    descent.divide(0.2, 10**6)
    assert descent.is_full
    assert not descent.is_done
    before = {tuple(leaf) for leaf in descent.leaves.tolist()}
    found = bounds(seen, descent.leaves, ground, 0.2)
    limit = float(np.median(found))
    descent.keep(limit)
    after = {tuple(leaf) for leaf in descent.leaves.tolist()}
    assert after <= before
    assert (bounds(seen, descent.leaves, ground, limit) <= limit).all()
