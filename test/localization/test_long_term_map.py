# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A deck over a road, each with walls of its own: the pose tells which of them count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from landmark_worlds import beams_to, ground_returns, wall_returns

from heightmap25d_ros import se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.io import layers_file, map_directory
from heightmap25d_ros.localization import level_search
from heightmap25d_ros.localization.global_search import Candidate, SearchResult
from heightmap25d_ros.localization.hypotheses import Hypotheses
from heightmap25d_ros.localization.layers import NAMES, LayerMap, LocalizationLayers
from heightmap25d_ros.localization.long_term_map import LongTermMap
from heightmap25d_ros.localization.odometry_errors import unknown_errors
from heightmap25d_ros.localization.registration import Reason, rejected
from heightmap25d_ros.localization.scan_filter import ScanFilter
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.params.sections import GridParams, Params
from heightmap25d_ros.terrain.traversability import to_obstacle_map

PARAMS = Params()
DECK = 2.2  # [m]
BELOW, ABOVE = (((-4.0, -2.5), (4.0, -2.5)),), (((-4.0, 1.6), (4.0, 1.6)),)
"""The wall beside the road, and the parapet on the deck."""


def road(rng, count):
    return np.concatenate([
        ground_returns(rng, count, half=(4.0, 3.0), noise=0.005),
        wall_returns(rng, count, BELOW, noise=0.005),
    ])  # fmt: skip


def deck(rng, count):
    seen = np.concatenate([
        ground_returns(rng, count, half=(4.0, 2.0), noise=0.005),
        wall_returns(rng, count, ABOVE, noise=0.005),
    ])  # fmt: skip
    return seen + (0.0, 0.0, DECK)


def slanting(ends):
    """Beams to returns, from 2 m beside them: they pass under the deck, or over it."""
    straight = beams_to(ends)
    return replace(straight, origins=straight.origins + (2.0, 0.0, 0.0))


def mapped(*drives):
    grid = HeightGrid(GridParams(extent=32.0))
    mapper, layers = Mapper(grid), LocalizationLayers(grid, grid.upper.count)
    for ends in drives:
        for part in np.array_split(ends, 20):
            mapper.integrate(slanting(part))
            layers.integrate(slanting(part))
    height_map = grid.read()
    return height_map, layers.read(grid.area_of(height_map.geometry))


@pytest.fixture(scope="module", params=["road first", "deck first"])
def seen(request):
    rng = np.random.default_rng(1)
    drives = [road(rng, 40000), deck(rng, 40000)]
    if request.param == "deck first":  # and some of it again
        drives = [drives[1], drives[0], road(rng, 40000), deck(rng, 20000)]
    return mapped(*drives)


@pytest.fixture(scope="module")
def long_term(seen):
    return LongTermMap.of(*seen, PARAMS)


def at(x, y, z):
    return se3.from_xyz_rpy([x, y, z, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(("z", "wall_y"), [(0.0, -2.5), (DECK, 1.6)])
def test_the_pose_tells_which_ground_and_which_walls_count(long_term, z, wall_y):
    landmarks = long_term.at(at(0.5, 0.3, z + 0.2)).landmarks
    iy, ix = (int(n) for n in np.floor((np.array([0.3, 0.5]) - landmarks.origin[::-1]) / 0.125))
    plane = landmarks.planes[landmarks.plane_of[iy, ix]]
    assert plane[0] == pytest.approx(z, abs=0.01)
    lines = landmarks.walls[~np.isnan(landmarks.walls[:, 2])]
    near = lines[np.abs(lines[:, 0]) < 3.0]
    is_wall = np.abs(near[:, 1] - wall_y) < 0.1
    assert is_wall.sum() > 30
    assert (np.abs(near[is_wall, 1] - wall_y) < 0.01).mean() > 0.8


def test_scans_correct_a_pose_on_the_deck_by_its_parapet(long_term):
    rng = np.random.default_rng(5)
    wrong = at(0.0, 0.08, DECK - 0.1)
    estimate = ScanFilter(
        PARAMS, wrong, np.diag(np.square([0.1, 0.1, 0.02])), unknown_errors(PARAMS)
    )
    returns = deck(rng, 400) - (0.0, 0.0, DECK)  # as seen from the robot, at the true pose
    landmarks = long_term.at(wrong).landmarks
    for _ in range(3):
        estimate.update(returns, np.eye(4), landmarks)
    assert estimate.T_map_odom[1, 3] == pytest.approx(0.0, abs=0.02)
    assert estimate.T_map_odom[2, 3] == pytest.approx(DECK, abs=0.02)


def test_hypotheses_on_two_levels_are_each_held_to_their_own():
    rng = np.random.default_rng(6)
    long_term = LongTermMap.of(*mapped(road(rng, 40000), deck(rng, 40000)), PARAMS)
    spread = np.diag(np.square([0.1, 0.1, 0.03]))
    hypotheses = Hypotheses(
        ScanFilter(PARAMS, at(0.0, 0.0, z), spread, unknown_errors(PARAMS)) for z in (0.0, DECK)
    )
    for _ in range(8):
        hypotheses.update(deck(rng, 400) - (0.0, 0.0, DECK), np.eye(4), long_term)
    assert len(hypotheses) == 1
    assert hypotheses.best.estimate.T_map_odom[2, 3] == pytest.approx(DECK, abs=0.05)


@pytest.mark.parametrize("count", [100, 0])
def test_a_parapet_whose_deck_was_not_seen_before_is_where_its_returns_are(count):
    """Its returns are among those of the wall below; without any it is somewhere in its cells."""
    shape = 16, 24
    is_wall = np.zeros(shape, bool)
    is_wall[:, 5] = True
    cells = np.argwhere(np.ones(shape, bool))
    top = np.where(is_wall, 280, 220)[tuple(cells.T)]
    geometry = Geometry(resolution=0.125, origin=(0.0, 0.0), shape=shape)
    height_map = replace(
        HeightMap.from_metres(np.where(is_wall, 0.6, 0.0)),
        geometry=geometry, upper=UpperSurfaces.of(cells, top, top),
    )  # fmt: skip
    arrays = dict.fromkeys(NAMES, np.zeros(shape, np.float32))
    arrays["ground_count"] = np.full(shape, 9, np.float32)
    arrays["elevated_count"] = np.where(is_wall, count, 0).astype(np.float32)
    arrays["elevated_x"] = np.where(is_wall & (count > 0), 0.03, 0.0).astype(np.float32)
    arrays["spread_yy"] = (arrays["elevated_count"] * 0.125**2 / 12).astype(np.float32)
    long_term = LongTermMap.of(height_map, LayerMap(geometry=geometry, **arrays), PARAMS)
    walls = long_term.at(at(2.0, 1.0, 2.2)).landmarks.walls
    assert len(walls) == 16
    if count:
        np.testing.assert_allclose(walls[:, 0], 5.5 * 0.125 + 0.03, atol=1e-6)
        np.testing.assert_allclose(np.abs(walls[:, 2]), 1.0, atol=1e-6)
    else:
        assert np.isnan(walls[:, 2]).all()


def test_a_goal_pose_without_z_is_on_the_lowest_ground(long_term):
    assert long_term.ground_z(0.5, 0.3, 0.0) == pytest.approx(0.0, abs=0.05)
    assert long_term.ground_z(0.5, 0.3, 2.0) == pytest.approx(DECK, abs=0.05)
    assert long_term.ground_z(90.0, 90.0, 7.0) == 7.0


def test_layers_of_levels_come_back_from_their_file(seen, tmp_path):
    height_map, layers = seen
    assert len(layers.above) == 1
    obstacles = to_obstacle_map(height_map, PARAMS.traversability)
    map_directory.save(tmp_path / "map", height_map, obstacles, "map", layers=layers)
    again = layers_file.load(tmp_path / "map", height_map)
    np.testing.assert_array_equal(again.above[0].ground_height, layers.above[0].ground_height)
    np.testing.assert_array_equal(again.elevated_x, layers.elevated_x)
    file = tmp_path / "map" / layers_file.LAYERS
    with np.load(file) as archive:
        fields = dict(archive)
    np.savez_compressed(file, **{**fields, "above": np.int64(99)})
    with pytest.raises(InputError, match="above"):
        layers_file.load(tmp_path / "map", height_map)


def test_a_map_of_one_level_is_held_to_as_it_is():
    height_map = HeightMap.from_metres(np.zeros((16, 16)))
    long_term = LongTermMap.of(height_map, None, PARAMS)
    assert len(long_term.levels) == 1
    assert not long_term.has_landmarks


# The search of all levels


def found(*candidates, reason=Reason.ACCEPTED):
    values = {name: getattr(rejected(reason, 100), name) for name in (
        "reason", "offset", "z", "information", "known", "overlap", "residual", "ratio", "points",
    )}  # fmt: skip
    return SearchResult(**values, candidates=candidates, is_complete=True, nodes=5)


def candidate(x, z, score):
    return Candidate(np.array([x, 0.0, 0.0]), z, score, 1.0)


def test_a_place_that_two_slices_hold_counts_once():
    one = found(candidate(1.0, 0.0, 0.02))
    joined = level_search.joined([one, found(candidate(1.05, 0.02, 0.021))], PARAMS.registration)
    assert joined.reason is Reason.ACCEPTED
    assert len(joined.candidates) == 1
    assert joined.nodes == 10


def test_the_same_place_on_another_level_is_another_one():
    results = [found(candidate(1.0, 0.0, 0.021)), found(candidate(1.0, DECK, 0.02))]
    joined = level_search.joined(results, PARAMS.registration)
    assert joined.reason is Reason.AMBIGUOUS
    assert [c.z for c in joined.candidates] == [DECK, 0.0]


def test_a_level_that_fits_worse_is_no_candidate():
    results = [found(candidate(1.0, 0.0, 0.02)), found(candidate(1.0, DECK, 0.09))]
    joined = level_search.joined(results, PARAMS.registration)
    assert joined.reason is Reason.ACCEPTED
    assert [c.z for c in joined.candidates] == [0.0]


def test_a_level_that_was_not_searched_to_the_end_leaves_the_pose_unknown():
    cut_off = replace(found(reason=Reason.UNFINISHED), is_complete=False)
    joined = level_search.joined([found(candidate(1.0, 0.0, 0.02)), cut_off], PARAMS.registration)
    assert joined.reason is Reason.UNFINISHED
    assert not joined.candidates
