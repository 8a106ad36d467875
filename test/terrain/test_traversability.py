# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from literal_traversability import LiteralTerrain
from properties import draws
from scipy import ndimage

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_grid import TILE, HeightGrid
from heightmap25d_ros.grid.height_map import HEIGHT_LIMIT, Area, Geometry, HeightMap
from heightmap25d_ros.params.sections import GridParams, TraversabilityParams
from heightmap25d_ros.terrain.obstacle_grid import ObstacleGrid
from heightmap25d_ros.terrain.steps import step_obstacles
from heightmap25d_ros.terrain.traversability import to_obstacle_map

PARAMS = TraversabilityParams()
CELL = 0.125
STEEPEST = math.tan(PARAMS.max_slope)


def height_map(height, known=None):
    """A dense map of heights in centimetres, on the default cells."""
    height = np.asarray(height).astype(np.int16)
    probability = np.full(height.shape, 60000) if known is None else np.where(known, 60000, 600)
    return HeightMap(
        geometry=Geometry(resolution=CELL, origin=(0.0, 0.0), shape=height.shape),
        height=height,
        probability=probability.astype(np.uint16),
        probability_threshold=0.5,
    )


def measured(z, noise=0.0):
    """Cells of a surface z [m] with noise of that sigma [m], rounded as they are stored."""
    return height_map(np.rint(100 * (z + np.random.default_rng(7).normal(0, noise, z.shape))))


def positions(side):
    """X and y [m] of the centres of the cells of a square."""
    y, x = (np.indices((round(side / CELL),) * 2) + 0.5) * CELL
    return x, y


def near(mask):
    """Cells within the robot's radius of those of a mask, by a distance transform."""
    return ndimage.distance_transform_edt(~mask) * CELL <= PARAMS.robot_radius


@given(
    seed=st.integers(0, 2**32 - 1),
    radius=st.sampled_from([0.0, 0.1, 0.125, 0.3, 0.5]),
    max_step=st.sampled_from([0.05, 0.1, 0.29]),
    max_slope=st.sampled_from([0.2, 0.44, 1.0]),
)
def test_everything_by_the_definition(seed, radius, max_step, max_slope):
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, 13, 2))
    y, x = np.indices(shape)
    height = rng.uniform(-8, 8) * x + rng.integers(-3, 4, shape) - 100 * (y > rng.integers(20))
    known = rng.random(shape) < rng.choice([0.5, 0.9, 1.0])
    params = TraversabilityParams(max_step=max_step, max_slope=max_slope, robot_radius=radius)
    source = height_map(height, known)
    converted = to_obstacle_map(source, params)

    literal = LiteralTerrain.of(
        source.height, known, round(100 * max_step), (radius / CELL) ** 2 + 1e-9
    )
    shares, free_cells = {}, set()
    for cell in map(tuple, np.argwhere(known)):
        assert converted.blocked[cell] == literal.blocked(cell)
        gradient, roughness, is_undecided = literal.plane(cell)
        slope = gradient / (100 * CELL) / math.tan(max_slope)
        if is_undecided or abs(slope - 1) < 1e-6:
            continue
        is_occupied = literal.is_upper_end(cell) or slope > 1
        assert converted.occupancy[cell] == (100 if is_occupied else 0)
        step = literal.largest_step(cell) / round(100 * max_step)
        shares[cell] = max(step, slope, roughness / 100 / params.max_roughness)
        free_cells |= set() if is_occupied else {cell}
    occupied = np.argwhere(converted.occupancy == 100)
    for cell, share in shares.items():
        if cell not in free_cells:
            assert converted.cost[cell] == 100
        elif (((occupied - cell) ** 2).sum(axis=1) <= (radius / CELL) ** 2 + 1e-9).any():
            assert converted.cost[cell] == 99
        else:
            assert converted.cost[cell] == pytest.approx(98 * min(share, 1) - 0.5, abs=0.501)
    assert (converted.occupancy[~known] == -1).all()
    assert (converted.cost[~known] == -1).all()
    assert (converted.blocked[~known] == 0).all()


# What is occupied in exact worlds, and above all what is not.


@pytest.mark.parametrize("height", [0.11, 0.15, 0.3, 2.0])
@pytest.mark.parametrize("angle", [0.0, 0.4, math.pi / 4, 1.3])
def test_an_edge_takes_only_the_upper_cells_along_it(height, angle):
    x, y = positions(8.0)
    is_upper = (x - 4) * math.cos(angle) + (y - 4) * math.sin(angle) > 0.01
    converted = to_obstacle_map(measured(height * is_upper), PARAMS)
    rim = is_upper & ndimage.binary_dilation(~is_upper, np.ones((3, 3)))
    assert ((converted.occupancy == 100) == rim).all()
    # Nothing else costs anything: the ground on both sides is level.
    expected = np.where(rim, 100, np.where(near(rim), 99, 0))
    assert (converted.cost == expected).all()


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("height", [0.15, 0.3, 2.0])
def test_a_box_takes_no_ground(noise, height):
    x, y = positions(6.0)
    is_box = (abs(x - 3) < 0.5) & (abs(y - 3) < 0.25)
    occupancy = to_obstacle_map(measured(height * is_box, noise), PARAMS).occupancy
    assert (occupancy[~is_box] == 0).all()
    rim = is_box & ndimage.binary_dilation(~is_box, np.ones((3, 3)))
    assert (occupancy[rim] == 100).mean() > (0.9 if noise else 0.999)


@pytest.mark.parametrize("gap", [0.625, 1.0])
def test_a_gap_between_walls_stays_free(gap):
    x, y = positions(8.0)
    is_wall = (abs(x - 4) < 0.15) & (abs(y - 4) > gap / 2)
    occupancy = to_obstacle_map(measured(2.0 * is_wall), PARAMS).occupancy
    assert ((occupancy == 100) == is_wall).all()


def test_a_cliff_takes_its_rim():
    x, _ = positions(6.0)
    occupancy = to_obstacle_map(measured(np.where(x < 3, 0.0, -1.0)), PARAMS).occupancy
    assert ((occupancy == 100) == ((x > 3 - CELL) & (x < 3))).all()


@pytest.mark.parametrize("heading", [0.0, 0.5, math.pi / 4])
def test_a_slope_of_38_degrees_is_an_obstacle_though_no_step_is(heading):
    x, y = positions(10.0)
    along = (x - 5) * math.cos(heading) + (y - 5) * math.sin(heading)
    source = measured(np.maximum(math.tan(math.radians(38)) * along, 0))
    occupancy = to_obstacle_map(source, PARAMS).occupancy
    if heading == 0.0:
        assert not (step_obstacles(source.height, source.known, 10) == 100).any()
    inside = near(abs(x - 5) > 4.4) | near(abs(y - 5) > 4.4)
    assert (occupancy[(along > PARAMS.robot_radius) & ~inside] == 100).all()
    assert (occupancy[along < 0] == 0).all()


@pytest.mark.parametrize("heading", [0.0, 0.5, math.pi / 4])
@pytest.mark.parametrize("noise", [0.0, 0.005, 0.01])
def test_a_ramp_of_20_degrees_is_free(heading, noise):
    x, y = positions(10.0)
    slope = math.tan(math.radians(20))
    source = measured(slope * (x * math.cos(heading) + y * math.sin(heading)), noise)
    converted = to_obstacle_map(source, PARAMS)
    by_step = step_obstacles(source.height, source.known, 10)
    # Not one cell is too steep. Noise of 1 cm on the 6.4 cm of a diagonal step is over the
    # limit once in a thousand times.
    assert (converted.occupancy == by_step).all()
    assert (by_step == 100).mean() <= (0.004 if noise == 0.01 else 0.0)
    free = converted.cost[converted.cost < 99]
    assert np.median(free) == pytest.approx(98 * slope / STEEPEST, abs=3)


@pytest.mark.parametrize("noise", [0.01, 0.02])
def test_noise_on_level_ground_makes_no_slope(noise):
    source = measured(np.zeros((400, 400)), noise)
    known = np.random.default_rng(1).random((400, 400)) < np.linspace(0, 1, 400)
    source = height_map(source.height, known)
    by_step = step_obstacles(source.height, known, 10)
    assert (to_obstacle_map(source, PARAMS).occupancy == by_step).all()
    assert (by_step == 100).mean() <= {0.01: 0.0, 0.02: 0.001}[noise]


def test_cost_of_a_step_of_half_the_limit():
    x, _ = positions(4.0)
    cost = to_obstacle_map(measured(0.05 * (x > 2)), PARAMS).cost
    assert (cost[abs(x - 2) < CELL] == 49).all()
    assert (cost[abs(x - 2) > CELL + PARAMS.robot_radius] == 0).all()


def test_cost_of_roughness():
    board = 0.04 * (np.indices((30, 30)).sum(axis=0) % 2)  # 2 cm about its mean
    cost = to_obstacle_map(measured(board), TraversabilityParams(max_roughness=0.025)).cost
    assert np.abs(cost[5:-5, 5:-5] - 98 * 0.8).max() < 2
    rougher = to_obstacle_map(measured(board), TraversabilityParams(max_roughness=0.01))
    assert (rougher.cost[5:-5, 5:-5] == 98).all()
    assert (rougher.occupancy == 0).all()


def test_inflation_reaches_as_far_as_the_robot_and_not_into_the_unknown():
    height, known = np.zeros((15, 15)), np.ones((15, 15), bool)
    height[7, 7], known[7, 5] = 50, False
    cost = to_obstacle_map(height_map(height, known), PARAMS).cost
    assert cost[7, 3:12].tolist() == [99, 99, -1, 99, 100, 99, 99, 99, 99]
    assert cost[7, [2, 12]].tolist() == [0, 0]
    assert cost[7 + 3, [7 - 2, 7 - 3]].tolist() == [99, 0]  # 3.6 and 4.2 cells


def test_mirrored_and_turned_maps():
    rng = np.random.default_rng(11)
    x, y = positions(6.0)
    z = 0.3 * np.sin(2 * x) * np.cos(y) + 0.5 * (x + 2 * y > 12) + rng.normal(0, 0.01, x.shape)
    known = rng.random(x.shape) < 0.95
    whole = to_obstacle_map(height_map(np.rint(100 * z), known), PARAMS)
    for turn in (np.rot90, np.fliplr, np.transpose):
        turned = to_obstacle_map(height_map(np.rint(100 * turn(z)), turn(known)), PARAMS)
        assert (turned.occupancy == turn(whole.occupancy)).all()
        assert np.abs(turned.cost - turn(whole.cost)).max() <= 1  # the last bit of a share


def test_a_robot_of_too_many_cells_is_refused():
    params = TraversabilityParams(robot_radius=5.0)
    with pytest.raises(InputError, match=r"robot_radius: 5 m is more than 100 cells of 0\.04 m"):
        ObstacleGrid(Geometry(resolution=0.04, origin=(0.0, 0.0), shape=(160, 160)), params)


# Only what changed is converted again.

EXTENT = GridParams(resolution=CELL, extent=44.0)


def written(grid, area, height, probability):
    """Put cells into a grid, the parts of the area outside of it left out."""
    inside = area.within(grid.area)
    part = inside.slices(area)
    grid.write(
        HeightMap(
            geometry=grid.geometry.part(inside),
            height=height[part],
            probability=probability[part],
            probability_threshold=0.5,
        )
    )


def edit(grid, rng):
    """Change some cells: hills and steps, the limits, into the unknown and back."""
    side = int(rng.choice([1, 3, 20, 60]))
    iy, ix = rng.integers(-side, grid.area.rows, 2)
    y, x = np.indices((side, side))
    height = rng.uniform(-9, 9) * x + rng.integers(-200, 200) + rng.integers(-2, 3, (side, side))
    if rng.random() < 0.2:
        height = rng.choice([-HEIGHT_LIMIT, HEIGHT_LIMIT, 0], (side, side))
    height += 30 * (y > rng.integers(40))
    known = rng.random((side, side)) < rng.choice([0.0, 0.8, 1.0])
    area = Area(int(iy), int(ix), side, side)
    if area.within(grid.area).rows and area.within(grid.area).columns:
        limits = (-HEIGHT_LIMIT, HEIGHT_LIMIT)
        height = np.clip(height, *limits).astype(np.int16)
        written(grid, area, height, np.where(known, 40000, 2000).astype(np.uint16))


@given(
    seed=st.integers(0, 2**32 - 1),
    radius=st.sampled_from([0.0, 0.5, 2.2]),
    counts=st.lists(st.integers(0, 4), min_size=1, max_size=5),
)
@draws(40)
def test_what_is_converted_again_equals_the_whole(seed, radius, counts):
    rng = np.random.default_rng(seed)
    params = TraversabilityParams(robot_radius=radius)
    grid = HeightGrid(EXTENT)
    obstacles = ObstacleGrid(grid.geometry, params)
    for count in counts:
        for _ in range(count):
            edit(grid, rng)
        obstacles.update(grid, 0.5)
        assert_as_the_whole(obstacles, grid, params)


def assert_as_the_whole(obstacles, grid, params):
    expected, found = to_obstacle_map(grid.read(0.5), params), obstacles.read(grid.observed_area())
    assert found.geometry == expected.geometry
    assert (found.occupancy == expected.occupancy).all()
    assert (found.cost == expected.cost).all()
    assert (found.blocked == expected.blocked).all()


@pytest.mark.parametrize(("radius", "limit"), [(0.0, 0.44), (0.5, 0.34), (1.1, 0.19), (2.2, 0.44)])
def test_posts_and_pits_in_every_place_of_a_tile(radius, limit):
    # Between waves that are in places too steep: every cell of a footprint counts.
    params = TraversabilityParams(robot_radius=radius, max_slope=limit)
    grid = HeightGrid(EXTENT)
    y, x = np.indices((160, 160))
    waves = np.rint(18 * np.sin(0.31 * x) * np.cos(0.23 * y)).astype(np.int16)
    written(grid, Area(32, 32, 160, 160), waves, np.full((160, 160), 60000, np.uint16))
    obstacles = ObstacleGrid(grid.geometry, params)
    obstacles.update(grid, 0.5)
    for y, x in [(0, 0), (0, 15), (15, 0), (15, 15), (6, 9)]:
        for height in (200, 0, -200):
            grid.height.cells[7, 6, y, x] = height
            grid.mark_changed(np.s_[7:8, 6:7])
            obstacles.update(grid, 0.5)
            assert_as_the_whole(obstacles, grid, params)


def test_a_tile_that_is_no_longer_observed_is_unknown():
    grid = HeightGrid(EXTENT)
    whole_tile = np.full((TILE, TILE), 500, np.int16), np.full((TILE, TILE), 60000, np.uint16)
    alone = Area(128, 128, TILE, TILE)
    for area in (Area(32, 32, TILE, TILE), alone, Area(256, 256, TILE, TILE)):
        written(grid, area, *whole_tile)
    obstacles = ObstacleGrid(grid.geometry, PARAMS)
    obstacles.update(grid, 0.5)
    assert (obstacles.read(alone).occupancy == 0).all()
    written(grid, alone, *(np.zeros_like(values) for values in whole_tile))
    obstacles.update(grid, 0.5)
    assert (obstacles.read(alone).occupancy == -1).all()


def test_what_was_never_seen_is_unknown():
    grid = HeightGrid(EXTENT)
    obstacles = ObstacleGrid(grid.geometry, PARAMS)
    assert len(obstacles.update(grid, 0.5)) == 0
    found = obstacles.read(Area(-8, 3, 40, 20))
    assert (found.occupancy == -1).all()
    assert (found.cost == -1).all()
    assert (found.blocked == 0).all()


def test_a_change_far_away_touches_only_what_is_near():
    grid = HeightGrid(EXTENT)
    level = np.zeros((160, 160), np.int16), np.full((160, 160), 60000, np.uint16)
    written(grid, Area(32, 32, 160, 160), *level)
    obstacles = ObstacleGrid(grid.geometry, PARAMS)
    assert len(obstacles.update(grid, 0.5)) == 10 * 10
    assert len(obstacles.update(grid, 0.5)) == 0
    # A wall in one tile: that tile and its eight neighbours.
    grid.height.cells[7, 5, 8, 8] = 200
    grid.mark_changed(np.s_[7:8, 5:6])
    tiles = obstacles.update(grid, 0.5).tolist()
    assert tiles == [[ty, tx] for ty in (6, 7, 8) for tx in (4, 5, 6)]
    found = obstacles.read(Area(7 * TILE, 5 * TILE, TILE, TILE))
    assert np.argwhere(found.occupancy == 100).tolist() == [[8, 8]]
    # One at the edge of what was seen: nothing is written outside of it.
    grid.mark_changed(np.s_[2:3, 2:3])
    tiles = obstacles.update(grid, 0.5).tolist()
    assert tiles == [[2, 2], [2, 3], [3, 2], [3, 3]]
