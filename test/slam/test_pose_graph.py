# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pose graph: its group, exact small graphs, and loops that are wrong."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws
from scipy.optimize import least_squares

from heightmap25d_ros import se3
from heightmap25d_ros.slam.drift import carried
from heightmap25d_ros.slam.pose_graph import KEPT, Edge, PoseGraph, between, compose

POSES = st.tuples(
    st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1), st.floats(-5, 5)
).map(np.array)
INFORMATION = np.diag([100.0, 100.0, 1000.0, 100.0])


def matrix(pose):
    x, y, yaw, z = pose
    return se3.from_xyz_rpy([x, y, z, 0.0, 0.0, yaw])


def square(drift=0.0):
    """Five poses around a square of 10 m, the last one at the first; each side turns too far."""
    graph = PoseGraph()
    pose = np.zeros(4)
    graph.add(pose)
    side = np.array([10.0, 0.0, np.pi / 2 + drift, 0.0])
    for number in range(4):
        pose = compose(pose, side)
        graph.add(pose)
        graph.join(Edge(number, number + 1, side, INFORMATION, distance=10.0))
    return graph


@draws(50)
@given(POSES, POSES)
def test_between_and_compose_are_those_of_se3(first, second):
    relative = between(first, second)
    expected = se3.inverse(matrix(first)) @ matrix(second)
    np.testing.assert_allclose(matrix(relative), expected, atol=1e-9)
    np.testing.assert_allclose(matrix(compose(first, relative)), matrix(second), atol=1e-9)


def test_a_square_is_closed_and_the_error_is_shared():
    graph = square(drift=0.08)
    assert np.hypot(*graph.poses[4, :2]) > 1.0
    graph.join(Edge(0, 4, np.zeros(4), INFORMATION, is_loop=True))
    graph.optimise()
    np.testing.assert_allclose(graph.poses[0], np.zeros(4))
    assert np.hypot(*graph.poses[4, :2]) < 0.2
    turns = between(graph.poses[:4], graph.poses[1:])[:, 2]
    np.testing.assert_allclose(turns, np.pi / 2, atol=0.04)  # half of what each was off


def test_it_is_the_least_squares_of_scipy():
    graph = square(drift=0.05)
    graph.join(Edge(0, 4, np.array([0.1, 0.0, 0.02, 0.0]), INFORMATION))
    edges = list(graph.edges)

    def errors(free):
        poses = np.vstack([np.zeros(4), free.reshape(-1, 4)])
        found = []
        for edge in edges:
            error = between(poses[edge.first], poses[edge.second]) - edge.measured
            error[2] = np.angle(np.exp(1j * error[2]))
            found.append(np.sqrt(np.diag(INFORMATION)) * error)
        return np.concatenate(found)

    expected = least_squares(errors, graph.poses[1:].ravel(), xtol=1e-14, ftol=1e-14).x
    graph.optimise()
    turn = graph.poses[1:] - expected.reshape(-1, 4)
    turn[:, 2] = np.angle(np.exp(1j * turn[:, 2]))
    np.testing.assert_allclose(turn, 0.0, atol=1e-5)


def test_a_wrong_loop_does_not_bend_the_square():
    graph = square(drift=0.02)
    for first in (0, 1):
        measured = between(square().poses[first], square().poses[4])
        graph.join(Edge(first, 4, measured, INFORMATION, is_loop=True))
    graph.join(Edge(1, 3, np.array([2.0, -3.0, 0.0, 0.0]), INFORMATION, is_loop=True))
    graph.optimise()
    assert graph.weights[-1] < 0.01
    assert min(graph.weights[:-1]) > KEPT
    np.testing.assert_allclose(graph.poses[:, :2], square().poses[:, :2], atol=0.15)


def test_covariance_of_a_chain_is_that_of_its_sum():
    graph = PoseGraph()
    for number in range(4):
        graph.add(np.array([float(number), 0.0, 0.0, 0.0]))
        if number:
            step = np.array([1.0, 0.0, 0.0, 0.0])
            graph.join(Edge(number - 1, number, step, INFORMATION, distance=1.0))
    covariance = graph.covariance(0, 3)
    assert covariance[0, 0] == pytest.approx(3 / 100)
    assert covariance[2, 2] == pytest.approx(3 / 1000)
    # y: the turn at the first pose acts over 2 m, the one at the second over 1 m
    assert covariance[1, 1] == pytest.approx(3 / 100 + (2**2 + 1**2) / 1000)
    np.testing.assert_array_equal(graph.covariance(2, 2), np.zeros((4, 4)))


def test_covariances_are_those_of_each_pose_and_the_same_from_either_end():
    graph = square()
    graph.join(Edge(0, 4, np.zeros(4), INFORMATION, is_loop=True))
    graph.optimise()
    from_last = graph.covariances(4, range(5))
    np.testing.assert_allclose(from_last, [graph.covariance(4, k) for k in range(5)], rtol=1e-9)
    for number in range(4):
        apart = graph.poses[4, :2] - graph.poses[number, :2]
        seen = graph.covariance(number, 4)[:3, :3]
        np.testing.assert_allclose(carried(from_last[number, :3, :3], apart), seen, rtol=1e-6)


def test_distances_are_along_edges_and_loops():
    graph = square()
    np.testing.assert_allclose(graph.distances(4, np.inf), [40, 30, 20, 10, 0], atol=1e-4)
    graph.join(Edge(0, 4, np.zeros(4), INFORMATION, is_loop=True))
    np.testing.assert_allclose(graph.distances(4, np.inf), [0, 10, 20, 10, 0], atol=1e-4)
    assert np.isinf(graph.distances(4, 15.0)[2])


def test_parts_that_nothing_joins_stay_where_they_are():
    graph = square()
    for pose in square().poses + np.array([50.0, 0.0, 0.0, 0.0]):
        graph.add(pose)
    graph.join(Edge(5, 6, square().poses[1], INFORMATION, distance=10.0))
    assert np.isinf(graph.covariance(0, 6)).any()
    before = graph.poses
    graph.optimise()
    np.testing.assert_allclose(graph.poses, before, atol=1e-9)
    graph.join(Edge(4, 5, np.array([3.0, 0.0, 0.0, 0.0]), INFORMATION, is_loop=True))
    graph.optimise()
    np.testing.assert_allclose(graph.poses[5, :2], [3.0, 0.0], atol=1e-6)


def test_what_is_measured_again_is_where_it_was_put_until_a_loop_is_joined():
    graph = square(drift=0.1)
    known = {2: np.array([10.0, 10.0, np.pi, 0.2]), 3: np.array([0.0, 10.0, -np.pi / 2, 0.2])}
    before = graph.poses
    graph.measure_again(known)
    expected = before.copy()
    for number, pose in known.items():
        expected[number] = pose
    np.testing.assert_allclose(graph.poses, expected)
    graph.optimise()
    along = compose(known[3], np.array([10.0, 0.0, 0.0, 0.0]))
    graph.join(Edge(0, 1, np.zeros(4), INFORMATION, is_loop=True))
    loop = graph.edges[-1]
    graph.measure_again({1: along})
    np.testing.assert_allclose(loop.measured, graph.edges[-1].measured)
    for edge in graph.edges[:2]:
        np.testing.assert_allclose(
            edge.measured, between(graph.poses[edge.first], graph.poses[edge.second])
        )
