# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The localization node: scans, odometry and a long-term map in, the pose of odom in it out."""

from __future__ import annotations

import pathlib
import sys
from dataclasses import replace
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from heightmap25d_msgs.msg import HeightGrid, LocalizationLayers, LocalizationStatus
from heightmap25d_ros.io import encode, layers_file, map_directory
from heightmap25d_ros.localization.tracker import Attempt
from heightmap25d_ros.localization.tracking_state import State
from heightmap25d_ros.nodes import qos, runtime
from heightmap25d_ros.nodes.cloud_source import cloud_inputs
from heightmap25d_ros.nodes.interface import Input, Output, Service
from heightmap25d_ros.nodes.lifecycle import ManagedNode
from heightmap25d_ros.nodes.pose_source import pose_inputs
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.input_watch import InputWatch
from heightmap25d_ros.pipelines.localization import Localizer, Pose, compile_kernels
from heightmap25d_ros.pipelines.silence import CHECKS

_SEARCH_SLICE = 0.01  # [s] of a search between two scans


class LocalizationNode(ManagedNode):
    """Hands messages to `Localizer`, and publishes the pose.

    Poses are published as odometry comes, ``transform_rate`` times a second of its time, and
    when a registration was made. The status is published then, when the state changes, and a few
    times per ``intake.timeout`` of the node's clock, so that others notice a node that stands.
    """

    NAME = "localization"
    PARAMETERS = (
        "grid",
        "sensor",
        "mapper",
        "intake",
        "cloud",
        "odometry",
        "short_term",
        "registration",
        "localization",
        "scan_filter",
        "slam",
        "mapping.map_frame",
    )

    def inputs(self) -> list[Input]:
        """Lasers, clouds, poses, transforms; the long-term map where it is from no directory."""
        scans = [
            Input(LaserScan, topic, partial(self._on_scan, topic), qos.SCANS, is_needed=True)
            for topic in self.params.intake.scan_topics
        ]
        settings = self.params.localization
        long_term = [
            Input(
                HeightGrid, "long_term_grid", self._localizer.take_long_term, qos.LATCHED,
                is_needed=True,
            ),
            Input(
                LocalizationLayers, "long_term_layers", self._localizer.take_long_term_layers,
                qos.LATCHED,
            ),
        ]  # fmt: skip
        return [
            *scans,
            *cloud_inputs(self.params, self._on_cloud),
            *pose_inputs(self.params.intake, self._on_odometry, self._on_transforms, self.flatness),
            Input(PoseWithCovarianceStamped, "initialpose", self._on_initial_pose, qos.QUEUE),
            *([] if settings.map_directory or settings.own_map else long_term),
        ]

    def outputs(self) -> list[Output]:
        """The pose in three forms, what is registered, how sure the pose is, and its own map."""
        return [
            Output(PoseWithCovarianceStamped, "pose_correction", qos.QUEUE),
            Output(PoseWithCovarianceStamped, "pose", qos.QUEUE),
            Output(TFMessage, "/tf", qos.POSES),
            Output(HeightGrid, "short_term_grid", qos.LATCHED),
            Output(LocalizationStatus, "~/status", qos.LATCHED),
            Output(Path, "~/submaps", qos.LATCHED),
        ]

    def offered_services(self) -> list[Service]:
        """The search of the whole map."""
        return [Service(Trigger, "~/relocalize", self._relocalize)]

    def set_up(self) -> None:
        """Make the localizer, with the long-term map where it comes from a directory."""
        self._frame = self.params.mapping.map_frame
        self._localizer = Localizer(self.params, _SEARCH_SLICE)
        self._state = State.DEGRADED
        self._last: Attempt | None = None
        self._period = self._published_ns = 0
        self._map_version = self._localizer.map_version
        directory = self.params.localization.map_directory
        if directory:
            threshold = self.params.mapper.probability_threshold
            path = pathlib.Path(directory)
            height_map = map_directory.load_in(path, threshold, self._frame)
            layers = layers_file.load(path, height_map)
            self._localizer.set_long_term(height_map, layers)
        compile_kernels(self.params)

    def start(self) -> None:
        """Publish the state at the start, and now and then."""
        self._publish_status()
        self.create_timer(self.params.intake.timeout / CHECKS, self._pass_time)

    def take_params(self) -> None:
        """Apply new parameters; the pose is kept."""
        self._localizer.set_params(self.params)

    @property
    def dropped(self) -> Drops:
        """How many messages were not used, by reason."""
        return self._localizer.dropped

    @property
    def watch(self) -> InputWatch:
        """What was noticed about scans and poses."""
        return self._localizer.watch

    def trouble(self) -> str:
        """Where the robot is lost, nobody should rely on the pose."""
        return "the robot is lost" if self._localizer.state is State.LOST else ""

    def figures(self) -> dict[str, Any]:
        """What /diagnostics reports of the pose."""
        figures: dict[str, Any] = {"localization": self._localizer.state.name}
        if self._localizer.lapse:
            figures["lapse"] = self._localizer.lapse
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

    def _on_scan(self, topic: str, message: LaserScan) -> None:
        self._publish(self._localizer.take_scan(topic, message))

    def _on_cloud(self, topic: str, message: Any) -> None:
        self._publish(self._localizer.take_cloud(topic, message))

    def _on_transforms(self, message: TFMessage, is_static: bool) -> None:
        self._publish(self._localizer.take_transforms(message, is_static=is_static))

    def _on_odometry(self, message: Any) -> None:
        self._publish(self._localizer.take_odometry(message))

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        self._localizer.take_initial_pose(message)
        self._last = None
        self._publish_status()

    def _pass_time(self) -> None:
        self._localizer.pass_time(self.get_clock().now().nanoseconds)
        self._publish_status()

    def _publish_submaps(self) -> None:
        """Before the pose that goes with them, so that mapping has moved its map by then."""
        version = self._localizer.map_version
        if version == self._map_version or not version[1]:
            return
        self._map_version = version
        message = Path()
        encode.fill_path(
            message, PoseStamped, self._localizer.submap_poses(), version[0], self._frame
        )
        self.publish("~/submaps", message)

    def _publish(self, attempts: list[Attempt]) -> None:
        self._publish_submaps()
        for attempt in attempts:
            self._last = attempt
            self._publish_status()
        if self._localizer.state is not self._state:
            self._publish_status()
        if attempts and self.has_subscribers("short_term_grid"):
            self._publish_short_term(attempts[-1])
        stamp_ns = self._localizer.stamp_ns
        # Periods are counted from zero: so the rate holds on average, whatever odometry's is.
        period = int(stamp_ns * 1e-9 * self.params.localization.transform_rate)
        if period == self._period and not (attempts and stamp_ns != self._published_ns):
            return
        pose = self._localizer.pose
        if pose is not None:
            self._period, self._published_ns = period, stamp_ns
            self._publish_pose(pose)

    def _publish_pose(self, pose: Pose) -> None:
        """Where somebody listens: rclpy converts a message also where it is for nobody."""
        for topic, T in (("pose_correction", pose.T_map_odom), ("pose", pose.T_map_base)):
            if self.has_subscribers(topic):
                message = PoseWithCovarianceStamped()
                encode.fill_pose(
                    message, T, pose.covariance, pose.vertical, pose.stamp_ns, self._frame
                )
                self.publish(topic, message)
        if not self.has_subscribers("/tf"):
            return
        transform = TransformStamped()
        ahead = round(self.params.localization.transform_tolerance * 1e9)
        encode.fill_transform(
            transform, pose.T_map_odom, pose.stamp_ns + ahead, self._frame, pose.odom_frame
        )
        self.publish("/tf", TFMessage(transforms=[transform]))

    def _publish_short_term(self, attempt: Attempt) -> None:
        height_map, pose = self._localizer.short_term_map(), self._localizer.pose
        if height_map is not None and pose is not None:
            message = HeightGrid()
            encode.fill_height_grid(message, height_map, attempt.stamp_ns, pose.odom_frame)
            self.publish("short_term_grid", message)

    def _publish_status(self) -> None:
        """State and deviation now, and what became of the last registration."""
        state, attempt = self._localizer.state, self._last
        message: Any = LocalizationStatus(state=int(state), reason="no registration yet")
        stamp = self._localizer.stamp_ns if attempt is None else attempt.stamp_ns
        encode.fill_header(message.header, stamp, self._frame)
        if attempt is not None:
            deviation = self._localizer.deviation
            encode.fill_localization_status(message, replace(attempt, deviation=deviation))
        message.reason = "; ".join(filter(None, [message.reason, self._localizer.lapse]))
        self.publish("~/status", message)
        if state is not self._state:
            change = f"{self._state.name} -> {state.name}; {message.reason}"
            if state < self._state:  # for the better
                self.get_logger().info(change)
            else:
                self.get_logger().warning(change)
            self._state = state

    def _relocalize(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        settings = self.params.localization
        response.success = self._localizer.request_search()
        if response.success:
            response.message = "the search begins with the next short-term map; see ~/status"
        elif settings.own_map and not settings.map_directory:
            response.message = "nothing to search: localization.map_directory names no saved map"
        else:
            response.message = "there is no long-term map yet"
        return response


def main() -> int:
    """Run the node."""
    return runtime.run(LocalizationNode)


if __name__ == "__main__":
    sys.exit(main())
