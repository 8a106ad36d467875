# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The subscriptions from which a node learns where the robot is: odometry, poses or transforms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

from heightmap25d_ros.io import decode
from heightmap25d_ros.nodes import qos
from heightmap25d_ros.nodes.interface import Input
from heightmap25d_ros.params.sections import IntakeParams
from heightmap25d_ros.pipelines.input_watch import Flatness
from heightmap25d_ros.pipelines.robot_pose import TransformPoses

_TYPES = {
    "odometry": Odometry,
    "pose": PoseStamped,
    "pose_with_covariance": PoseWithCovarianceStamped,
}


def pose_inputs(
    params: IntakeParams,
    take_pose: Callable[[Any], None],
    take_transforms: Callable[[Any, bool], None],
    flatness: Flatness,
) -> list[Input]:
    """The topic ``odom`` in its type, /tf and /tf_static; or the latter as the source of poses.

    Parameters
    ----------
    params : IntakeParams
    take_pose : callable
        Takes what `robot_pose` takes.
    take_transforms : callable
        Takes a TFMessage, and whether it is static.
    flatness : Flatness
        Looks at each pose.
    """

    def take_observed(pose: Any) -> None:
        _observe(flatness, pose)
        take_pose(pose)

    poses = TransformPoses(params) if params.pose_source == "tf" else None

    def take(message: Any, is_static: bool) -> None:
        take_transforms(message, is_static)
        if poses is not None:
            for pose in poses.take(message, is_static=is_static):
                take_observed(pose)

    topics = [
        Input(
            TFMessage, "/tf", lambda m: take(m, False), qos.POSES, is_needed=poses is not None
        ),
        Input(TFMessage, "/tf_static", lambda m: take(m, True), qos.STATIC_TRANSFORMS),
    ]  # fmt: skip
    if poses is None:
        kind = _TYPES[params.pose_source]
        topics.insert(0, Input(kind, "odom", take_observed, qos.POSES, is_needed=True))
    return topics


def _observe(flatness: Flatness, pose: Any) -> None:
    """Look at a pose of any of the types."""
    if isinstance(pose, decode.Odometry):
        flatness.observe(pose.T[2, 3], pose.T[0, 2], pose.T[1, 2])
    else:
        pose = getattr(pose.pose, "pose", pose.pose)
        flatness.observe(pose.position.z, pose.orientation.x, pose.orientation.y)
