# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of several levels as messages, and what planning and mapping make of them."""

from dataclasses import replace

import numpy as np
import pytest
from bag_writer import header, odometry, rclpy_type
from level_worlds import overpass

from heightmap25d_ros.grid.height_map import Area
from heightmap25d_ros.grid.levels import NO_UPPER
from heightmap25d_ros.io import encode
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.level_map import LevelMap
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.planning import Planning
from heightmap25d_ros.planning.plan import Status

START = 10**18
WORLD = overpass()
VALUES = {"planner.timeout": 600.0, "traversability.max_slope": 0.6}


def lowest(shown=WORLD, stamp=START):
    message = rclpy_type("heightmap25d_msgs/msg/HeightGrid")()
    encode.fill_height_grid(message, shown, stamp, "map")
    return message


def upper(shown=WORLD, stamp=START, **changes):
    message = rclpy_type("heightmap25d_msgs/msg/UpperSurfaces")()
    encode.fill_upper_surfaces(message, shown, stamp, "map")
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def goal(x, y, z):
    message = rclpy_type("geometry_msgs/msg/PoseStamped")()
    message.header = rclpy_type("std_msgs/msg/Header")(frame_id="map")
    message.pose.position.x, message.pose.position.y, message.pose.position.z = x, y, z
    return message


def test_both_messages_of_a_stamp_are_one_map_in_either_order():
    for messages in ((upper(), lowest()), (lowest(), upper())):
        joined, dropped = None, Drops()
        levels = LevelMap("map", dropped)
        for message in messages:
            is_lowest = hasattr(message, "height")
            joined = (levels.take_lowest if is_lowest else levels.take_upper)(message) or joined
        np.testing.assert_array_equal(joined.upper.cell, WORLD.upper.cell)
        np.testing.assert_array_equal(joined.upper.top, WORLD.upper.top)
        assert not dropped


def test_what_is_above_a_map_that_has_grown_is_where_it_was():
    levels = LevelMap("map", Drops())
    part = Area(16, 8, 48, 80)
    here = part.slices(Area(0, 0, *WORLD.geometry.shape))
    smaller = replace(
        WORLD,
        geometry=WORLD.geometry.part(part),
        height=WORLD.height[here],
        probability=WORLD.probability[here],
        upper=WORLD.upper.part(part.iy, part.ix, *part.shape),
    )
    levels.take_upper(upper(smaller))
    grown = levels.take_lowest(lowest(stamp=START + 1))
    np.testing.assert_array_equal(grown.upper.cell, WORLD.upper.cell)


def test_unusable_upper_surfaces_are_counted_and_leave_all_as_it_was():
    dropped = Drops()
    levels = LevelMap("map", dropped)
    levels.take_upper(upper())
    bad = upper(cell=[1])
    assert levels.take_upper(bad) is None
    assert sum(dropped.values()) == 1
    assert len(levels.take_lowest(lowest()).upper) == len(WORLD.upper)


def planning(robot):
    p = Planning(with_values(Params(), VALUES))
    p.take_upper_surfaces(upper())
    p.take_map(lowest())
    p.take_odometry(odometry(START, robot, (0.0, 0.0, 0.0, 1.0)))
    return p


def test_a_goal_on_the_bridge_is_planned_to_from_below_it():
    plan = planning((6.0, 1.0, 0.0)).take_goal(goal(6.0, 5.0, 2.0))
    assert plan.found
    assert plan.poses[-1, 2, 3] == pytest.approx(2.0, abs=0.05)


def test_a_goal_whose_z_is_not_given_is_on_the_lowest_level():
    plan = planning((6.0, 1.0, 0.0)).take_goal(goal(6.0, 5.0, 0.0))
    assert plan.poses[-1, 2, 3] == pytest.approx(0.0, abs=0.05)


def test_a_map_without_a_bridge_any_more_is_planned_over_again():
    p = planning((6.0, 1.0, 0.0))
    assert p.take_goal(goal(6.0, 5.0, 2.0)).found
    p.take_upper_surfaces(upper(replace(WORLD, upper=NO_UPPER), START + 1))
    gone = p.take_map(lowest(stamp=START + 1))
    assert gone is None or gone.status is not Status.NONE or gone.poses[-1, 2, 3] < 0.1


def mapping(robot, **values):
    """A pipeline with the world as its map, and the robot somewhere in it."""
    m = Mapping(with_values(Params(), VALUES | values))
    m.clear(WORLD)
    m.take_odometry(odometry(START, robot, (0.0, 0.0, 0.0, 1.0)))
    scan = rclpy_type("sensor_msgs/msg/LaserScan")()
    scan.header = header(START, "laser")
    return m


@pytest.mark.parametrize(
    ("level", "is_road_free"), [("lowest", True), ("top", False)], ids=["lowest", "top"]
)
def test_the_obstacle_grid_is_of_one_level(level, is_road_free):
    height_map, obstacles = mapping((6.0, 1.0, 0.0), **{"mapping.slice": level}).maps()
    assert len(height_map.upper) == len(WORLD.upper)
    beside = tuple(height_map.geometry.cell_at((6.0, 4.07)))  # the edge of the deck
    assert (obstacles.occupancy[beside] == 0) == is_road_free


def test_updates_lead_to_what_a_map_that_is_converted_anew_has():
    """As the level that is shown changes, so do the obstacles, in the tiles that it changes in."""
    m = mapping((6.0, 1.0, 0.0))
    for place in ((6.0, 1.0, 0.0), (6.0, 5.0, 2.0), (6.0, 9.0, 0.0)):
        m._robot = place
        _, obstacles = m.maps()
        fresh = mapping(place)
        fresh._robot = place
        np.testing.assert_array_equal(obstacles.cost, fresh.maps()[1].cost)
        middle = tuple(obstacles.geometry.cell_at((6.0, 5.0)))
        assert obstacles.occupancy[middle] == 0
