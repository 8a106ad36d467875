# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What went away is cleared, also where only a level laser saw it and the poses are planar."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws
from repository import BAGS
from scipy import ndimage

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation.truth import read_truth
from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.height_map import Area
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import GridParams, MapperParams, Params, SensorParams
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import feed

GRID = GridParams(resolution=0.125, extent=64.0)
ANGLES = np.radians(np.arange(-90.0, 90.1, 0.5))


def mapper(**params):
    return Mapper(HeightGrid(GRID), SensorParams(), MapperParams(**params))


def one_beam(origin, end):
    return Beams(
        origins=np.array([origin], float),
        ends=np.array([end], float),
        is_hit=np.ones(1, bool),
        is_lone=np.zeros(1, bool),
    )


def is_known(m, x, y):
    iy, ix = m.grid.geometry.cell_at((x, y))
    return bool(m.grid.read(0.5, Area(int(iy), int(ix), 1, 1)).known[0, 0])


@draws(200)
@given(
    z=st.floats(-5.0, 5.0),
    heading=st.floats(-math.pi, math.pi),
    distance=st.floats(0.5, 15.0),
    hits=st.integers(1, 40),
)
def test_a_level_beam_clears_what_it_wrote_itself(z, heading, distance, hits):
    m = mapper()
    ahead = np.array([math.cos(heading), math.sin(heading), 0.0])
    # Through the middle of the cell, so that clearing_width is no matter.
    iy, ix = m.grid.geometry.cell_at(distance * ahead[:2])
    middle = np.array([*m.grid.geometry.cell_center((iy, ix)), z])
    laser = middle - distance * ahead
    for _ in range(hits):
        m.integrate(one_beam(laser, middle))
    assert is_known(m, *middle[:2])
    for _ in range(8):
        m.integrate(one_beam(laser, middle + 3.0 * ahead))
    assert not is_known(m, *middle[:2])


@pytest.mark.parametrize(
    ("fall", "lowest_cleared"),
    [(0.0, -1), (0.05, 1), (0.125, 2), (0.25, 5), (0.4, 5)],  # -1 + 6 * 5 / 25 = 0.2 and so on
)
def test_the_margin_grows_with_the_fall_of_the_beam(fall, lowest_cleared):
    """Cells of known heights under one beam: from 4 cm below it to 9 cm above it."""
    for above in range(-4, 10):
        m = mapper()
        x, y = 2.0625, 0.0625
        m.integrate(one_beam((x, y, 3.0), (x, y, 1.0 + 0.01 * above)))
        before = m.grid.probability.read(m.grid.observed_area()).max()
        m.integrate(one_beam((x - 1.5, y, 1.0 + fall / 2), (x + 1.5, y, 1.0 - fall / 2)))
        iy, ix = m.grid.geometry.cell_at((x, y))
        after = m.grid.probability.read(Area(int(iy), int(ix), 1, 1))[0, 0]
        assert (after < before) == (above >= lowest_cleared), above


def test_without_the_exception_a_level_beam_clears_nothing_that_it_wrote():
    m = mapper(clearing_fall=0.0)
    m.integrate(one_beam((0.0, 0.0625, 0.3), (3.0625, 0.0625, 0.3)))
    for _ in range(20):
        m.integrate(one_beam((0.0, 0.0625, 0.3), (6.0, 0.0625, 0.3)))
    assert is_known(m, 3.0625, 0.0625)


def ranges_in_a_room(laser, angles, person):
    """To the walls of a room of 10 m x 8 m, or to a person's legs as one cylinder."""
    along = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    low, high = np.array([-1.0, -4.1]) - laser, np.array([9.0, 3.9]) - laser
    with np.errstate(divide="ignore"):
        ranges = np.minimum.reduce(np.maximum(low / along, high / along), axis=1)
    if person is not None:
        middle = along @ (person - laser)
        inside = 0.2**2 - ((person - laser) ** 2).sum() + middle**2
        hit = (inside > 0.0) & (middle > 0.0)
        ranges = np.where(hit, middle - np.sqrt(np.maximum(inside, 0.0)), ranges)
    return along, ranges


@pytest.mark.parametrize("tilt", [0.0, 0.002])
def test_a_person_who_left_is_gone_and_the_walls_stay(tilt):
    """A robot on planar odometry, with a level laser, or one that is not mounted quite level."""
    rng = np.random.default_rng(7)
    m = mapper()
    person = np.array([3.0, 0.2])
    wall = np.zeros(m.grid.area.shape, int)
    for k in range(160):
        laser = np.array([0.01 * k, 0.013])
        along, ranges = ranges_in_a_room(laser, ANGLES, person if k < 60 else None)
        ranges = ranges + rng.normal(0.0, 0.01, len(ranges))
        ends = np.column_stack([laser + ranges[:, None] * along, 0.3 + tilt * ranges])
        m.integrate(
            Beams(
                origins=np.broadcast_to([*laser, 0.3], ends.shape).copy(),
                ends=ends,
                is_hit=np.ones(len(ends), bool),
                is_lone=np.zeros(len(ends), bool),
            )
        )
        known = m.grid.read(0.5, m.grid.area).known
        cells = m.grid.geometry.cell_at(ends[:, :2])
        is_wall = np.hypot(*(ends[:, :2] - person).T) > 1.0
        np.add.at(wall, tuple(cells[is_wall].T), 1)
        x, y = m.grid.geometry.cell_center(np.argwhere(known)).T
        standing = (np.hypot(x - person[0], y - person[1]) < 0.5).sum()
        assert standing >= 3 or k < 5 or k >= 60
    assert standing == 0
    often = wall >= 20
    assert often.sum() > 150
    assert ndimage.maximum_filter(known, 3)[often].mean() > 0.98


def planar(message):
    """The pose without z, roll and pitch."""
    position, rotation = message.pose.pose.position, message.pose.pose.orientation
    pose = se3.from_quaternion(
        np.zeros(3), np.array([rotation.x, rotation.y, rotation.z, rotation.w])
    )
    yaw = math.atan2(pose[1, 0], pose[0, 0])
    position.z = rotation.x = rotation.y = 0.0
    rotation.z, rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return message


def test_a_ramp_stays_where_a_level_laser_looks_at_it_from_below():
    """The robot's z errs by centimetres; beams end where the ramp is as high as the laser."""
    rng = np.random.default_rng(3)
    m = mapper()
    y = 0.0625
    along = m.grid.geometry.resolution * (np.arange(40, 80) + 0.5)  # 5 m to 10 m
    for x in along:
        for _ in range(3):
            m.integrate(one_beam((x, y, 3.0), (x, y, 0.1 * (x - 5.0))))
    for x in np.arange(0.0, 4.0, 0.02):
        z = 0.35 + rng.normal(0.0, 0.03)
        m.integrate(one_beam((x, y, z), (8.5 + rng.normal(0.0, 0.02), y, z)))
    assert all(is_known(m, x, y) for x in along)


@pytest.mark.slow
def test_hardly_anything_is_left_of_what_moved_before_a_level_laser():
    """`moving_1` by its level laser alone, with planar poses."""
    mapping = Mapping(with_values(Params(), {"intake.scan_topics": ["/scan"]}))
    with Bag(BAGS / "moving_1") as bag:
        for event in bag.events(["/scan", "/ground_truth", "/tf_static"]):
            if event.topic == "/ground_truth":
                feed(mapping, "/odom", planar(event.message))
            else:
                feed(mapping, event.topic, event.message)
    mapping.flush()
    height_map, _ = mapping.maps()
    truth = read_truth(BAGS / "moving_1" / "truth" / "surface.npz")
    cells = truth.geometry.cell_at(height_map.geometry.cell_center(np.argwhere(height_map.known)))
    near_walls = ndimage.maximum_filter(truth.top > 0.25, 3)
    inside = truth.geometry.contains(cells)
    assert inside.sum() > 300
    # Beams that end within a metre, at a wall behind, leave what stands right before it.
    assert np.count_nonzero(~near_walls[tuple(cells[inside].T)]) <= 2
