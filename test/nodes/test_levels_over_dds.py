# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps with several levels over DDS: planned over by `planning`, one level shown by `mapping`."""

from dataclasses import replace

import numpy as np
import pytest
from bag_writer import odometry, rclpy_type
from geometry_msgs.msg import PoseStamped
from level_worlds import BRIDGE, overpass
from nav_msgs.msg import Path
from nav_msgs.srv import GetMap
from node_client import LATCHED, Client, mapping_node, node_process

from heightmap25d_msgs.msg import HeightGrid, PlanStatus, UpperSurfaces
from heightmap25d_msgs.srv import LoadMap
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import encode, map_directory

WORLD = overpass()
NO_RAMPS = replace(HeightMap.from_metres(np.zeros(WORLD.height.shape)), upper=WORLD.upper)
STEEP = ("-p", "traversability.max_slope:=0.6")
START = 10**18


class Planner(Client):
    """A client that shows maps and sends goals."""

    def __init__(self, namespace):
        super().__init__(namespace)
        self.plans, self.statuses = [], []
        self.node.create_subscription(Path, "plan", self.plans.append, 100)
        self.node.create_subscription(PlanStatus, "planning/status", self.statuses.append, 100)

    def show(self, height_map, stamp):
        grid, upper = HeightGrid(), UpperSurfaces()
        encode.fill_height_grid(grid, height_map, stamp, "map")
        encode.fill_upper_surfaces(upper, height_map, stamp, "map")
        self.publish("upper_surfaces", upper, LATCHED)
        self.publish("height_grid", grid, LATCHED)

    def until(self, is_wanted, x, y, z):
        """The first plan for a goal that is as wanted; the goal is sent until there is one."""
        goal = PoseStamped()
        goal.header.frame_id = "map"
        goal.pose.position.x, goal.pose.position.y, goal.pose.position.z = x, y, z
        goal.pose.orientation.w = 1.0
        while not (self.statuses and is_wanted(self.statuses[-1])):
            count = len(self.statuses)
            self.publish("goal_pose", goal)
            self.wait(lambda n=count: min(len(self.plans), len(self.statuses)) > n)
        return self.plans[-1], self.statuses[-1]


def test_a_goal_on_a_bridge_is_planned_to_from_below_it_and_refused_when_its_ramps_are_gone():
    client = Planner("/levels")
    standing = "-p", "intake.timeout:=600.0", "-p", "planner.timeout:=600.0"
    with node_process("planning", *standing, *STEEP, namespace="/levels"):
        client.show(WORLD, START)
        client.publish("odom", odometry(START, (6.0, 1.0, 0.0), type_of=rclpy_type))
        path, _ = client.until(lambda status: status.code == PlanStatus.NONE, 6.0, 5.0, 2.0)
        z = [pose.pose.position.z for pose in path.poses]
        assert z[0] == pytest.approx(0.0, abs=0.03)
        assert z[-1] == pytest.approx(2.0, abs=0.03)
        client.show(NO_RAMPS, START + 1)
        _, refused = client.until(lambda status: status.code != PlanStatus.NONE, 6.0, 5.0, 2.0)
        assert refused.reason.endswith("(on the upper level)")
    client.close()


def test_mapping_shows_the_level_that_its_parameter_names(tmp_path):
    map_directory.save(tmp_path / "two", WORLD)
    client = Client("/shown")
    slice_of = "-p", "mapping.slice:=top"
    with mapping_node(tmp_path, *slice_of, *STEEP, namespace="/shown"):
        assert client.call("mapping/load_map", LoadMap, name="two").success
        shown = client.call("mapping/get_map", GetMap).map
    client.close()
    (x, _), (y, _) = BRIDGE
    occupancy = np.array(shown.data).reshape(shown.info.height, shown.info.width)
    resolution, origin = shown.info.resolution, shown.info.origin.position
    edge = occupancy[int((y - origin.y) / resolution), int((x + 1.0 - origin.x) / resolution)]
    assert edge == 100  # of the deck; the lowest surfaces are a road there
