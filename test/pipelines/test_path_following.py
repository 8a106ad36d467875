# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, velocities out: what halts the robot, and that it goes on."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bag_writer import header, odometry, rosbags_type
from level_worlds import overpass

from heightmap25d_ros.control.pure_pursuit import STANDSTILL
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.path_following import PathFollowing

BEGIN, MS = 10**12, 10**6
LINE = np.column_stack([np.arange(1.0, 9.05, 0.1), np.full(81, 5.0), np.zeros(81)])
FLAT = np.zeros((80, 80))


def terrain(*boxes):
    """10 m x 10 m of flat ground with boxes: two x, two y, and a height [m]."""
    height = FLAT.copy()
    for x0, x1, y0, y1, z in boxes:
        height[round(8 * y0) : round(8 * y1), round(8 * x0) : round(8 * x1)] = z
    return HeightMap.from_metres(height, resolution=0.125)


class Drive:
    """A robot on a line, as messages tell of it."""

    def __init__(self, **values):
        names = {f"path_follower.{name}": value for name, value in values.items()}
        self.following = PathFollowing(with_values(Params(), names))
        self.following.set_path(LINE)
        self.ns = BEGIN

    def stand(self, x=1.0, y=5.0, yaw=0.0, *, z=0.0, times=1):
        """Be at a place for so many tenths of a second; the newest velocity."""
        for _ in range(times):
            self.ns += 100 * MS
            pose = odometry(self.ns, (x, y, z), type_of=rosbags_type)
            pose.pose.pose.orientation.z = math.sin(yaw / 2)
            pose.pose.pose.orientation.w = math.cos(yaw / 2)
            velocity = self.following.take_odometry(pose)
            self.following.pass_time(self.ns)
        return velocity

    def localize(self, state):
        self.following.take_localization_status(SimpleNamespace(state=state, LOST=2))


def test_it_drives_faster_and_faster_and_stands_at_the_end():
    drive = Drive()
    speeds = [drive.stand().speed for _ in range(15)]
    assert speeds == sorted(speeds)
    assert speeds[-1] == pytest.approx(1.0)
    assert drive.following.remaining == pytest.approx(8.0, abs=0.1)
    for x in np.arange(2.0, 9.1, 0.5):
        drive.stand(x, times=3)
    assert drive.stand(9.0, times=20) == STANDSTILL
    assert not drive.following.has_path
    assert not drive.following.fault


def test_it_stands_without_a_path_and_when_the_path_is_taken_away():
    drive = Drive()
    assert drive.stand(times=5).speed > 0.2
    drive.following.take_plan(SimpleNamespace(header=header(0, "map"), poses=[]))
    assert drive.stand() == STANDSTILL
    assert not drive.following.has_path
    drive.following.take_plan(SimpleNamespace(header=header(0, "odom"), poses=[]))
    assert drive.stand() == STANDSTILL


def test_a_lost_robot_halts_at_once_and_goes_on_when_it_is_found():
    drive = Drive()
    drive.stand(times=10)
    drive.localize(2)
    assert drive.stand() == STANDSTILL
    assert drive.following.fault == "localization is LOST"
    drive.localize(0)
    assert 0.0 < drive.stand().speed < 0.1  # from standstill
    assert drive.following.fault == ""


def test_odometry_that_falls_silent_stops_the_robot():
    drive = Drive(timeout=0.5)
    drive.stand(times=10)
    velocities = [drive.following.pass_time(drive.ns + n * 100 * MS) for n in range(1, 9)]
    assert velocities[0] is None
    assert velocities[-1] == STANDSTILL
    assert "nothing from odometry for" in drive.following.fault
    drive.ns += 800 * MS
    assert drive.stand().speed > 0.0


def test_localization_that_falls_silent():
    drive = Drive(localization_timeout=1.0)
    assert drive.stand(times=20).speed > 0.5  # nobody relies on it
    drive.localize(0)
    assert drive.stand(times=8).speed > 0.5
    assert drive.stand(times=5) == STANDSTILL
    assert "nothing from localization for" in drive.following.fault


def test_maps_that_fall_silent_and_a_map_that_came_once():
    drive = Drive(map_timeout=1.0)
    drive.following.set_map(terrain())
    assert drive.stand(times=30).speed > 0.5
    drive.following.set_map(terrain())
    assert drive.stand(times=8).speed > 0.5
    assert drive.stand(times=5) == STANDSTILL
    assert "nothing from map for" in drive.following.fault


def test_a_stale_plan():
    drive = Drive()
    stale = SimpleNamespace(code=202, TF_ERROR=202, reason="the plan is stale: nothing heard")
    drive.following.take_plan_status(stale)
    assert drive.stand() == STANDSTILL
    assert drive.following.fault == "the plan is stale: nothing heard"
    drive.following.take_plan_status(SimpleNamespace(code=0, TF_ERROR=202, reason=""))
    assert drive.stand().speed > 0.0


def test_an_obstacle_on_the_next_metre_halts_it_and_one_farther_away_does_not():
    drive = Drive()
    drive.following.set_map(terrain((4.0, 4.5, 4.0, 6.0, 1.0)))
    assert drive.stand(1.0, times=10).speed > 0.5
    assert drive.stand(2.0, times=5).speed > 0.3
    assert drive.stand(2.9, times=3) == STANDSTILL
    assert drive.following.fault == "the next 1 m of the path are not free"
    drive.following.set_map(terrain())
    assert drive.stand(2.9).speed > 0.0


def test_a_drop_is_an_obstacle_and_so_is_the_unknown():
    for box in ((4.0, 10.0, 0.0, 10.0, -1.0), (4.0, 10.0, 0.0, 10.0, np.nan)):
        drive = Drive()
        drive.following.set_map(terrain(box))
        assert drive.stand(1.0, times=5).speed > 0.2
        assert drive.stand(2.0).speed > 0.2
        assert drive.stand(3.2, times=3) == STANDSTILL


def test_it_halts_away_from_its_path():
    drive = Drive(max_offset=0.4)
    assert drive.stand(1.5, 5.3).speed >= 0.0
    assert not drive.following.fault
    assert drive.stand(1.5, 5.5) == STANDSTILL
    assert "0.50 m from the path, more than 0.4 m" in drive.following.fault


def test_it_is_slower_beside_obstacles_and_on_slopes():
    beside = terrain((0.0, 10.0, 5.625, 6.0, 1.0))
    slope = HeightMap.from_metres(np.tile(0.3 * 0.125 * np.arange(80), (80, 1)), resolution=0.125)
    speeds = []
    for height_map in (terrain(), beside, slope):
        drive = Drive()
        drive.following.set_map(height_map)
        speeds.append(drive.stand(1.5, times=30).speed)
    assert 0.2 < speeds[1] < 0.7
    assert speeds[2] == pytest.approx(speeds[0] * (1 - math.atan(0.3) / 0.9), abs=0.03)


def test_broken_messages_do_not_move_it():
    drive = Drive()
    drive.stand(times=5)
    broken = odometry(drive.ns, (math.nan, 0.0, 0.0), type_of=rosbags_type)
    assert drive.following.take_odometry(broken) == STANDSTILL
    drive.following.take_plan(SimpleNamespace(header=header(0, "odom"), poses=[None]))
    assert drive.stand() == STANDSTILL
    assert set(drive.following.dropped) == {"odometry: bad pose.pose", "plan: bad header.frame_id"}


def test_the_acceleration_is_that_of_a_tenth_of_a_second_after_a_gap():
    drive = Drive()
    drive.stand()
    drive.ns += 400 * MS
    assert drive.stand().speed <= 0.08 + 0.08 + 1e-9


def test_only_what_is_on_its_own_level_stands_in_the_way():
    """A box on the road below a bridge, and none on the bridge."""
    road = overpass()
    height = road.height.copy()
    height[38:42, 46:50] = 50
    over, under = Drive(), Drive()
    for drive in (over, under):
        drive.following.set_map(replace(road, height=height))
    assert over.stand(x=5.2, z=2.0, times=3).speed > 0.0
    assert over.following.fault == ""
    line = np.column_stack([np.full(41, 6.0), np.arange(3.0, 7.05, 0.1), np.full(41, np.pi / 2)])
    under.following.set_path(line)
    assert under.stand(x=6.0, y=3.9, yaw=np.pi / 2, times=3) == STANDSTILL
    assert "not free" in under.following.fault
