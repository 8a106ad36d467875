# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros.grid.height_grid import TILE, HeightGrid, TiledArray
from heightmap25d_ros.grid.height_map import Area, Geometry, HeightMap
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.params.sections import GridParams, LevelsParams

GEOMETRY = Geometry(resolution=0.5, origin=(-1.0, 2.0), shape=(4, 6))
indices = st.integers(-40, 40)
sizes = st.integers(0, 50)


def test_cells_of_points():
    points = [(-1.0, 2.0), (-0.51, 2.0), (-0.5, 2.49), (-1.01, 1.99), (1.99, 3.99)]
    cells = [(0, 0), (0, 0), (0, 1), (-1, -1), (3, 5)]
    assert GEOMETRY.cell_at(points).tolist() == [list(cell) for cell in cells]
    assert GEOMETRY.contains(cells).tolist() == [True, True, True, False, True]


def test_corner_and_center():
    assert GEOMETRY.cell_corner((1, 2)).tolist() == [0.0, 2.5]
    assert GEOMETRY.cell_center((1, 2)).tolist() == [0.25, 2.75]


@given(iy=st.integers(-1000, 1000), ix=st.integers(-1000, 1000))
def test_a_cell_holds_its_own_center(iy, ix):
    assert GEOMETRY.cell_at(GEOMETRY.cell_center((iy, ix))).tolist() == [iy, ix]


def test_part_of_a_geometry():
    part = GEOMETRY.part(Area(1, 2, 2, 3))
    assert part == Geometry(resolution=0.5, origin=(0.0, 2.5), shape=(2, 3))


@given(iy=indices, ix=indices, rows=sizes, columns=sizes)
def test_reading_any_area_gives_what_a_dense_array_has(iy, ix, rows, columns):
    tiled = TiledArray((2, 3), np.int16)
    dense = np.arange(2 * 3 * TILE**2, dtype=np.int16).reshape(2 * TILE, 3 * TILE)
    tiled.write(Area(0, 0, *dense.shape), dense)
    surrounded = np.zeros((200, 200), np.int16)
    surrounded[100 : 100 + 2 * TILE, 100 : 100 + 3 * TILE] = dense
    expected = surrounded[100 + iy : 100 + iy + rows, 100 + ix : 100 + ix + columns]
    np.testing.assert_array_equal(tiled.read(Area(iy, ix, rows, columns)), expected)


def test_metres_are_exact_in_double_precision_and_nan_where_unknown():
    height = np.array([[-32700, 7, 29, 32700]], np.int16)
    probability = np.array([[65535, 32768, 32767, 40000]], np.uint16)
    geometry = Geometry(resolution=0.5, origin=(0.0, 0.0), shape=(1, 4))
    shown = HeightMap(
        geometry=geometry, height=height, probability=probability, probability_threshold=0.5
    )
    assert shown.metres.dtype == np.float64
    np.testing.assert_array_equal(shown.metres, [[-327.0, 7 * 0.01, np.nan, 327.0]])


def test_writing_half_a_tile_is_misuse():
    with pytest.raises(ValueError, match="whole tiles"):
        TiledArray((2, 2), np.int16).write(Area(0, 8, 16, 16), np.zeros((16, 16), np.int16))


def run(program):
    return subprocess.run(
        [sys.executable, "-c", program], check=False, capture_output=True, text=True
    )


def some_map(origin, shape=(3, 4), resolution=0.125):
    rng = np.random.default_rng(0)
    return HeightMap(
        geometry=Geometry(resolution=resolution, origin=origin, shape=shape),
        height=rng.integers(-300, 300, shape).astype(np.int16),
        probability=rng.integers(1, 65535, shape).astype(np.uint16),
        probability_threshold=0.5,
    )


@pytest.mark.parametrize("origin", [(-0.25, 0.5), (0.0, 0.0), (-7.875, 3.125)])
def test_a_written_map_is_read_again(origin):
    grid = HeightGrid(GridParams(extent=16.0))
    written = some_map(origin)
    grid.write(written)
    iy, ix = grid.geometry.cell_at(written.geometry.cell_center((0, 0)))
    read = grid.read(0.5, Area(int(iy), int(ix), 3, 4))
    assert read.geometry == written.geometry
    np.testing.assert_array_equal(read.height, written.height)
    np.testing.assert_array_equal(read.probability, written.probability)
    assert (grid.read(0.5).probability > 0).sum() == 12
    assert len(grid.take_changed()) >= 1
    assert len(grid.take_changed()) == 0


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (some_map((0.03, 0.0)), "cell boundary"),
        (some_map((0.0, 0.0), resolution=0.25), "resolution"),
        (some_map((0.0, 7.75)), "extent"),
    ],
)
def test_a_map_that_does_not_fit_is_refused_and_the_grid_stays(content, complaint):
    grid = HeightGrid(GridParams(extent=16.0))
    with pytest.raises(ValueError, match=complaint):
        grid.write(content)
    assert grid.observed_area().rows == 0


def test_the_extent_is_covered_and_cell_borders_are_multiples_of_the_resolution():
    grid = HeightGrid(GridParams(resolution=0.05, extent=100.0))
    low, high = grid.geometry.cell_corner((0, 0)), grid.geometry.cell_corner(grid.geometry.shape)
    assert (low <= -50).all()
    assert (high >= 50).all()
    np.testing.assert_allclose(low / 0.05, np.rint(low / 0.05), atol=1e-6)


def test_an_extent_without_enough_addresses_is_refused_with_its_parameter():
    program = """
import resource
resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.params.sections import GridParams, LevelsParams
HeightGrid(GridParams(extent=16384.0))
"""
    result = run(program)
    assert result.stderr.splitlines()[-1].startswith(
        "heightmap25d_ros.errors.InputError: parameter grid.extent: cannot reserve"
    )


def test_memory_follows_what_is_written_and_not_the_extent():
    """4 km x 4 km, a street of 2 km: the addresses are 8 GiB, the memory a few MiB."""
    program = """
import numpy as np
from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.params.sections import GridParams, LevelsParams
def resident():
    return int(open("/proc/self/statm").read().split()[1]) * 4096
grid = HeightGrid(GridParams(extent=4096.0))
piece = dict(height=np.ones((160, 160), np.int16), probability=np.full((160, 160), 9, np.uint16))
before = resident()
for k in range(100):
    geometry = Geometry(resolution=0.125, origin=(-1000.0 + 20 * k, 0.0), shape=(160, 160))
    grid.write(HeightMap(geometry=geometry, probability_threshold=0.5, **piece))
print((resident() - before) / (100 * 160 * 160))
"""
    assert 4.0 <= float(run(program).stdout) <= 10.0  # bytes a cell; 4 + 2 for what write() touches


def literal_main_area(tiles, most):
    """The main area [tiles] of a set of tiles, one group after another."""
    groups, left = [], set(tiles)
    while left:
        group, border = set(), {left.pop()}
        while border:
            group |= border
            around = {(y + dy, x + dx) for y, x in border for dy in (-1, 0, 1) for dx in (-1, 0, 1)}
            border = around & left
            left -= border
        groups.append(group)

    def box(some):
        return tuple(f(axis) for axis in zip(*some, strict=True) for f in (min, max))

    def size(some):
        low_y, high_y, low_x, high_x = box(some)
        return (high_y - low_y + 1) * (high_x - low_x + 1)

    def rank(some):
        low_y, high_y, low_x, high_x = box(some)
        return -len(some), round(np.hypot(low_y + high_y + 1, low_x + high_x + 1), 6)

    groups.sort(key=rank)
    if len({rank(group) for group in groups}) < len(groups):
        return None  # either one is right
    kept = set(groups[0])
    for group in groups[1:]:
        if size(kept | group) <= most:
            kept |= group
    return box(tiles) if size(tiles) <= most else box(kept)


@draws(100)
@given(
    st.sets(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=1, max_size=30),
    st.integers(1, 100),
)
def test_the_main_area_is_what_is_connected_and_what_fits_to_it(tiles, most):
    grid = HeightGrid(GridParams(resolution=1.0, extent=512.0))
    for y, x in tiles:
        spot = HeightMap.from_metres([[0.5]], resolution=1.0, origin=(TILE * x, TILE * y))
        grid.write(spot)
    area = grid.main_area(most * TILE**2)
    assert area.within(grid.observed_area()) == area
    x, y = grid.geometry.cell_corner((area.iy, area.ix)) / TILE
    rows, columns = area.rows // TILE, area.columns // TILE
    expected = literal_main_area(tiles, most)
    if expected is not None:
        assert (y, y + rows - 1, x, x + columns - 1) == expected


def test_of_two_specks_the_one_at_the_anchor_stays():
    for here, there in ((0.0, 100.0), (100.0, 0.0)):
        grid = HeightGrid(GridParams(resolution=1.0, extent=512.0))
        for x in (here, there):
            grid.write(HeightMap.from_metres([[0.5]], resolution=1.0, origin=(x, 0.0)))
        area = grid.main_area(TILE**2)
        assert grid.geometry.cell_corner((area.iy, area.ix)).tolist() == [0.0, 0.0]
        assert area.shape == (TILE, TILE)


def deck_map(iy, ix, rows, columns, seed=0):
    """Ground with up to three surfaces above in some cells, anywhere in the grid."""
    rng = np.random.default_rng(seed)
    cells = np.argwhere(rng.random((rows, columns)) < 0.3)
    cells = np.repeat(cells, rng.integers(1, 4, len(cells)), axis=0)
    top = 100 * (1 + np.arange(len(cells))) % 3000
    geometry = HeightGrid().geometry.part(Area(iy, ix, rows, columns))
    flat = HeightMap.from_metres(np.zeros((rows, columns)), origin=geometry.origin)
    upper = UpperSurfaces.of(cells, top, top - 30, 40000 + np.arange(len(cells)))
    return replace(flat, upper=upper)


@pytest.mark.parametrize("place", [(16400, 16390, 20, 33), (16391, 16405, 7, 50)])
def test_surfaces_above_the_lowest_ones_are_written_and_read(place):
    written = deck_map(*place)
    grid = HeightGrid(levels=LevelsParams(max_surfaces=4))
    grid.write(deck_map(*place, seed=1))  # is replaced
    grid.write(written)
    read = grid.read(area=Area(*place))
    for name in ("cell", "top", "bottom", "probability"):
        np.testing.assert_array_equal(
            getattr(read.upper, name), getattr(written.upper, name), err_msg=name
        )
    part = grid.read(area=Area(place[0] + 3, place[1] + 5, 2, 11)).upper
    expected = written.upper.part(3, 5, 2, 11)
    np.testing.assert_array_equal(part.cell, expected.cell)
    np.testing.assert_array_equal(part.top, expected.top)


def test_of_more_surfaces_than_the_grid_has_layers_the_lower_ones_are_kept():
    written = deck_map(16400, 16390, 20, 33)
    grid = HeightGrid(levels=LevelsParams(max_surfaces=2))
    grid.write(written)
    read = grid.read(area=Area(16400, 16390, 20, 33)).upper
    lower = written.upper.where(written.upper.rank == 0)
    np.testing.assert_array_equal(read.top, lower.top)


def test_what_is_beside_a_written_map_stays():
    grid = HeightGrid(levels=LevelsParams(max_surfaces=4))
    left, right = deck_map(16400, 16390, 5, 5), deck_map(16400, 16395, 5, 5, seed=2)
    grid.write(left)
    grid.write(right)
    np.testing.assert_array_equal(
        grid.read(area=Area(16400, 16390, 5, 5)).upper.top, left.upper.top
    )


def test_surfaces_that_are_none_are_refused():
    with pytest.raises(ValueError, match="differ in length"):
        UpperSurfaces.of([(0, 0)], top=[1, 2], bottom=[0, 0])
    with pytest.raises(ValueError, match="a bottom is above its top"):
        UpperSurfaces.of([(0, 0)], top=[1], bottom=[2])


@pytest.mark.parametrize(
    ("around", "top", "is_continued"),
    [
        ([], 250, False),
        ([(4, 4)], 250, False),
        ([(4, 4), (6, 6)], 250, True),
        ([(4, 4), (6, 6)], 260, True),
        ([(4, 4), (6, 6)], 261, False),
        ([(4, 4), (7, 5)], 250, False),  # two cells away
        ([(5, 0), (4, 9)], 250, False),  # the end of a row is not beside the next one's beginning
    ],
)
def test_a_reading_continues_surfaces_of_its_height_in_two_cells_around_it(
    around, top, is_continued
):
    deck = UpperSurfaces.of(around, [250] * len(around), [240] * len(around))
    reading = UpperSurfaces.of([(5, 5)], [top], [top])
    assert deck.continued_by(reading).tolist() == [is_continued]
