# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Suspected drop-offs: profiles along x, seen by a laser that is pitched down and drives ahead."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_msgs.msg import HeightGrid as HeightGridMessage
from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.height_map import SUSPECTED, Area, HeightMap
from heightmap25d_ros.io import decode, encode, map_directory
from heightmap25d_ros.mapping.drop_offs import DropOffs
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.mapping.sensor_model import Beams, beams, voids
from heightmap25d_ros.params.sections import MapperParams, PlannerParams, TraversabilityParams
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.planning.planner import Planner
from heightmap25d_ros.terrain.explanation import Rule, explain
from heightmap25d_ros.terrain.obstacle_grid import ObstacleGrid
from heightmap25d_ros.terrain.traversability import INFLATED, OCCUPIED, to_obstacle_map

MOUNT = se3.from_xyz_rpy([0.28, 0.0, 0.6, 0.0, np.radians(28.0), 0.0])
ANGLES = np.linspace(-0.6, 0.6, 121)
RIM = 3.0
STEP = 0.05  # [m] between scans

PROFILES = {
    "bottomless": ((-5.0, 0.0), (RIM, 0.0)),
    "cliff": ((-5.0, 0.0), (RIM, 0.0), (RIM, -2.0), (20.0, -2.0)),
    "ditch": ((-5.0, 0.0), (RIM, 0.0), (RIM, -0.6), (20.0, -0.6)),
    "stairs": ((-5, 0), (RIM, 0), (RIM, -0.3), (3.3, -0.3), (3.3, -0.6), (3.6, -0.6), (3.6, -0.9),
               (20, -0.9)),
    "steep": ((-5.0, 0.0), (RIM, 0.0), (4.0, -1.0), (20.0, -1.0)),
    "ramp": ((-5.0, 0.0), (RIM, 0.0), (13.0, -3.5), (20.0, -3.5)),
    "level": ((-5.0, 0.0), (20.0, 0.0)),
    "box": ((-5.0, 0.0), (RIM, 0.0), (RIM, 0.3), (3.4, 0.3), (3.4, 0.0), (20.0, 0.0)),
    "rise": ((-5.0, 0.0), (RIM, 0.0), (9.0, 2.0), (20.0, 2.0)),
}  # fmt: skip


def ranges(origin, directions, profile):
    """(N,) to a surface that is the same for all y, by its segments in the plane of x and z."""
    found = np.full(len(directions), np.inf)
    for (x0, z0), (x1, z1) in pairwise(profile):
        along, up = x1 - x0, z1 - z0
        determinant = directions[:, 0] * up - directions[:, 2] * along
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = ((x0 - origin[0]) * up - (z0 - origin[2]) * along) / determinant
            share = (
                (x0 - origin[0]) * directions[:, 2] - (z0 - origin[2]) * directions[:, 0]
            ) / determinant
        is_met = (reach > 1e-9) & (share >= 0.0) & (share <= 1.0)
        found = np.where(is_met, np.minimum(found, reach), found)
    return found


def driven(profile, until, mode="must", noise=0.0, pitch=0.0):
    """The grid of a drive along x; the pose is told without the pitch [rad]."""
    params, rng = TraversabilityParams(drop_offs=mode), np.random.default_rng(4)
    grid = HeightGrid()
    mapper, drop_offs = Mapper(grid), DropOffs(grid, params, 0.5)
    fan = np.stack([np.cos(ANGLES), np.sin(ANGLES), np.zeros(len(ANGLES))], axis=1)
    for x in np.arange(-1.0, until, STEP):
        T = se3.from_xyz_rpy([x, 0.0, 0.0, 0.0, 0.0, 0.0])
        turned = T @ se3.from_xyz_rpy([0.0, 0.0, 0.0, 0.0, pitch, 0.0]) @ MOUNT
        seen = ranges(turned[:3, 3], fan @ turned[:3, :3].T, profile)
        seen += rng.normal(0.0, noise, len(seen))
        scan = Scan(
            angle_min=ANGLES[0], angle_increment=0.01, ranges=seen.astype(np.float32),
            range_max=30.0,
        )  # fmt: skip
        result = beams(scan, T, MOUNT, lone_return=MapperParams().lone_return)
        mapper.integrate(result)
        drop_offs.integrate(result)
    return grid


@pytest.mark.parametrize("name", ["cliff", "ditch", "stairs", "steep"])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_drop_off_is_suspected_before_the_robot_is_a_metre_from_it(name, noise):
    """And only beyond the edge: not in front of it."""
    height_map = driven(PROFILES[name], RIM - 1.05, noise=noise).read()
    iy, ix = np.nonzero(height_map.suspected)
    x, y = height_map.geometry.cell_center(np.stack([iy, ix], axis=1)).T
    assert len(x) > 10
    assert x.min() >= RIM
    assert x.max() < RIM + 2.0
    ahead = x[np.abs(y) < 0.3]
    assert ahead.min() < RIM + 0.3


@pytest.mark.parametrize("name", ["ramp", "level", "box", "rise"])
@pytest.mark.parametrize(("noise", "pitch"), [(0.0, 0.0), (0.01, 0.0), (0.01, 0.005)])
def test_ground_that_the_robot_can_drive_on_is_not(name, noise, pitch):
    assert not driven(PROFILES[name], 2.4, noise=noise, pitch=pitch).read().suspected.any()


def test_what_may_be_a_drop_off_is_closed_where_that_is_asked_for():
    """A ramp of 19 degrees, seen over its upper edge by a level look ahead."""
    assert driven(PROFILES["ditch"], 1.9, mode="may").read().suspected.any()
    shallow = PROFILES["ditch"][:2] + ((RIM, -0.2), (20.0, -0.2))
    marked = [driven(shallow, 1.95, mode).read().suspected.sum() for mode in ("must", "may")]
    assert marked[0] < marked[1]


@pytest.mark.parametrize("mode", ["must", "may"])
def test_beams_that_end_nowhere_tell_of_what_may_be_a_drop_off(mode):
    """They end in a pit, or on ground that swallows light: nobody can know."""
    height_map = driven(PROFILES["bottomless"], RIM - 1.05, mode, noise=0.01).read()
    assert height_map.suspected.any() == (mode == "may")
    x = height_map.geometry.cell_center(np.argwhere(height_map.suspected))[:, 0]
    assert (x >= RIM).all()
    assert (x < RIM + 0.6).all()


def test_single_beams_without_return_tell_of_none():
    """Nor do a few side by side: a laser loses some of its beams."""
    missed = np.zeros(40, bool)
    missed[[3, 10, 11, 12, 13, *range(20, 26)]] = True
    np.testing.assert_array_equal(np.flatnonzero(voids(missed)), [22, 23])


@pytest.fixture(scope="module")
def cliff():
    return driven(PROFILES["cliff"], RIM - 1.05)


def test_costs_planner_and_explanation(cliff):
    height_map = cliff.read()
    obstacles = to_obstacle_map(height_map)
    suspected = height_map.suspected
    assert (obstacles.cost[suspected] == OCCUPIED).all()
    assert (obstacles.occupancy[suspected] == -1).all()
    iy, ix = height_map.geometry.cell_at((RIM - 0.2, 0.0))
    assert obstacles.cost[iy, ix] == INFLATED
    place = height_map.geometry.cell_center(np.argwhere(suspected)[0])
    assert explain(height_map, place).rule is Rule.DROP_OFF
    assert explain(height_map, (RIM - 0.2, 0.0)).rule is Rule.INFLATION
    none = TraversabilityParams(drop_offs="none")
    assert (to_obstacle_map(height_map, none).cost[suspected] == -1).all()


def test_the_planner_does_not_cross_them_though_unknown_ground_is_allowed(cliff):
    """But does where nobody looks after drop-offs."""
    height_map = cliff.read(area=cliff.observed_area().grown(8))
    allowed = PlannerParams(unknown="cost")
    across = Pose2D(1.5, 0.0), Pose2D(RIM + 3.0, 0.0)
    for mode, crosses in (("none", True), ("must", False)):
        terrain = TraversabilityParams(drop_offs=mode)
        plan = Planner.from_height_map(height_map, terrain, allowed).plan(*across)
        cells = tuple(height_map.geometry.cell_at(plan.poses[:, :2, 3]).T)
        assert bool(plan.found and height_map.suspected[cells].any()) is crosses


def test_a_cell_that_is_seen_is_suspected_no_more(cliff):
    grid = driven(PROFILES["cliff"], RIM - 1.05)
    before = grid.read(area=cliff.observed_area())
    cell = tuple(np.argwhere(before.suspected)[0])
    x, y = before.geometry.cell_center(cell)
    down = Scan(angle_min=0.0, angle_increment=0.1, ranges=np.array([5.0], np.float32))
    above = se3.from_xyz_rpy([x, y, 3.0, 0.0, np.pi / 2, 0.0])
    Mapper(grid).integrate(beams(down, np.eye(4), above))
    after = grid.read(area=cliff.observed_area())
    assert after.known[cell]
    assert after.metres[cell] == pytest.approx(-2.0)
    assert after.suspected.sum() == before.suspected.sum() - 1


@pytest.mark.parametrize("doubt", [0, 100])
def test_it_takes_two_beams_and_until_then_the_height_is_that_of_any_unknown_cell(doubt):
    ground = HeightMap.from_metres([[0.0] * 8 + [0.3] * 8])
    doubted = np.where(np.arange(16) < 8, ground.probability, np.uint16(doubt))
    grid = HeightGrid()
    grid.write(replace(ground, probability=doubted))
    drop_offs = DropOffs(grid, TraversabilityParams(drop_offs="may"), 0.5)
    over_the_edge = Beams(
        origins=np.array([[0.1, 0.1, 0.5]]), ends=np.array([[2.1, 0.1, -0.5]]),
        is_hit=np.ones(1, bool), is_lone=np.zeros(1, bool),
    )  # fmt: skip
    for told in (1, 2):
        drop_offs.integrate(over_the_edge)
        height_map = grid.read()
        shadow = height_map.height[0, 8:11]  # up to where the beam is 0.11 m below the edge
        assert height_map.suspected[0].any() == (told == 2)
        assert (shadow == (SUSPECTED if told == 2 else 0)).all()


def test_they_are_saved_and_sent_with_the_heights(cliff, tmp_path):
    height_map = cliff.read()
    map_directory.save(tmp_path / "map", height_map, to_obstacle_map(height_map), "map")
    loaded = map_directory.load(tmp_path / "map", 0.5).height_map
    np.testing.assert_array_equal(loaded.suspected, height_map.suspected)
    message = HeightGridMessage()
    encode.fill_height_grid(message, height_map, 0, "map")
    np.testing.assert_array_equal(decode.height_map(message).suspected, height_map.suspected)


@draws(20)
@given(st.integers(0, 2**32 - 1))
def test_the_obstacle_grid_keeps_up(seed):
    """Converted tile by tile, the map is that of the whole, as marks come and go."""
    rng = np.random.default_rng(seed)
    metres = rng.choice([0.0, 0.05, 0.3, np.nan], (48, 48))
    height_map = HeightMap.from_metres(metres)
    marks = np.isnan(metres) & (rng.random(metres.shape) < 0.3)
    height_map = replace(height_map, height=np.where(marks, np.int16(SUSPECTED), height_map.height))
    grid = HeightGrid()
    grid.write(height_map)
    obstacles = ObstacleGrid(grid.geometry, TraversabilityParams())
    obstacles.update(grid, 0.5)
    iy, ix = (int(index) for index in grid.geometry.cell_at((0.06, 0.06)))
    area = Area(iy, ix, *metres.shape)
    expected = to_obstacle_map(height_map)
    found = obstacles.read(area)
    for name in ("occupancy", "cost", "blocked"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
