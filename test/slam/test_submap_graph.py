# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Submaps that are moved, along the drive and by its loops."""

import numpy as np
import pytest

from heightmap25d_ros import se3
from heightmap25d_ros.localization.registration import Reason
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.loop_closure import Found
from heightmap25d_ros.slam.pose_graph import Edge, between
from heightmap25d_ros.slam.submap_graph import SubmapGraph

COVARIANCE = np.diag(np.square([0.05, 0.05, 0.01, 0.05]))


def planar(x, y=0.0, yaw=0.0):
    return se3.from_xyz_rpy([x, y, 0.0, 0.0, 0.0, yaw])


def straight(count):
    """A drive along x, with a submap every 4 m."""
    graph = SubmapGraph(Params())
    graph.begin(planar(0.0), np.eye(3))
    for number in range(1, count):
        graph.follow(planar(4.0 * number), COVARIANCE, 4.0)
    return graph


def begins(graph):
    return np.array([submap.T_map_submap @ submap.start for submap in graph.submaps])


def test_what_is_newer_than_the_submaps_that_moved_goes_with_the_robot():
    graph, of_second, of_robot = straight(4), planar(0.1, 0.2), planar(0.3, 0.4)
    moved = graph.move({1: of_second}, of_robot)
    np.testing.assert_allclose(moved, of_robot)
    expected = [planar(0.0), planar(4.1, 0.2), planar(8.3, 0.4), planar(12.3, 0.4)]
    np.testing.assert_allclose(begins(graph), expected, atol=1e-12)
    for edge in graph.graph.edges:
        poses = graph.graph.poses
        np.testing.assert_allclose(edge.measured, between(poses[edge.first], poses[edge.second]))


def test_a_loop_still_holds_when_the_drive_is_known_better():
    graph = straight(4)
    loop = Edge(0, 3, np.array([12.0, 0.0, 0.0, 0.0]), 1e8 * np.eye(4), is_loop=True)
    graph.close([loop])
    moved = graph.move({1: planar(0.1)}, planar(0.1))
    np.testing.assert_allclose(begins(graph)[3], planar(12.0), atol=1e-3)
    np.testing.assert_allclose(moved @ planar(12.0), planar(12.0), atol=1e-3)
    assert begins(graph)[1, 0, 3] == pytest.approx(4.0667, abs=1e-3)  # a third is taken back


def test_a_place_that_was_found_stays_where_it_is_when_the_robot_is_moved():
    drift, moved, robot = planar(1.0, 2.0, 0.1), planar(0.3, -0.2, 0.05), planar(20.0, 3.0, 1.0)
    found = Found(
        reason=Reason.ACCEPTED, drift=drift, covariance=np.eye(4), possible=(drift, planar(5.0))
    )
    after = found.seen_from(moved)
    np.testing.assert_allclose(after.drift @ moved @ robot, drift @ robot)
    np.testing.assert_allclose(after.possible[1] @ moved @ robot, planar(5.0) @ robot)


def test_motions_stay_rigid_however_many_loops_are_closed():
    """The robot's pose goes with each, and the next submap begins at it."""
    graph = SubmapGraph(Params())
    robot = planar(0.1, 0.2, 0.3)
    graph.begin(robot, np.eye(3))
    for number in range(1, 60):
        robot = robot @ planar(4.0, 0.0, 0.1)
        graph.follow(robot, COVARIANCE, 4.0)
        poses = graph.graph.poses
        measured = between(poses[0], poses[number]) + (0.05, 0.02, 0.003, 0.0)
        robot = graph.close([Edge(0, number, measured, 1e4 * np.eye(4), is_loop=True)]) @ robot
        turn = robot[:3, :3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
