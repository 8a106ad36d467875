# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses in any frame become poses in the map, by odometry, corrections and transforms."""

from __future__ import annotations

from typing import Any

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.decode import Odometry, Transform
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.robot_pose import robot_pose
from heightmap25d_ros.pipelines.transform_buffer import Missing, TransformBuffer


class MapFrames:
    """The robot and other frames in the map.

    The pose of the odometry's frame in the map is that of the newest correction, or where there is
    none that of /tf, or where there is none either the identity.

    Parameters
    ----------
    params : Params
    dropped : Drops
    """

    def __init__(self, params: Params, dropped: Drops) -> None:
        self._map_frame = params.mapping.map_frame
        self._base_frame = params.intake.base_frame
        self._dropped = dropped
        self._T_map_odom: se3.Matrix | None = None
        self._T_odom_base: se3.Matrix | None = None
        self._odom_frame = ""
        # Apart, since /tf may have other frames between odometry and base.
        self._odometry = TransformBuffer(max_gap=params.intake.odom_gap)
        self._transforms = TransformBuffer(max_gap=params.intake.odom_gap, dropped=dropped)

    def take_odometry(self, message: Any) -> bool:
        """Take a pose of the robot, see `robot_pose`; whether it is used."""
        odometry = robot_pose(message, self._base_frame, self._dropped)
        if odometry is None:
            return False
        child, frame = odometry.child_frame_id, odometry.frame_id
        if child != self._base_frame:
            self._dropped.record(
                "odometry: of another frame", f"of {child!r}, not of {self._base_frame!r}"
            )
            return False
        self._odom_frame, self._T_odom_base = frame, odometry.T
        stamped = Transform(parent=frame, child=child, stamp_ns=odometry.stamp_ns, T=odometry.T)
        if frame != child:
            self._odometry.add([stamped])
        return True

    def take_correction(self, message: Any) -> None:
        """Take a geometry_msgs/PoseWithCovarianceStamped: the pose of odom in the map."""
        frame = self._map_frame
        T = self._dropped.decoded("correction", lambda m: decode.pose_in(m, frame), message)
        if T is not None:
            self._T_map_odom = T

    def take_transforms(self, message: Any, *, is_static: bool) -> None:
        """Take a tf2_msgs/TFMessage of /tf or of /tf_static."""
        self._transforms.take(message, is_static=is_static)

    def robot(self) -> se3.Matrix | None:
        """Newest pose (4, 4) of the robot in the map; None before the first odometry."""
        return None if self._T_odom_base is None else self._odom_in_map() @ self._T_odom_base

    def in_map(self, pose: Odometry) -> se3.Matrix | Missing:
        """A pose (4, 4) of any frame in the map, at its stamp; of stamp 0: by the newest poses."""
        if pose.frame_id == self._map_frame:
            return pose.T
        T_odom_frame = self._in_odom(pose.frame_id, pose.stamp_ns)
        if T_odom_frame is None:
            T = _looked_up(self._transforms, self._map_frame, pose.frame_id, pose.stamp_ns)
            return T if isinstance(T, Missing) else T @ pose.T
        if isinstance(T_odom_frame, Missing):
            return T_odom_frame
        return self._odom_in_map() @ T_odom_frame @ pose.T

    def unconnected(self, pose: Odometry, missing: Missing) -> str:
        """In words, why `in_map` has none."""
        of = f"no transform from {pose.frame_id!r} to {self._map_frame!r}"
        if missing is Missing.UNCONNECTED:
            return of
        return f"{of} at {pose.stamp_ns * 1e-9:.3f} s: that is {missing.value} those that are known"

    def _odom_in_map(self) -> se3.Matrix:
        if self._T_map_odom is not None:
            return self._T_map_odom
        T = _looked_up(self._transforms, self._map_frame, self._odom_frame, 0)
        return np.eye(4) if isinstance(T, Missing) else T

    def _in_odom(self, frame: str, stamp_ns: int) -> se3.Matrix | Missing | None:
        """Pose (4, 4) of a frame in that of the odometry; None where these are not connected."""
        base, odom, transforms = self._base_frame, self._odom_frame, self._transforms
        if frame == odom:
            return np.eye(4)
        if self._T_odom_base is not None and transforms.is_connected(base, frame):
            T_odom_base = _looked_up(self._odometry, odom, base, stamp_ns)
            T_base_frame = _looked_up(transforms, base, frame, stamp_ns)
            if isinstance(T_odom_base, Missing):
                return T_odom_base
            return T_base_frame if isinstance(T_base_frame, Missing) else T_odom_base @ T_base_frame
        if odom and transforms.is_connected(odom, frame):
            return _looked_up(transforms, odom, frame, stamp_ns)
        return None


def _looked_up(
    buffer: TransformBuffer, target: str, source: str, stamp_ns: int
) -> se3.Matrix | Missing:
    """Pose (4, 4) of the source in the target at a stamp, or the newest one for stamp 0."""
    stamp = stamp_ns or buffer.newest_stamp(target, source) or 0
    T = buffer.lookup(target, source, np.array([stamp]))
    return T if isinstance(T, Missing) else np.asarray(T[0])
