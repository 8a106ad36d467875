# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Paths that are asked for, and paths that are checked, without ROS."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_planning import (
    EAST,
    FAR,
    FLAT,
    NEAR,
    WEST,
    at,
    crosses_wall_at,
    ends,
    grid,
    planning,
    pose_stamped,
    wall,
)

from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.path_requests import KeptPlanner, MapPlanner, PathRequest
from heightmap25d_ros.planning.boundary import Boundary
from heightmap25d_ros.planning.plan import Plan, Status


def path_message(poses, frame_id="map"):
    """A nav_msgs/Path of places (x, y)."""
    stamped = [pose_stamped(x, y, frame_id=frame_id) for x, y in poses]
    return SimpleNamespace(header=pose_stamped(0.0, 0.0, frame_id=frame_id).header, poses=stamped)


def straight(start=WEST, goal=EAST, count=25):
    return np.linspace(start, goal, count)


def test_a_path_is_asked_for_from_the_robot_or_from_a_start():
    p = planning(FLAT)
    assert ends(p.request([pose_stamped(*EAST)]).plan()) == (WEST, EAST)
    elsewhere = p.request([pose_stamped(*EAST)], pose_stamped(5.0, 8.0))
    assert ends(elsewhere.plan()) == ((5.0, 8.0), EAST)
    assert p.take_odometry(at(3.0, 5.0)) is None  # nobody follows what was asked for


def test_a_path_through_goals_is_that_of_its_legs():
    p = planning(FLAT)
    corners = [(5.0, 8.0), EAST, (5.0, 2.0)]
    plan = p.request([pose_stamped(x, y) for x, y in corners]).plan()
    assert ends(plan) == (WEST, corners[-1])
    places = plan.poses[:, :2, 3]
    steps = np.hypot(*np.diff(places, axis=0).T)
    for corner in corners:
        at_corner = np.hypot(*(places - corner).T) < 1e-6
        assert at_corner.sum() == 1
    assert steps.min() > 0.0
    assert steps.max() < 0.5
    between = [WEST, *corners]
    straight_on = sum(np.hypot(*np.subtract(a, b)) for a, b in zip(between, corners, strict=False))
    assert plan.length == pytest.approx(straight_on, rel=0.02)
    assert plan.length == pytest.approx(steps.sum(), rel=1e-6)


def test_the_first_goal_without_a_path_is_named():
    p = planning(wall())
    plan = p.request([pose_stamped(3.0, 8.0), pose_stamped(*EAST), pose_stamped(2.0, 2.0)]).plan()
    assert plan.status is Status.NO_VALID_PATH
    assert plan.reason.startswith("goal 2 of 3: ")
    alone = p.request([pose_stamped(*EAST)]).plan()
    assert alone.reason == plan.reason.removeprefix("goal 2 of 3: ")


def test_what_is_not_known_refuses_a_request():
    for p, reason in (
        (planning(None), "no map has come yet"),
        (planning(FLAT, robot=None), "start: no odometry has come yet"),
    ):
        refused = p.request([pose_stamped(*EAST)])
        assert isinstance(refused, Plan)
        assert refused.reason == reason
    p = planning(FLAT)
    moon = pose_stamped(*EAST, frame_id="moon")
    assert p.request([moon]).reason == "goal: no transform from 'moon' to 'map'"
    assert "goals[1]: " in p.request([pose_stamped(*EAST), moon]).reason
    assert p.request([pose_stamped(np.nan, 0.0)]).status is Status.UNKNOWN
    start = pose_stamped(*WEST, quaternion=(0.0, 0.0, 0.0, 0.0))
    assert "not a unit quaternion" in p.request([pose_stamped(*EAST)], start).reason
    for second in range(5):
        p.pass_time(second * 10**9)
    assert "nothing from odometry" in p.request([pose_stamped(*EAST)]).reason
    assert isinstance(p.request([pose_stamped(*EAST)], pose_stamped(*WEST)), PathRequest)


def test_a_request_is_planned_over_the_map_of_its_time():
    p = planning(wall(NEAR))
    request = p.request([pose_stamped(*EAST)])
    p.take_map(grid(wall(FAR)))
    assert NEAR[0] < crosses_wall_at(request.plan()) < NEAR[1]
    assert FAR[0] < crosses_wall_at(p.request([pose_stamped(*EAST)]).plan()) < FAR[1]


def test_a_cancelled_request_stops_before_the_next_goal():
    answers = iter([False, True])
    request = planning(FLAT).request([pose_stamped(*EAST), pose_stamped(*WEST)])
    plan = request.plan(lambda: next(answers))
    assert (plan.found, plan.reason) == (False, "cancelled")


def test_a_map_that_cannot_be_converted_is_a_reason():
    request = planning(FLAT).request([pose_stamped(*EAST)])
    height_map = request.over.height_map
    fine = replace(height_map, geometry=replace(height_map.geometry, resolution=0.01))
    params = with_values(Params(), {"traversability.robot_radius": 5.0})
    over = MapPlanner(fine, KeptPlanner(params, Boundary.of([])))
    plan = replace(request, over=over).plan()
    assert plan.status is Status.UNKNOWN
    assert "robot_radius" in plan.reason


def test_a_free_path_is_valid_and_one_through_a_wall_up_to_it():
    p = planning(FLAT)
    assert p.first_invalid(path_message(straight())) is None
    p.take_map(grid(wall()))
    invalid = p.first_invalid(path_message(straight()))
    x = straight()[invalid][0]
    assert 5.0 - 0.13 - 0.64 <= x <= 5.0  # the robot's disc or front touches the wall
    assert p.first_invalid(path_message(straight()[:invalid])) is None


def test_what_lies_behind_the_robot_is_not_looked_at():
    p = planning(wall(), robot=(7.0, 5.0))
    assert p.first_invalid(path_message(straight())) is None
    p.take_odometry(at(3.0, 5.0))
    assert p.first_invalid(path_message(straight())) is not None


def test_a_path_is_checked_where_nobody_knows_the_robot():
    p = planning(wall(), robot=None)
    assert p.first_invalid(path_message(straight())) is not None
    assert p.first_invalid(path_message(straight(goal=(4.0, 5.0)))) is None


def test_paths_that_cannot_be_checked_are_not_valid():
    p = planning(FLAT)
    assert p.first_invalid(path_message([])) == 0
    assert p.first_invalid(path_message([(2.0, np.nan)])) == 0
    assert p.first_invalid(path_message(straight(), "moon")) == 0
    assert p.first_invalid(path_message([*straight(), (500.0, 5.0)])) == 25
    assert planning(None).first_invalid(path_message(straight())) == 0
    assert "path: bad poses" in str(p.dropped)
    assert "path: bad header" in str(p.dropped)


def test_a_path_in_another_frame_is_checked_in_the_map():
    p = planning(wall(), robot=(7.0, 5.0))
    ahead = np.linspace((0.0, 0.0), (2.0, 0.0), 9)
    assert p.first_invalid(path_message(ahead, "base_link")) is None
    assert p.first_invalid(path_message(-ahead, "base_link")) is not None
