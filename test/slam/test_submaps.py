# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Submaps that are joined, against one map of all that they have seen."""

import numpy as np
import pytest

from heightmap25d_ros import se3
from heightmap25d_ros.localization.landmarks import landmarks_of
from heightmap25d_ros.localization.layers import NAMES
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.own_map import landmarks_around, surroundings
from heightmap25d_ros.slam.submap_graph import SubmapGraph
from heightmap25d_ros.slam.submaps import Submap
from heightmap25d_ros.slam.trimming import needless

PARAMS = Params()


def beams_of(ends, z=0.0):
    """Beams from 1 m above a place over the origin."""
    return Beams(
        origins=np.broadcast_to([0.0, 0.0, z + 1.0], ends.shape).copy(), ends=ends,
        is_hit=np.ones(len(ends), bool), is_lone=np.zeros(len(ends), bool),
    )  # fmt: skip


def world(rng, count=4000):
    """Returns of a floor, and of a wall that stands along y."""
    floor = np.column_stack([rng.uniform(-3, 3, (count, 2)), rng.normal(0.0, 0.01, count)])
    wall = np.column_stack([
        rng.normal(2.03, 0.005, count), rng.uniform(-3, 3, count), rng.uniform(0.2, 0.8, count)
    ])  # fmt: skip
    return [floor, wall, wall]


def submap_of(parts, T_map_submap=None):
    submap = Submap(np.eye(4), PARAMS)
    for part in parts:
        submap.integrate(beams_of(part), 0.0)
    submap.finish()
    if T_map_submap is not None:
        submap.T_map_submap = T_map_submap
    return submap


def around(submaps):
    return surroundings(submaps, np.zeros(3), 4.0, PARAMS.grid.resolution)


def test_submaps_that_stay_are_one_map():
    rng = np.random.default_rng(1)
    parts = world(rng)
    whole, layers = around([submap_of(parts)])
    split, split_layers = around([submap_of(parts[:2]), submap_of(parts[2:])])
    both = whole.known & split.known
    assert both.sum() > 0.95 * whole.known.sum()
    wall = landmarks_of(whole, layers).walls
    again = landmarks_of(split, split_layers).walls
    for found in (wall, again):
        on_wall = np.abs(found[:, 0] - 2.03) < 0.1
        assert on_wall.sum() >= 40
        np.testing.assert_allclose(np.abs(found[on_wall][:, 2]), 1.0, atol=1e-3)
        np.testing.assert_allclose(found[on_wall][:, 4], 2.03, atol=0.005)


def test_one_submap_gives_back_its_layers():
    rng = np.random.default_rng(2)
    submap = submap_of(world(rng))
    _, layers = around([submap])
    cells = submap.cells()
    assert layers.ground_count.sum() == pytest.approx(cells.layers[:, 0].sum())
    assert layers.elevated_count.sum() == pytest.approx(cells.layers[:, 6].sum())
    for name in NAMES:
        assert np.isfinite(getattr(layers, name)).all()


def test_a_submap_that_was_moved_has_its_wall_where_it_was_moved_to():
    rng = np.random.default_rng(3)
    T = se3.from_xyz_rpy([0.3, -0.2, 0.5, 0.0, 0.0, np.radians(20.0)])
    height_map, layers = around([submap_of(world(rng), T)])
    walls = landmarks_of(height_map, layers).walls
    normal = T[:2, :2] @ [1.0, 0.0]
    offset = normal @ (T[:2, :2] @ [2.03, 0.0] + T[:2, 3])
    # The ends of the wall and what is above its cells' floor are judged by their own.
    on_wall = np.abs(walls[:, :2] @ normal - offset) < 0.1
    assert on_wall.sum() >= 30
    found = walls[on_wall]
    along = np.abs(found[:, 2:4] @ normal)
    assert np.nanmedian(along) > np.cos(np.radians(1.0))
    np.testing.assert_allclose(np.nanmedian(found[:, 4:6] @ normal), offset, atol=0.01)
    ground = layers.ground_height[layers.ground_count > 0]
    np.testing.assert_allclose(np.median(ground), 0.5, atol=0.01)


def test_move_to_puts_the_beginning_where_it_is_told():
    start = se3.from_xyz_rpy([4.0, 5.0, 1.0, 0.02, -0.03, 0.7])
    submap = Submap(start, PARAMS)
    pose = np.array([1.0, -2.0, 3.0, 0.5])
    submap.move_to(pose)
    np.testing.assert_allclose(submap.pose, pose, atol=1e-9)


def row(x):
    """Returns of a laser 0.4 m above the ground, in a row along y."""
    y = np.arange(-2.0, 2.0, 0.01)
    return np.column_stack([np.full(len(y), x), y, np.full(len(y), 1.0)])


def lines_near(x, sights):
    """Wall cells with a line within 0.1 m of x, of rows (distance driven, x) that were seen."""
    submap = Submap(np.eye(4), PARAMS)
    ground = np.array([[-1.0, y, 0.0] for y in np.arange(-1.0, 1.0, 0.05)])
    submap.integrate(beams_of(ground), 0.0)
    for distance, at in sights:
        submap.integrate(beams_of(row(at)), distance)
    grows = landmarks_around([submap], np.zeros(3), 4.0, PARAMS.grid.resolution).walls
    submap.finish()
    walls = landmarks_around([submap], np.zeros(3), 4.0, PARAMS.grid.resolution).walls
    np.testing.assert_array_equal(walls, grows)
    return int(np.count_nonzero((np.abs(walls[:, 0] - x) < 0.1) & ~np.isnan(walls[:, 2])))


def test_a_row_that_goes_with_the_robot_is_no_wall_to_hold_on_to():
    """As where a laser meets a slope; each place is seen for 0.1 m of the drive."""
    sights = [(1.0 + d, 2.06 + np.floor(d / 0.1 + 1e-9) * 0.125) for d in np.arange(0, 0.6, 0.05)]
    assert all(lines_near(x, sights) == 0 for x in {at for _, at in sights})


def test_what_is_seen_again_further_on_is_a_wall_and_what_a_standing_robot_sees():
    assert lines_near(2.06, [(1.0, 2.06), (1.2, 2.06), (1.4, 2.06)]) >= 30
    assert lines_near(2.06, [(1.0, 2.06), (1.2, 2.06)]) == 0
    assert lines_near(2.06, [(0.0, 2.06), (0.0, 2.06)]) >= 30


def test_level_lasers_alone_hold_on_to_what_they_have_seen_again():
    submap = Submap(np.eye(4), PARAMS)
    submap.integrate(beams_of(row(2.06)), 1.0)
    height_map, layers = around([submap])
    assert (layers.ground_count == layers.level_count).all()
    seen = landmarks_of(height_map, layers).walls
    assert np.count_nonzero(~np.isnan(seen[:, 2])) >= 30

    def walls():
        return landmarks_around([submap], np.zeros(3), 4.0, PARAMS.grid.resolution).walls

    assert np.isnan(walls()[:, 2]).all()
    submap.integrate(beams_of(row(2.06)), 1.4)
    assert np.count_nonzero(~np.isnan(walls()[:, 2])) >= 30


def test_memory_of_one_place_is_that_of_its_first_and_its_newest_submaps():
    params = with_values(PARAMS, {"slam.active_distance": 8.0, "slam.submap_length": 4.0})
    graph = SubmapGraph(params)
    graph.begin(np.eye(4), np.zeros((3, 3)))
    parts, held = world(np.random.default_rng(5)), []
    for _ in range(7):
        for part in parts:
            graph.submaps[-1].integrate(beams_of(part), 0.0)
        graph.follow(np.eye(4), np.eye(4) * 1e-4, 4.0)
        held.append(sum(len(submap.cells().places) for submap in graph.submaps[:-1]))
    assert held[2] == 3 * held[0]
    np.testing.assert_array_equal(held[3:], np.full(4, held[2]))
    counts = [len(submap.cells().places) for submap in graph.submaps]
    assert [number for number, count in enumerate(counts) if count] == [0, 5, 6]
    assert not any(len(submap.confirmed()) for submap in graph.submaps[1:5])


def test_what_only_an_old_submap_has_seen_stays():
    submap = submap_of(world(np.random.default_rng(6)))
    before, squares = submap.cells(), submap.squares()
    is_dropped = squares[:, 0] < 1  # west of x = 1 m
    submap.drop(is_dropped)
    after = submap.cells()
    is_east = before.places[:, 1] * PARAMS.grid.resolution >= 1.0 - 1e-9
    np.testing.assert_array_equal(after.places, before.places[is_east])
    np.testing.assert_array_equal(after.layers, before.layers[is_east])
    np.testing.assert_array_equal(submap.squares(), squares[~is_dropped])
    submap.drop(np.ones(len(submap.squares()), bool))
    assert len(submap.cells().places) == 0
    assert len(submap.squares()) == 0


def test_submaps_are_needless_where_they_are_now():
    square = np.array([[0, 0, 0]])
    away = se3.from_xyz_rpy([5.0, 0.0, 0.0, 0.0, 0.0, np.pi / 2])
    poses = [np.eye(4), np.eye(4), away, np.eye(4), np.eye(4)]
    dropped = needless([square] * 5, poses, newest=2)
    assert [bool(part[0]) for part in dropped] == [False, True, False, False, False]


def deck(rng, z, count=20000):
    """Returns of a level piece of ground."""
    return np.column_stack([rng.uniform(-3, 3, (count, 2)), rng.normal(z, 0.01, count)])


def seen_from(z, ends):
    """A submap of ends that were seen from 1 m above some height."""
    submap = Submap(se3.from_xyz_rpy([0.0, 0.0, z, 0.0, 0.0, 0.0]), PARAMS)
    submap.integrate(beams_of(ends, z), 0.0)
    submap.finish()
    return submap


def test_a_deck_above_does_not_make_the_ground_below_needless():
    rng = np.random.default_rng(6)
    every = [seen_from(z, deck(rng, z)) for z in (0.0, 0.0, 2.5, 2.5, 2.5, 2.5)]
    dropped = needless([one.squares() for one in every], [one.T_map_submap for one in every], 1)
    is_dropped = [bool(part.all()) for part in dropped]
    assert is_dropped == [False, False, False, True, True, False]
    for one, squares in zip(every, dropped, strict=True):
        one.drop(squares)
    assert [len(one.cells().places) > 2000 for one in every] == [not gone for gone in is_dropped]
    assert not len(every[3].confirmed())


@pytest.mark.parametrize("z", [0.0, 2.5])
def test_around_a_robot_is_the_level_that_it_is_on(z):
    rng = np.random.default_rng(7)
    both = [seen_from(0.0, deck(rng, 0.0)), seen_from(2.5, deck(rng, 2.5))]
    height_map, layers = surroundings(both, np.array([0.3, 0.1, z]), 2.0, PARAMS.grid.resolution)
    assert height_map.known.mean() > 0.95
    assert np.abs(height_map.metres[height_map.known] - z).max() < 0.05
    assert not layers.elevated_count.any()
