# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from planner_worlds import route_planner

from heightmap25d_ros.exploration.travel_costs import travel_costs
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.plan import Pose2D


def test_costs_are_those_of_the_planner():
    height = np.zeros((60, 60))
    height[20:24, :40] = 150
    planner = route_planner(height)
    robot = Pose2D(1.0, 1.0, yaw=0.0)
    costs = travel_costs(planner.graph, robot, Params())
    for goal in ((1.0, 6.0), (6.0, 1.0), (5.0, 6.5)):
        cell = tuple(planner.graph.geometry.cell_at(goal))
        plan = planner.plan(robot, Pose2D(*goal), is_robot_there=True)
        assert abs(costs[cell] - plan.cost) < 1e-6 + 0.01 * plan.cost
    assert np.isinf(costs[22, 10])


def test_costs_of_a_robot_beside_a_wall():
    height = np.zeros((60, 60))
    height[:, :4] = 150
    graph = route_planner(height).graph
    before = graph.incoming.copy()
    robot = Pose2D(0.9, 3.0, yaw=1.57)  # its disc touches the wall, its rectangle does not
    costs = travel_costs(graph, robot, Params())
    assert not graph.enterable[24, 7]
    assert 3.0 < costs[24, 40] < 6.0
    assert np.array_equal(graph.incoming, before)
