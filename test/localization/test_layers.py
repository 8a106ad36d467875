# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Means of returns by cell against numpy's, and the file that they are kept in."""

from __future__ import annotations

import numpy as np
import pytest
from landmark_worlds import CORRIDOR, beams_to, ground_returns, mapped, wall_returns

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.io import layers_file, map_directory
from heightmap25d_ros.localization.landmarks import landmarks_of
from heightmap25d_ros.localization.layers import LocalizationLayers
from heightmap25d_ros.params.sections import GridParams, TraversabilityParams
from heightmap25d_ros.terrain.traversability import to_obstacle_map


def layers_of(*returns):
    grid = HeightGrid(GridParams(extent=32.0))
    layers = LocalizationLayers(grid)
    for ends in returns:
        layers.integrate(beams_to(np.atleast_2d(ends)))
    return layers.read(grid.area)


def cell_of(layers, point):
    return tuple(layers.geometry.cell_at(point))


def test_each_cell_has_mean_and_scatter_of_its_lowest_returns():
    rng = np.random.default_rng(1)
    ends = ground_returns(rng, 20000, half=(2.0, 2.0), slope=(0.1, -0.05), noise=0.01)
    layers = layers_of(ends[:9000], ends[9000:])
    cells = layers.geometry.cell_at(ends[:, :2])
    for cell in ((128, 128), (120, 133), (140, 119)):
        heights = ends[(cells == cell).all(axis=1), 2]
        assert layers.ground_count[cell] == len(heights) > 10
        assert layers.ground_height[cell] == pytest.approx(heights.mean(), abs=1e-5)
        assert layers.ground_scatter[cell] == pytest.approx(
            len(heights) * heights.var(), rel=1e-3, abs=1e-6
        )
    assert layers.elevated_count.sum() == 0


def test_what_stands_has_the_mean_place_and_spread_of_its_returns_whatever_comes_first():
    rng = np.random.default_rng(2)
    low = np.array([[0.02, 0.03, 0.0], [0.09, 0.11, 0.01]])
    high = np.column_stack([rng.uniform(0.0, 0.125, (50, 2)), rng.uniform(0.3, 0.34, 50)])
    for order in ((low, high), (high, low)):
        layers = layers_of(*order)
        cell = cell_of(layers, (0.06, 0.06))
        places = high[:, :2] - 0.0625
        assert layers.ground_count[cell] == 2
        assert layers.ground_height[cell] == pytest.approx(0.005, abs=1e-6)
        assert layers.elevated_count[cell] == 50
        at = layers.elevated_x[cell], layers.elevated_y[cell]
        np.testing.assert_allclose(at, places.mean(axis=0), atol=1e-6)
        spread = [layers.spread_xx[cell], layers.spread_xy[cell], layers.spread_yy[cell]]
        expected = 50 * np.cov(places.T, bias=True)
        np.testing.assert_allclose(spread, expected[[0, 0, 1], [0, 1, 1]], rtol=1e-3, atol=1e-6)


def test_faces_of_walls_are_lines_and_tops_of_boxes_are_not():
    rng = np.random.default_rng(3)
    top = np.column_stack([rng.uniform((2.0, -0.4), (2.5, 0.4), (4000, 2)), np.full(4000, 0.3)])
    seen = mapped(ground_returns(rng, 60000), wall_returns(rng, 20000, noise=0.01), top)
    landmarks = landmarks_of(*seen)
    is_line = ~np.isnan(landmarks.walls[:, 2])
    on_wall = np.abs(landmarks.walls[:, 1] - 0.05) > 1.1
    assert is_line[on_wall].mean() > 0.95
    on_top = np.abs(landmarks.walls[:, 0] - 2.25) < 0.15
    on_top &= np.abs(landmarks.walls[:, 1]) < 0.3
    assert on_top.sum() > 5
    assert not is_line[on_top].any()
    normals = landmarks.walls[is_line & on_wall]
    distance = np.minimum(*(np.abs(normals[:, 5] - wall[0][1]) for wall in CORRIDOR))
    assert np.percentile(distance, 95) < 0.004


def test_what_only_level_lasers_see_stands():
    rng = np.random.default_rng(4)
    ends = wall_returns(rng, 20000, noise=0.01)
    ends[:, 2] = 0.4
    grid = HeightGrid(GridParams(extent=32.0))
    layers = LocalizationLayers(grid)
    layers.integrate(beams_to(ends, above=0.0))
    height_map, _ = mapped(ends)
    landmarks = landmarks_of(height_map, layers.read(grid.area_of(height_map.geometry)))
    assert (~np.isnan(landmarks.walls[:, 2])).mean() > 0.95
    assert len(landmarks.planes) == 0


@pytest.fixture
def saved(tmp_path):
    rng = np.random.default_rng(5)
    height_map, layers = mapped(ground_returns(rng, 5000), wall_returns(rng, 5000))
    obstacles = to_obstacle_map(height_map, TraversabilityParams())
    map_directory.save(tmp_path / "map", height_map, obstacles, "map", layers=layers)
    map_directory.save(tmp_path / "plain", height_map, obstacles, "map")
    return tmp_path, height_map, layers


def test_layers_come_back_from_their_file_and_the_height_grid_is_the_same_to_the_byte(saved):
    path, height_map, layers = saved
    loaded = layers_file.load(path / "map", height_map)
    assert loaded is not None
    for name in ("ground_height", "elevated_x", "spread_xy", "level_count"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(layers, name))
    assert map_directory.digest(path / "map") == map_directory.digest(path / "plain")
    assert layers_file.load(path / "plain", height_map) is None


def test_layers_of_another_height_grid_are_not_used(saved):
    path, *_ = saved
    other = mapped(ground_returns(np.random.default_rng(6), 5000))[0]
    obstacles = to_obstacle_map(other, TraversabilityParams())
    map_directory.save(path / "map", other, obstacles, "map")
    assert (path / "map" / layers_file.LAYERS).exists()
    assert layers_file.load(path / "map", other) is None


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("format_version", np.int64(3)),
        ("ground_height", np.zeros((3, 3), np.float32)),
        ("elevated_x", "wide"),
        ("ground_count", None),
        ("ground_count_1", np.zeros((3, 3), np.float32)),
        ("spread_xy", 3e38),
        ("spread_xx", 0.1),
        ("ground_scatter", 1e30),
        ("ground_height", -1e20),
        ("elevated_count", 1e30),
    ],
)
def test_a_damaged_file_is_refused(saved, name, value):
    path, height_map, _ = saved
    file = path / "map" / layers_file.LAYERS
    with np.load(file) as archive:
        fields = dict(archive)
    if value is None:
        del fields[name]
    elif isinstance(value, float):
        fields[name][0, 0] = value
    else:
        fields[name] = fields[name] + np.float32(0.2) if isinstance(value, str) else value
    np.savez_compressed(file, **fields)
    with pytest.raises(InputError, match=name):
        layers_file.load(path / "map", height_map)


def test_layers_go_on_where_they_were_loaded():
    rng = np.random.default_rng(7)
    _, before = mapped(ground_returns(rng, 5000))
    grid = HeightGrid(GridParams(extent=32.0))
    layers = LocalizationLayers(grid)
    layers.write(before)
    np.testing.assert_array_equal(
        layers.read(grid.area_of(before.geometry)).ground_height, before.ground_height
    )
    layers.integrate(beams_to(np.array([[0.01, 0.01, 0.0]])))
    cell = tuple(before.geometry.cell_at((0.01, 0.01)))
    after = layers.read(grid.area_of(before.geometry))
    assert after.ground_count[cell] == before.ground_count[cell] + 1
