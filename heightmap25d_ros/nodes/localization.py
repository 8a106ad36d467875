# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The localization node: scans, odometry and a long-term map in, the pose of odom in it out."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from heightmap25d_msgs.msg import HeightGrid, LocalizationStatus
from heightmap25d_ros.io import encode, layers_file, map_directory
from heightmap25d_ros.localization.tracker import Attempt
from heightmap25d_ros.localization.tracking_state import State
from heightmap25d_ros.nodes import qos, runtime
from heightmap25d_ros.nodes.lifecycle import ManagedNode
from heightmap25d_ros.pipelines.localization import Localizer, Pose, compile_kernels


class LocalizationNode(ManagedNode):
    """Thin: hands messages to `Localizer`, and publishes what it makes of them.

    Poses are published as odometry comes, ``transform_rate`` times a second of its time, and
    when a registration was made.
    """

    def __init__(self) -> None:
        super().__init__("localization")

    def set_up(self) -> None:
        """Make the localizer, with the map of a directory, and what tells of the pose."""
        self._frame = self.params.mapping.map_frame
        self._localizer = Localizer(self.params)
        self._state = State.DEGRADED
        self._last: Attempt | None = None
        self._period = self._published_ns = 0
        directory = self.params.localization.map_directory
        if directory:
            threshold = self.params.mapper.probability_threshold
            height_map = map_directory.load_in(Path(directory), threshold, self._frame)
            layers = layers_file.load(Path(directory), height_map)
            self._localizer.set_long_term(height_map, layers)
        compile_kernels(self.params)
        self._correction_publisher = self.create_lifecycle_publisher(
            PoseWithCovarianceStamped, "pose_correction", 10
        )
        self._pose_publisher = self.create_lifecycle_publisher(
            PoseWithCovarianceStamped, "pose", 10
        )
        self._transform_publisher = self.create_lifecycle_publisher(TFMessage, "/tf", 100)
        self._grid_publisher = self.create_lifecycle_publisher(
            HeightGrid, "short_term_grid", qos.LATCHED
        )
        self._status_publisher = self.create_lifecycle_publisher(
            LocalizationStatus, "~/status", qos.LATCHED
        )

    def start(self) -> None:
        """Hear the robot, and publish."""
        for topic in self.params.intake.scan_topics:
            self.subscribe(LaserScan, topic, self._on_scan_of(topic), qos.SCANS, is_needed=True)
        self.subscribe(Odometry, "odom", self._on_odometry, 100, is_needed=True)
        self.subscribe(PoseWithCovarianceStamped, "initialpose", self._on_initial_pose, 10)
        self.subscribe(TFMessage, "/tf", self._on_transforms, 100)
        self.subscribe(TFMessage, "/tf_static", self._on_static_transforms, qos.STATIC_TRANSFORMS)
        if not self.params.localization.map_directory:
            self.subscribe(
                HeightGrid, "long_term_grid", self._localizer.take_long_term, qos.LATCHED,
                is_needed=True,
            )  # fmt: skip
        self.create_service(Trigger, "~/relocalize", self._relocalize)
        self._publish_status(self._last)

    def take_params(self) -> None:
        """Go on with other parameters."""
        self._localizer.set_params(self.params)

    @property
    def dropped(self) -> Counter[str]:
        """How many messages were not used, by reason."""
        return self._localizer.dropped

    def trouble(self) -> str:
        """Where the robot is lost, nobody should rely on the pose."""
        return "the robot is lost" if self._localizer.state is State.LOST else ""

    def figures(self) -> dict[str, Any]:
        """What /diagnostics tells of the pose."""
        figures: dict[str, Any] = {"localization": self._localizer.state.name}
        if self._last is not None:
            found, (position, yaw) = self._last.registration, self._last.deviation
            figures |= {
                "last registration": f"{self._last.kind.value}: {found.reason.value}",
                "overlap": round(found.overlap, 2),
                "residual [m]": round(found.residual, 3),
                "deviation of position [m]": round(position, 3),
                "deviation of yaw [rad]": round(yaw, 4),
            }
        return figures

    def _on_scan_of(self, topic: str) -> Callable[[LaserScan], None]:
        return lambda message: self._publish(self._localizer.take_scan(topic, message))

    def _on_transforms(self, message: TFMessage) -> None:
        self._publish(self._localizer.take_transforms(message, is_static=False))

    def _on_static_transforms(self, message: TFMessage) -> None:
        self._publish(self._localizer.take_transforms(message, is_static=True))

    def _on_odometry(self, message: Odometry) -> None:
        self._publish(self._localizer.take_odometry(message))

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        self._localizer.take_initial_pose(message)
        self._publish_status(None)

    def _publish(self, attempts: list[Attempt]) -> None:
        for attempt in attempts:
            self._last = attempt
            self._publish_status(attempt)
        if attempts and self._grid_publisher.get_subscription_count():
            self._publish_short_term(attempts[-1])
        pose = self._localizer.pose
        if pose is None:
            return
        # Periods are counted from zero: so the rate holds on average, whatever odometry's is.
        period = int(pose.stamp_ns * 1e-9 * self.params.localization.transform_rate)
        if period != self._period or (attempts and pose.stamp_ns != self._published_ns):
            self._period, self._published_ns = period, pose.stamp_ns
            self._publish_pose(pose)

    def _publish_pose(self, pose: Pose) -> None:
        for publisher, T in (
            (self._correction_publisher, pose.T_map_odom),
            (self._pose_publisher, pose.T_map_base),
        ):
            message = PoseWithCovarianceStamped()
            encode.fill_pose(message, T, pose.covariance, pose.stamp_ns, self._frame)
            publisher.publish(message)
        transform = TransformStamped()
        ahead = round(self.params.localization.transform_tolerance * 1e9)
        encode.fill_transform(
            transform, pose.T_map_odom, pose.stamp_ns + ahead, self._frame, pose.odom_frame
        )
        self._transform_publisher.publish(TFMessage(transforms=[transform]))

    def _publish_short_term(self, attempt: Attempt) -> None:
        height_map, pose = self._localizer.short_term_map(), self._localizer.pose
        if height_map is not None and pose is not None:
            message = HeightGrid()
            encode.fill_height_grid(message, height_map, attempt.stamp_ns, pose.odom_frame)
            self._grid_publisher.publish(message)

    def _publish_status(self, attempt: Attempt | None) -> None:
        """Of an attempt; None: of a pose that was said from outside, or of the beginning."""
        state = self._localizer.state
        message: Any = LocalizationStatus(state=int(state), reason="no registration yet")
        stamp = self._localizer.stamp_ns if attempt is None else attempt.stamp_ns
        encode.fill_header(message.header, stamp, self._frame)
        if attempt is not None:
            found = attempt.registration
            message.reason = f"{attempt.kind.value}: {found.reason.value}"
            message.position_deviation, message.yaw_deviation = attempt.deviation
            message.overlap, message.residual = found.overlap, found.residual
            message.ratio = found.ratio
        self._status_publisher.publish(message)
        if state is not self._state:
            self.get_logger().warning(f"{self._state.name} -> {state.name}; {message.reason}")
            self._state = state

    def _relocalize(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._localizer.request_search()
        response.message = (
            "the search begins with the next short-term map; see ~/status"
            if response.success
            else "there is no long-term map yet"
        )
        return response


def main() -> int:
    """Run the node."""
    return runtime.run(LocalizationNode)


if __name__ == "__main__":
    sys.exit(main())
