# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robot's poses from odometry, poses and transforms: the same map of all of them."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from bag_writer import odometry, rosbags_type, tf_message, write_bag
from repository import BAGS

from heightmap25d_ros import cli
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.sections import IntakeParams
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.robot_pose import TransformPoses, robot_pose

START, MS = 10**18, 10**6
STILL = (0.0, 0.0, 0.0, 1.0)


def test_an_empty_child_frame_is_taken_for_the_base_with_one_notice():
    dropped = Drops()
    for stamp in range(3):
        pose = robot_pose(odometry(START + stamp, child_frame_id=""), "base_link", dropped)
        assert (pose.frame_id, pose.child_frame_id) == ("odom", "base_link")
    assert not dropped
    assert dropped.new_notices() == ["child_frame_id of the odometry is empty: taken for "
                                     "'base_link'"]  # fmt: skip
    assert dropped.new_notices() == []
    assert robot_pose(odometry(START, child_frame_id="camera"), "base_link", dropped) is not None
    assert robot_pose(odometry(START, (math.nan, 0.0, 0.0)), "base_link", dropped) is None
    assert dropped == {"odometry: bad pose.pose": 1}
    assert dropped.new_notices() == []


def test_poses_are_those_of_the_base():
    message = odometry(START, (1.0, 2.0, 3.0), frame_id="/odom")
    stamped = SimpleNamespace(header=message.header, pose=message.pose.pose)
    with_covariance = SimpleNamespace(header=message.header, pose=message.pose)
    dropped = Drops()
    expected = robot_pose(message, "base_link", dropped)
    for other in (stamped, with_covariance, expected):
        pose = robot_pose(other, "base_link", dropped)
        assert (pose.stamp_ns, pose.frame_id, pose.child_frame_id) == (START, "odom", "base_link")
        np.testing.assert_array_equal(pose.T, expected.T)
    assert not dropped
    assert not dropped.notices


def taken(poses, *transforms, is_static=False):
    message = tf_message(*((s, p, c, xyz, STILL) for s, p, c, xyz in transforms))
    return [(p.stamp_ns, p.T[:3, 3].tolist()) for p in poses.take(message, is_static=is_static)]


def test_transforms_between_odometry_and_base_become_poses_once_all_are_known():
    poses = TransformPoses(IntakeParams())
    footprint = "odom", "base_footprint"
    assert taken(poses, (START, *footprint, (1.0, 0.0, 0.0))) == []  # not connected yet
    assert taken(poses, (START, "base_link", "laser", (0.0, 0.0, 9.0)), is_static=True) == []
    mount = 0, "base_footprint", "base_link", (0.0, 0.0, 0.5)
    later = (START + 10 * MS, *footprint, (2.0, 0.0, 0.0))
    assert taken(poses, mount, is_static=True) in ([], [(START, [1.0, 0.0, 0.5])])
    assert taken(poses, later)[-1] == (START + 10 * MS, [2.0, 0.0, 0.5])
    # What is not on the way is no pose of the robot; localization's map -> odom is not, either.
    assert taken(poses, (START + 20 * MS, "map", "odom", (9.0, 9.0, 9.0))) == []
    assert taken(poses, (START + 20 * MS, "base_link", "wheel", (0.0, 0.0, 0.0))) == []
    assert taken(poses, later) == [(START + 10 * MS, [2.0, 0.0, 0.5])]


def test_a_pose_waits_for_the_slower_transform_of_its_chain():
    poses = TransformPoses(IntakeParams())
    first = (START, "odom", "a", (1.0, 0.0, 0.0)), (START, "a", "base_link", (0.0, 0.0, 0.0))
    assert taken(poses, *first) == [(START, [1.0, 0.0, 0.0])]
    assert taken(poses, (START + 50 * MS, "odom", "a", (2.0, 0.0, 0.0))) == []
    assert taken(poses, (START + 100 * MS, "a", "base_link", (0.0, 1.0, 0.0))) == [
        (START + 50 * MS, [2.0, 0.5, 0.0])
    ]


@pytest.fixture(scope="module")
def part_of_the_ramp(tmp_path_factory):
    """Four seconds of bags/ramp with its odometry on further topics, and the map of /odom."""
    directory = tmp_path_factory.mktemp("poses")
    pose_type, with_covariance_type = (
        rosbags_type(f"geometry_msgs/msg/{name}")
        for name in ("PoseStamped", "PoseWithCovarianceStamped")
    )
    events = []
    with Bag(BAGS / "ramp") as bag:
        for event in bag.events(["/scan", "/scan_down", "/odom", "/tf", "/tf_static"]):
            if event.stamp_ns > bag.start_ns + 4_000 * MS:
                break
            events.append((event.topic, event.stamp_ns, event.message))
            if event.topic == "/odom":
                header, pose = event.message.header, event.message.pose
                events += [
                    ("/pose", event.stamp_ns, pose_type(header=header, pose=pose.pose)),
                    ("/amcl", event.stamp_ns, with_covariance_type(header=header, pose=pose)),
                ]
    bag = write_bag(directory / "bag", events)
    return bag, mapped(bag, directory / "odom")


def mapped(bag, directory, *options):
    assert cli.main(["map", str(bag), "-o", str(directory), *options]) == 0
    return map_directory.load(directory, 0.5).height_map


@pytest.mark.parametrize("topic", ["/pose", "/amcl", "/tf"])
def test_the_map_is_the_same_from_whatever_the_poses_come(part_of_the_ramp, tmp_path, topic):
    bag, expected = part_of_the_ramp
    found = mapped(bag, tmp_path / "map", "--odom-topic", topic)
    assert expected.known.sum() > 1000
    np.testing.assert_array_equal(found.known, expected.known)
    np.testing.assert_array_equal(found.height[found.known], expected.height[expected.known])


def test_the_pose_source_of_the_parameters_names_the_topic(part_of_the_ramp, tmp_path):
    bag, expected = part_of_the_ramp
    file = tmp_path / "params.yaml"
    file.write_text("mapping:\n  ros__parameters:\n    intake:\n      pose_source: tf\n")
    found = mapped(bag, tmp_path / "map", "--params", str(file))
    np.testing.assert_array_equal(found.known, expected.known)
