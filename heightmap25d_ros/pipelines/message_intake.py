# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, readings out: what mapping and localization both begin with."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any, TypeVar

from heightmap25d_ros import se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.decode import Odometry
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.scan_queue import Reading, ScanIntake

_Value = TypeVar("_Value")


class MessageIntake:
    """A `ScanIntake` that takes messages, by duck type.

    Each ``take_...`` returns the readings that the message completed. A bad message is counted
    and changes nothing.

    Parameters
    ----------
    params : Params
    """

    def __init__(self, params: Params) -> None:
        self._params = params
        self._intake = ScanIntake(params.intake)
        self._malformed: Counter[str] = Counter()

    @property
    def dropped(self) -> Counter[str]:
        """How many messages were not used, by reason."""
        return self._malformed + self._intake.dropped

    @property
    def odometry(self) -> Odometry | None:
        """The pose of the robot that was taken last."""
        return self._intake.odometry

    def take_scan(self, topic: str, message: Any) -> list[Reading]:
        """Take a sensor_msgs/LaserScan of one of ``intake.scan_topics`` in."""
        scan = self.decode("scan", decode.scan, message)
        return [] if scan is None else self._intake.add_scan(topic, scan)

    def take_odometry(self, message: Any) -> list[Reading]:
        """Take a nav_msgs/Odometry in."""
        odometry = self.decode("odometry", decode.odometry, message)
        return [] if odometry is None else self._intake.add_odometry(odometry)

    def take_transforms(self, message: Any, *, is_static: bool) -> list[Reading]:
        """Take a tf2_msgs/TFMessage of /tf or of /tf_static in."""
        transforms = self.decode("transforms", decode.transforms, message)
        if transforms is None:
            return []
        return self._intake.add_transforms(transforms, is_static=is_static)

    def take_pose(self, kind: str, message: Any) -> se3.Matrix | None:
        """Pose (4, 4) of a geometry_msgs/PoseWithCovarianceStamped in the map frame, if it is."""
        if message.header.frame_id.lstrip("/") != self._params.mapping.map_frame:
            self._malformed[f"{kind}: not in {self._params.mapping.map_frame!r}"] += 1
            return None
        return self.decode(kind, lambda m: decode.pose(m.pose.pose, "pose"), message)

    def set_correction(self, T_map_odom: se3.Matrix) -> None:
        """Pose (4, 4) of the odometry's frame in the map, for all readings from now on."""
        self._intake.set_correction(T_map_odom)

    def settle(self) -> list[Reading]:
        """What has its poses now, without waiting for the other lasers."""
        return self._intake.settle()

    def flush(self) -> list[Reading]:
        """No more messages will come: what is ready; the rest is dropped."""
        return self._intake.flush()

    def decode(self, kind: str, read: Callable[[Any], _Value], message: Any) -> _Value | None:
        """What is read from a message; None, and counted, where it is malformed."""
        try:
            return read(message)
        except InputError as error:
            field = str(error).partition(":")[0]
            self._malformed[f"{kind}: bad {field}"] += 1
            return None
