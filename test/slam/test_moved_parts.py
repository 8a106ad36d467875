# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map that follows its submaps, against exact arrays and a literal reference."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.grid.levels import NO_UPPER, UpperSurfaces
from heightmap25d_ros.localization.layers import NAMES, LayerMap
from heightmap25d_ros.slam.moved_parts import CellParts, PartedMap, moved

CELL = 0.5
WORLD = Geometry(resolution=CELL, origin=(-50.0, -50.0), shape=(200, 200))


def parted(metres, parts, upper=NO_UPPER):
    height_map = HeightMap.from_metres(metres, resolution=CELL, origin=(1.0, 2.0))
    height_map = replace(height_map, upper=upper)
    layers = {name: np.zeros(height_map.height.shape, np.float32) for name in NAMES}
    layers["ground_count"] = np.where(height_map.known, np.float32(4.0), np.float32(0.0))
    layers["ground_height"] = np.nan_to_num(height_map.metres).astype(np.float32)
    whole = LayerMap(geometry=height_map.geometry, **layers)
    return PartedMap(height_map, whole, np.array(parts, np.uint32))


def shift(x=0.0, y=0.0, z=0.0, yaw=0.0):
    return se3.from_xyz_rpy([x, y, z, 0.0, 0.0, yaw])


def at(found, xy):
    """Height at a place, None where nothing is known."""
    geometry = found.height_map.geometry
    cell = tuple(geometry.cell_at(xy))
    if not geometry.contains(np.array(cell)) or not found.height_map.known[cell]:
        return None
    return float(found.height_map.metres[cell])


def test_a_part_goes_and_the_others_stay():
    metres = [[0.0, 0.1, 0.2, np.nan]]
    source = parted(metres, [[1, 1, 2, 0]], UpperSurfaces.of([(0, 2)], [250], [240]))
    found = moved(source, np.stack([shift(), shift(), shift(CELL, 2 * CELL, 0.3)]), WORLD)
    assert [at(found, (x, 2.25)) for x in (1.25, 1.75, 2.25)] == [0.0, 0.1, None]
    assert at(found, (2.75, 3.25)) == pytest.approx(0.5)
    height_map = found.height_map
    cell = tuple(height_map.geometry.cell_at((2.75, 3.25)))
    assert height_map.upper.cell.tolist() == [list(cell)]
    assert height_map.upper.top.tolist() == [280]
    assert found.parts[cell] == 2
    assert found.layers.ground_count[cell] == 4.0
    assert found.layers.ground_height[cell] == pytest.approx(0.5)
    assert found.layers.ground_count.sum() == source.layers.ground_count.sum()


def test_of_parts_that_come_to_lie_on_one_another_the_newest_counts():
    """The wall was seen twice, a cell apart; so there is one in the end, and ground beside it."""
    source = parted([[0.0, 1.0, 0.0, 1.0, 0.0]], [[1, 1, 2, 2, 2]])
    found = moved(source, np.stack([shift(), shift(), shift(-2 * CELL)]), WORLD)
    heights = [at(found, (1.25 + k * CELL, 2.25)) for k in range(5)]
    assert heights == [0.0, 1.0, 0.0, None, None]
    assert found.parts[found.height_map.known].tolist() == [2, 2, 2]


def test_parts_that_move_apart_by_half_a_cell_leave_no_gap():
    source = parted([[0.0, 0.1, 0.2, 0.3]], [[1, 1, 2, 2]])
    found = moved(source, np.stack([shift(), shift(), shift(0.7 * CELL)]), WORLD)
    heights = [at(found, (1.25 + k * CELL, 2.25)) for k in range(5)]
    assert heights == [0.0, 0.1, 0.2, 0.2, 0.3]


@pytest.mark.parametrize("gap", [1, 2])
def test_parts_that_move_apart_leave_no_gap(gap):
    source = parted([[0.0] * 6 + [1.0] * 6], [[1] * 6 + [2] * 6])
    found = moved(source, np.stack([shift(), shift(), shift(gap * CELL)]), WORLD)
    heights = [at(found, (1.25 + k * CELL, 2.25)) for k in range(12 + gap)]
    assert heights[:6] == [0.0] * 6
    assert heights[6 + gap :] == [1.0] * 6
    assert all(height in (0.0, 1.0) for height in heights[6 : 6 + gap])


def test_parts_that_move_far_apart_leave_one():
    source = parted([[0.0] * 6 + [1.0] * 6], [[1] * 6 + [2] * 6])
    found = moved(source, np.stack([shift(), shift(), shift(3 * CELL)]), WORLD)
    heights = [at(found, (1.25 + k * CELL, 2.25)) for k in range(15)]
    assert heights == [0.0] * 6 + [None] * 3 + [1.0] * 6


def test_what_was_not_known_between_parts_is_no_gap():
    source = parted([[0.0] * 3 + [np.nan] * 2 + [1.0] * 3], [[1] * 4 + [2] * 4])
    found = moved(source, np.stack([shift(), shift(), shift(CELL)]), WORLD)
    heights = [at(found, (1.25 + k * CELL, 2.25)) for k in range(9)]
    assert heights[:5] == [0.0] * 3 + [None] * 2
    assert heights[6:] == [1.0] * 3


def landed(source, metres, motions, cell, geometry):
    """Height of what lands in a cell of the target; None where nothing does."""
    begun = source.height_map.geometry
    for part in reversed(range(len(motions))):
        back = se3.inverse(motions[part])
        xy = back[:2, :2] @ geometry.cell_center(np.array(cell)) + back[:2, 3]
        there = tuple(begun.cell_at(xy))
        inside = begun.contains(np.array(there)) and source.parts[there] == part
        if inside and np.isfinite(metres[there]):
            return metres[there] + motions[part][2, 3]
    return None


def nearest(source, metres, motions, xy):
    """Heights of the cells whose middles land nearest to a place."""
    known = np.argwhere(np.isfinite(metres))
    motion = motions[source.parts[tuple(known.T)]]
    centers = source.height_map.geometry.cell_center(known)
    there = np.einsum("nij,nj->ni", motion[:, :2, :2], centers) + motion[:, :2, 3]
    apart = np.abs(there - xy).max(axis=1)
    lifted = metres[tuple(known.T)] + motion[:, 2, 3]
    return lifted[apart < apart.min() + 1e-9]


def square(cell, shape, reach=1):
    ranges = (
        range(max(n - reach, 0), min(n + reach + 1, end))
        for n, end in zip(cell, shape, strict=True)
    )
    return list(product(*ranges))


def is_closed(heights, cell):
    """Whether every square of 3 x 3 cells around a cell holds one in which something landed."""
    return all(
        any(heights[other] is not None for other in square(middle, heights.shape))
        for middle in product(*(range(n - 1, n + 2) for n in cell))  # also beyond the edge
    )


@pytest.mark.parametrize(("apart", "aside", "turn"), [(0.6, 0.3, 0.1), (0.0, 1.0, 0.5)])
@pytest.mark.parametrize("seed", range(3))
def test_turned_parts_have_no_holes_as_a_literal_reference_has_none(seed, apart, aside, turn):
    rng = np.random.default_rng(seed)
    metres = np.where(rng.random((14, 17)) < 0.9, rng.integers(0, 40, (14, 17)) / 100, np.nan)
    parts = np.arange(17)[None] // 6 + np.zeros((14, 1), int)
    motions = np.stack([shift(), *(
        shift(
            *rng.normal((apart * k, 0.0), aside), 0.01 * rng.integers(-5, 5),
            rng.normal(0.0, turn),
        )
        for k in (1, 2)
    )])  # fmt: skip
    source = parted(metres, parts)
    found = moved(source, motions, WORLD)
    geometry, begun = found.height_map.geometry, source.height_map.geometry
    heights = np.full(geometry.shape, None)
    for cell in np.ndindex(geometry.shape):
        heights[cell] = landed(source, metres, motions, cell, geometry)
    filled = 0
    for cell in np.ndindex(geometry.shape):
        there = tuple(begun.cell_at(geometry.cell_center(np.array(cell))))
        was_known = begun.contains(np.array(there)) and np.isfinite(metres[there])
        is_filled = heights[cell] is None and was_known and is_closed(heights, cell)
        filled += is_filled
        assert found.height_map.known[cell] == (heights[cell] is not None or is_filled)
        if not found.height_map.known[cell]:
            continue
        possible = [heights[cell]]
        if is_filled:
            possible = nearest(source, metres, motions, geometry.cell_center(np.array(cell)))
        assert np.isclose(possible, found.height_map.metres[cell]).any()
    assert filled > 0 or not apart
    assert found.height_map.known.sum() > 0.7 * source.height_map.known.sum()


def test_what_leaves_the_grid_is_cut_off():
    found = moved(parted([[0.0, 0.1]], [[0, 1]]), np.stack([shift(), shift(x=1e3)]), WORLD)
    assert found.height_map.known.sum() == 1


def test_parts_are_kept_by_cell():
    grid = HeightGrid()
    parts = CellParts(grid)
    area = grid.area_of(Geometry(resolution=0.125, origin=(0.5, 1.0), shape=(3, 5)))
    numbers = np.arange(15, dtype=np.uint32).reshape(3, 5)
    parts.write(area, numbers)
    np.testing.assert_array_equal(parts.read(area), numbers)
    assert parts.read(area.grown(4)).sum() == numbers.sum()
