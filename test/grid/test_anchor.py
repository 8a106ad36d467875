# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a growing map is anchored, and the bounds of what was observed of it."""

import resource

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros.grid.height_grid import TILE, HeightGrid, anchor_at
from heightmap25d_ros.grid.height_map import Area, HeightMap, local_origin
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import GridParams, MapperParams, SensorParams

GRID = GridParams(resolution=0.125, extent=128.0)
UTM = (500_000.0, 4_500_000.0, 2500.0)


@pytest.mark.parametrize(
    ("position", "anchor"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.99, -0.99, 0.49), (0.0, 0.0, 0.0)),
        ((1.01, -1.01, -0.51), (2.0, -2.0, -1.0)),
        ((500_000.4, 4_500_001.7, 2500.3), (500_000.0, 4_500_002.0, 2500.0)),
    ],
)
def test_a_map_is_anchored_at_whole_tiles_and_whole_metres(position, anchor):
    assert anchor_at(position, 0.125) == anchor  # a tile is 2 m
    grid = HeightGrid(GRID, anchor)
    assert grid.anchor == anchor
    assert grid.geometry.ground_zero == anchor[2]
    assert grid.geometry.contains(grid.geometry.cell_at(position[:2]))


@given(x=st.floats(-1e7, 1e7), y=st.floats(-1e7, 1e7), resolution=st.sampled_from([0.05, 0.1, 0.3]))
def test_cell_boundaries_stay_on_multiples_of_the_resolution(x, y, resolution):
    grid = HeightGrid(GridParams(resolution=resolution, extent=50.0), (x, y, 0.0))
    low = grid.geometry.cell_corner((0, 0))
    high = grid.geometry.cell_corner(grid.geometry.shape)
    assert np.abs(low / resolution - np.rint(low / resolution)).max() < 1e-6
    tile = TILE * resolution
    assert (low <= np.array([x, y]) - 25.0 + tile).all()
    assert (high >= np.array([x, y]) + 25.0 - tile).all()


def scan(rng, count=80, spread=6.0):
    """Beams over a bumpy ground; on a lattice that a translation keeps exactly."""
    origin = rng.uniform(-2, 2, 3) + (0, 0, 1)
    ends = rng.uniform(-spread, spread, (count, 3))
    ends[:, 2] = rng.choice([0.0, 0.05, 0.3, 1.2], count) + rng.normal(0, 0.03, count)
    origins = np.broadcast_to(origin, ends.shape)
    origins, ends = (np.rint(points * 2.0**20) / 2.0**20 for points in (origins, ends))
    return Beams(
        origins=origins, ends=ends, is_hit=rng.random(count) < 0.9, is_lone=rng.random(count) < 0.1
    )


def shifted(beams, offset):
    return Beams(
        origins=beams.origins + offset,
        ends=beams.ends + offset,
        is_hit=beams.is_hit,
        is_lone=beams.is_lone,
    )


@pytest.mark.parametrize("rule", ["paper", "candidate"])
@pytest.mark.parametrize("offset", [UTM, (-2e6, 1e7, -400.0), (0.0, 0.0, 8848.0)])
@draws(10)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_translated_drive_gives_the_same_cells(rule, offset, seed):
    rng = np.random.default_rng(seed)
    scans = [scan(rng) for _ in range(5)]
    grids = HeightGrid(GRID), HeightGrid(GRID, offset)
    for grid, by in zip(grids, (np.zeros(3), np.array(offset)), strict=True):
        mapper = Mapper(grid, SensorParams(), MapperParams(update_rule=rule))
        for beams in scans:
            mapper.integrate(shifted(beams, by))
    here, there = (grid.read(0.5) for grid in grids)
    np.testing.assert_array_equal(here.height, there.height)
    np.testing.assert_array_equal(here.probability, there.probability)
    assert there.geometry.ground_zero == offset[2]
    assert np.subtract(there.geometry.origin, here.geometry.origin).tolist() == list(offset[:2])
    np.testing.assert_allclose(here.metres + offset[2], there.metres, atol=1e-9)


def by_scanning(flags):
    """Bounding box and number of what is set, by looking at all of it."""
    ty, tx = np.nonzero(flags)
    return [*map(int, (ty.min(), tx.min(), ty.max(), tx.max())), len(ty)]


@draws(25)
@given(seed=st.integers(0, 2**32 - 1), takes=st.lists(st.booleans(), min_size=3, max_size=8))
def test_bounds_are_those_that_a_scan_of_all_tiles_finds(seed, takes):
    rng = np.random.default_rng(seed)
    grid = HeightGrid(GRID)
    mapper = Mapper(grid, SensorParams(), MapperParams())
    for is_taken in takes:
        if rng.random() < 0.3:
            side = int(rng.integers(1, 50))
            corner = rng.integers(0, np.array(grid.area.shape) - side)
            grid.write(
                HeightMap(
                    geometry=grid.geometry.part(Area(int(corner[0]), int(corner[1]), side, side)),
                    height=np.zeros((side, side), np.int16),
                    probability=np.full((side, side), 60000, np.uint16),
                    probability_threshold=0.5,
                )
            )
        mapper.integrate(shifted(scan(rng), np.append(rng.uniform(-50, 50, 2), 0.0)))
        assert grid.observed.tolist() == by_scanning(grid.tile_top)
        assert grid.changed.tolist() == by_scanning(grid.tile_changed)
        if is_taken:
            expected = np.argwhere(grid.tile_changed)
            np.testing.assert_array_equal(grid.take_changed(), expected)
            assert not grid.tile_changed.any()
    grid.mark_changed()
    np.testing.assert_array_equal(grid.take_changed(), np.argwhere(grid.tile_top))


def test_an_idle_map_costs_nothing_however_large_its_extent():
    """32 km of cells of 5 cm are 1.7 thousand million tiles: none of them is looked at."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    grid = HeightGrid(GridParams(resolution=0.05, extent=32768.0))
    for _ in range(100):
        grid.mark_changed()
        assert len(grid.take_changed()) == 0
        assert grid.observed_area().shape == (0, 0)
        assert grid.observed_cells == 0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before < 2000


def test_a_map_above_another_ground_zero_is_not_written():
    grid = HeightGrid(GRID, (0.0, 0.0, 3.0))
    with pytest.raises(ValueError, match="ground zero is at 0"):
        grid.write(HeightGrid(GRID).read(0.5, Area(0, 0, 16, 16)))


@given(x=st.floats(-1e7, 1e7), y=st.floats(-1e7, 1e7), z=st.floats(-9000, 9000))
def test_near_a_local_origin_single_precision_keeps_a_millimetre(x, y, z):
    position = np.array([x, y, z])
    origin = local_origin(position)
    kept = (position + 100.0 - origin).astype(np.float32) + origin
    assert np.abs(kept - position - 100.0).max() < 1e-3
