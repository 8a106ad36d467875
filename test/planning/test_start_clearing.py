# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that stands and looks must not wear its map away."""

import analytic_worlds
import numpy as np
import pytest

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.mapping.sensor_model import beams
from heightmap25d_ros.params.sections import GridParams, MapperParams, SensorParams

ANGLES = np.radians(np.arange(-90, 90.5, 0.5))
SCANS_PER_MINUTE = 2250  # of a laser at 37.5 Hz
DROPOUT = 0.002  # share of the beams that are not answered
YARD = analytic_worlds.World([analytic_worlds.plane()])
MOUNT = se3.from_xyz_rpy([[0.28, 0.0, 0.6, 0.0, np.radians(28), 0.0]])


def scan(ranges):
    return Scan(
        stamp_ns=10**9,
        frame_id="laser_down",
        angle_min=ANGLES[0],
        angle_increment=np.radians(0.5),
        time_increment=0.0,
        range_min=0.05,
        range_max=30.0,
        ranges=np.where(ranges < 30.0, ranges, np.inf).astype(np.float32),
    )


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["paper", "candidate"])
def test_a_minute_of_unanswered_beams_takes_nothing_from_the_ground_ahead(rule):
    """The robot drives 8 m back from ground that it sees, 1 cm of noise, and then stands."""
    rng = np.random.default_rng(4)
    mapper = Mapper(
        HeightGrid(GridParams(extent=64.0)), SensorParams(), MapperParams(update_rule=rule)
    )

    def look(x, dropout):
        T_map_base = se3.from_xyz_rpy([[x, 0.0, 0.0, 0.0, 0.0, 0.0]])
        ranges = analytic_worlds.scan_ranges(YARD, T_map_base @ MOUNT, ANGLES)
        ranges = ranges + rng.normal(0.0, 0.01, len(ranges))
        ranges[rng.random(len(ranges)) < dropout] = np.inf
        mapper.integrate(beams(scan(ranges), T_map_base, MOUNT, SensorParams(), 0.15))

    def known():
        return mapper.grid.read(0.5, mapper.grid.area).known

    for x in np.arange(8.0, 0.0, -0.02):
        look(x, dropout=0.0)
    before = known()
    assert before.sum() > 2000
    for _ in range(SCANS_PER_MINUTE):
        look(0.0, DROPOUT)
    assert not (before & ~known()).any()
