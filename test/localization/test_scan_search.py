# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The place around a wrong pose where the returns of a moment fit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from landmark_worlds import CORRIDOR, ROOM, ground_returns, landmarks_seen_by, wall_returns

from heightmap25d_ros import se3
from heightmap25d_ros.localization.odometry_errors import unknown_errors
from heightmap25d_ros.localization.registration import Reason, rejected
from heightmap25d_ros.localization.scan_filter import ScanFilter
from heightmap25d_ros.localization.scan_proposal import Proposal
from heightmap25d_ros.localization.scan_search import find_place
from heightmap25d_ros.localization.surface import Surface
from heightmap25d_ros.params.sections import Params

PARAMS = Params()
NO_SURFACE = Surface(np.zeros((1, 1), np.float32), np.zeros((1, 1), bool), (0.0, 0.0), 0.125)
# A corner behind which nothing repeats.
CROOKED = (*ROOM, ((0.5, -1.2), (0.5, -0.4)), ((-1.6, 0.3), (-1.0, 1.3)))


def world(walls):
    rng = np.random.default_rng(1)
    return landmarks_seen_by(
        ground_returns(rng, 40000, noise=0.01), wall_returns(rng, 20000, walls, noise=0.01)
    )


def inside(walls):
    """Returns (N, 3) [m, map] of walls and ground, on the robot's side of the end walls."""
    rng = np.random.default_rng(2)
    ends = np.concatenate([
        ground_returns(rng, 200, half=(3.0, 1.1), noise=0.01),
        wall_returns(rng, 800, walls, noise=0.01),
    ])  # fmt: skip
    return ends[np.abs(ends[:, 0]) < 4.0]


@pytest.fixture(scope="module")
def crooked():
    return world(CROOKED)


@given(x=st.floats(-1.0, 1.0), y=st.floats(-1.0, 1.0), yaw=st.floats(-0.3, 0.3))
def test_the_place_is_found_however_far_the_pose_is_off(crooked, x, y, yaw):
    told = se3.from_xyz_rpy([0.2 - x, 0.1 - y, 0.0, 0.0, 0.0, -yaw])
    true = se3.from_xyz_rpy([0.2, 0.1, 0.0, 0.0, 0.0, 0.0])
    position = told[:3, 3]
    seen = se3.transform_points(told @ se3.inverse(true), inside(CROOKED)) - position
    found = find_place(seen, position, crooked, radius=1.5, turn=0.4)
    assert found is not None
    assert np.abs(found[:2] - (x, y)).max() <= 0.1
    assert abs(found[2] - yaw) <= 0.04


def test_along_a_corridor_no_place_is_the_only_one():
    seen = inside(CORRIDOR)
    assert find_place(seen, np.zeros(3), world(CORRIDOR), radius=1.5, turn=0.3) is None


def test_a_place_beyond_the_circle_is_not_found(crooked):
    position = np.array([2.0, 0.0, 0.0])  # told; the robot is at 0, 0
    assert find_place(inside(CROOKED), position, crooked, radius=0.8, turn=0.2) is None
    assert find_place(inside(CROOKED), position, crooked, radius=2.5, turn=0.2) is not None


@pytest.mark.parametrize("count", [0, 1, 39])
def test_few_returns_tell_no_place(crooked, count):
    seen = inside(CROOKED)
    walls = seen[seen[:, 2] > 0.15][:count]
    assert find_place(walls, np.zeros(3), crooked, radius=1.0, turn=0.2) is None


def test_a_map_without_walls_tells_no_place():
    flat = landmarks_seen_by(ground_returns(np.random.default_rng(1), 20000))
    assert find_place(inside(CROOKED), np.zeros(3), flat, radius=1.0, turn=0.2) is None


def update(overlap, residual):
    """An update that was accepted at the wrong pose."""
    unknown = rejected(Reason.ACCEPTED, 500)
    return dataclasses.replace(unknown, known=overlap, overlap=overlap, residual=residual)


CONTRADICTED = rejected(Reason.LITTLE_OVERLAP, 500)
POOR, CLEAR = update(0.7, 0.03), update(0.9, 0.02)


@pytest.mark.parametrize(
    ("found", "is_looked_for"), [(CONTRADICTED, True), (POOR, True), (CLEAR, False)],
    ids=["contradicted", "a poor fit", "a clear fit"],
)  # fmt: skip
def test_a_robot_that_went_back_in_place_of_forth_is_found(crooked, found, is_looked_for):
    """The odometry told 0.6 m forth: the pose is 1.2 m off."""
    told = se3.from_xyz_rpy([0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
    true = se3.from_xyz_rpy([-0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
    covariance = np.diag(np.square([0.05, 0.05, 0.03]))
    estimate = ScanFilter(PARAMS, np.eye(4), covariance, unknown_errors(PARAMS))
    returns = se3.transform_points(told @ se3.inverse(true), inside(CROOKED))
    proven = Proposal(estimate, found, told, returns, 0.6).proven(None, NO_SURFACE, crooked, PARAMS)
    assert (proven is not None) == is_looked_for
    if proven is None:
        return
    assert np.abs((proven.estimate.T_map_odom @ told)[:2, 3] - true[:2, 3]).max() < 0.02
    assert proven.estimate.deviation[0] < 0.1
