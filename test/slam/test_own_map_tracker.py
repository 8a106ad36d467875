# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drives, the poses that come of them, and what is kept for these to be refined."""

import level_scans
import numpy as np
from landmark_worlds import ROOM, beams_to, ground_returns, wall_returns

from heightmap25d_ros import se3
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.own_map_tracker import OwnMapTracker

SCAN_NS = 13_000_000


def test_walls_are_kept_of_where_the_drive_begins_though_the_first_scans_are_of_the_ground():
    """Which way the frame looks is known as well as the walls that were seen from there."""
    rng, tracker = np.random.default_rng(1), OwnMapTracker(Params())
    for number in range(30):
        is_wall = number > 3 and number % 2
        ends = wall_returns(rng, 180, ROOM) if is_wall else ground_returns(rng, 180)
        tracker.integrate(beams_to(ends), np.eye(4), number * SCAN_NS)
    assert any((keyframe.returns[:, 2] > 0.1).sum() > 100 for keyframe in tracker.keyframes)


def test_where_odometry_runs_on_as_the_robot_drives_back_the_poses_are_those_of_the_robot():
    """With level lasers, whose frames of odometry differ from scan to scan."""
    x = np.concatenate([np.arange(0.0, 1.55, 0.1), np.arange(1.4, 0.05, -0.1)])
    along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x)))])
    told = np.array([level_scans.planar(way, 0.0, 0.0) for way in along])
    tracker = OwnMapTracker(Params())
    for number, (true, pose) in enumerate(zip(x, told, strict=True)):
        beams = level_scans.scan(level_scans.ROOM, (true, 0.0, 0.0), pose)
        tracker.integrate(beams, pose, number * 200_000_000)
        found = tracker.T_map_wheels @ pose
        np.testing.assert_allclose(found[:2, 3], (true, 0.0), atol=0.05)
    tracker.finish()
    poses = np.array([pose.T_map_odom for pose in tracker.poses()]) @ told
    np.testing.assert_allclose(poses[:, 0, 3], x, atol=0.05)
    np.testing.assert_allclose(se3.to_xyz_rpy(poses)[:, 5], 0.0, atol=0.02)


def test_odometry_that_jumps_leaves_the_robot_where_it_was():
    tracker = OwnMapTracker(Params())
    room, jumped = level_scans.ROOM, level_scans.planar(5.0, -2.0, 1.0)
    tracker.integrate(level_scans.scan(room, (0.0, 0.0, 0.0), np.eye(4)), np.eye(4), 0)
    tracker.mend(tracker.T_map_wheels @ se3.inverse(jumped))
    for number in range(1, 6):
        told = jumped @ level_scans.planar(0.1 * number, 0.0, 0.0)
        beams = level_scans.scan(room, (0.1 * number, 0.0, 0.0), told)
        tracker.integrate(beams, told, number * 200_000_000)
    np.testing.assert_allclose((tracker.T_map_wheels @ told)[:2, 3], (0.5, 0.0), atol=0.02)
