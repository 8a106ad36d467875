# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mapping node: scans and odometry in, height grid and obstacle grids out."""

from __future__ import annotations

import math
import pathlib
import sys
import tempfile
from functools import partial
from typing import Any

from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Path
from nav_msgs.srv import GetMap
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker

from heightmap25d_msgs.msg import LocalizationStatus
from heightmap25d_msgs.srv import Explain, LoadMap, SaveMap
from heightmap25d_ros.errors import InputError, printable
from heightmap25d_ros.io import encode, explanations, map_directory
from heightmap25d_ros.nodes import map_transform, qos, runtime
from heightmap25d_ros.nodes.cloud_source import cloud_inputs
from heightmap25d_ros.nodes.interface import Input, Output, Service
from heightmap25d_ros.nodes.lifecycle import REPORT_PERIOD, ManagedNode
from heightmap25d_ros.nodes.map_publisher import MapPublisher
from heightmap25d_ros.nodes.map_transform import AnchorTransform, MapTransform
from heightmap25d_ros.nodes.pose_source import pose_inputs
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.input_watch import InputWatch
from heightmap25d_ros.pipelines.mapping import Mapping, compile_kernels
from heightmap25d_ros.pipelines.scan_queue import Reading
from heightmap25d_ros.pipelines.silence import CHECKS


class MappingNode(ManagedNode):
    """Hands messages to `Mapping`, and publishes the maps.

    A map is published at most ``publish_rate`` times a second, and only to topics that
    somebody subscribes to and that have not carried this state of the map yet.
    """

    NAME = "mapping"
    PARAMETERS = (
        "grid",
        "sensor",
        "mapper",
        "levels",
        "traversability",
        "intake",
        "cloud",
        "odometry",
        "mapping",
    )

    def inputs(self) -> list[Input]:
        """Lasers, clouds, poses, transforms, and what localization says."""
        scans = [
            Input(LaserScan, topic, partial(self._on_scan, topic), qos.SCANS, is_needed=True)
            for topic in self.params.intake.scan_topics
        ]
        return [
            *scans,
            *cloud_inputs(self.params, self._on_cloud),
            *pose_inputs(
                self.params.intake, self._on_odometry, self._on_transforms, self.flatness
            ),
            Input(
                PoseWithCovarianceStamped, "pose_correction", self._mapping.take_correction,
                qos.QUEUE,
            ),
            Input(
                LocalizationStatus, "localization/status",
                self._mapping.take_localization_status, qos.LATCHED,
            ),
            Input(Path, "localization/submaps", self._on_submaps, qos.LATCHED),
            Input(PointStamped, "clicked_point", self._on_clicked_point, qos.QUEUE),
        ]  # fmt: skip

    def outputs(self) -> list[Output]:
        """The maps and their frame, and map -> odom where nobody else publishes it."""
        outputs = self._publisher.outputs()
        outputs.append(Output(TFMessage, "/tf_static", qos.STATIC_TRANSFORMS))
        outputs.append(Output(Marker, "~/explanation", qos.LATCHED))
        if self.params.mapping.publish_transform:
            outputs.append(Output(TFMessage, "/tf", qos.POSES))
        return outputs

    def offered_services(self) -> list[Service]:
        """What is asked of the map."""
        return [
            Service(SaveMap, "~/save_map", self._save_map),
            Service(LoadMap, "~/load_map", self._load_map),
            Service(Trigger, "~/clear_map", self._clear_map),
            Service(GetMap, "~/get_map", self._get_map),
            Service(Explain, "~/explain", self._explain),
        ]

    def set_up(self) -> None:
        """Make the map, empty or with the initial map in it."""
        self._frame = self.params.mapping.map_frame
        self._mapping = Mapping(self.params)
        self._version = 0  # of the map: counts merges, loads and clears
        self._saved = 0
        self._anchor = AnchorTransform(self._frame)
        self._publisher = MapPublisher(self, self._mapping, self._frame, self._anchor)
        self._latency_ms = 0.0
        if self.params.mapping.autosave:
            self._path(self.params.mapping.autosave)  # a wrong name is an error now, not at the end
        if self.params.mapping.initial_map:
            self._load(self.params.mapping.initial_map)
        compile_kernels(self.params)

    def start(self) -> None:
        """Start publishing, by the wall clock; look for silence by that of the node."""
        self._start_publishing()
        self._transform = MapTransform(self._frame)
        self.create_timer(self.params.intake.timeout / CHECKS, self._pass_time)
        if self.params.mapping.publish_transform:
            self.create_wall_timer(map_transform.PERIOD, self._publish_transform)

    def _start_publishing(self) -> None:
        period = 1.0 / self.params.mapping.publish_rate
        self._publish_timer = self.create_wall_timer(period, self._publish)

    def take_params(self) -> None:
        """Apply new parameters; the map is kept, converted and published again."""
        self._mapping.set_params(self.params)
        self._publisher.begin_anew()
        if self.is_active:
            self.destroy_timer(self._publish_timer)
            self._start_publishing()

    def finish(self) -> bool:
        """Save the map under the name ``autosave``, where there is one and it is not saved.

        Where that fails it is saved in a new directory for temporary files, and the status is 1.
        """
        is_saved = self._saved == self._version or not self._mapping.grid.observed_cells
        if is_saved or not self.params.mapping.autosave:
            return True
        try:
            self._save(self.params.mapping.autosave)
        except Exception as error:
            path = pathlib.Path(tempfile.mkdtemp(prefix="heightmap25d_")) / "map"
            self._write(path, max_cells=math.inf)
            told = printable(f"map not saved: {error}")
            self.get_logger().error(f"{told}; saved as {path} instead")
            return False
        return True

    @property
    def dropped(self) -> Drops:
        """How many messages were not used, by reason."""
        return self._mapping.dropped

    @property
    def watch(self) -> InputWatch:
        """What was noticed about scans and poses."""
        return self._mapping.watch

    def trouble(self) -> str:
        """Why nothing is mapped now."""
        return self._mapping.trouble

    def figures(self) -> dict[str, Any]:
        """What /diagnostics reports of the map."""
        size = self._mapping.size()
        latency, self._latency_ms = self._latency_ms, 0.0
        return {
            "scans merged": self._mapping.merged["scans"],
            "scan to map, at most [ms]": round(latency, 1),
            "map [cells]": f"{size.columns} x {size.rows}",
            "map memory [MB]": round(size.bytes / 1e6, 2),
            "map saved": self._saved == self._version,
        }

    def _on_scan(self, topic: str, message: LaserScan) -> None:
        self._count(self._mapping.take_scan(topic, message))

    def _on_cloud(self, topic: str, message: Any) -> None:
        self._count(self._mapping.take_cloud(topic, message))

    def _on_odometry(self, message: Any) -> None:
        self._count(self._mapping.take_odometry(message))

    def _on_transforms(self, message: TFMessage, is_static: bool) -> None:
        if not is_static:
            self._transform.observe(message)
        self._count(self._mapping.take_transforms(message, is_static=is_static))

    def _on_submaps(self, message: Path) -> None:
        if self._mapping.take_submaps(message):
            self._replace_map()
            self.get_logger().info("the map was moved with the submaps of localization")

    def _pass_time(self) -> None:
        self._mapping.pass_time(self.get_clock().now().nanoseconds)

    def _count(self, merged: list[Reading]) -> None:
        self._version += len(merged)
        if merged:
            late_ns = self.get_clock().now().nanoseconds - merged[0].scan.stamp_ns
            self._latency_ms = max(self._latency_ms, late_ns * 1e-6)

    def _publish_transform(self) -> None:
        odometry = self._mapping.odometry
        is_left = self.params.mapping.needs_localization
        if odometry is None or is_left or self.count_publishers("localization/status"):
            return
        message = self._transform.next(
            odometry.stamp_ns, odometry.frame_id, self._mapping.T_map_odom
        )
        if message is not None:
            self.publish("/tf", message)

    def _publish(self) -> None:
        moved = self._anchor.update(self._mapping.grid.anchor, self._mapping.stamp_ns)
        if moved is not None:
            self.publish("/tf_static", moved)
        if not self._version:
            return
        try:
            self._publisher.publish(self._version)
        except InputError as error:
            self.get_logger().error(str(error), throttle_duration_sec=REPORT_PERIOD)

    def _replace_map(self) -> None:
        """Another map is published from now on."""
        self._version += 1
        self._publisher.begin_anew()

    def _path(self, name: str) -> pathlib.Path:
        return map_directory.map_path(pathlib.Path(self.params.mapping.map_directory), name)

    def _save(self, name: str) -> pathlib.Path:
        path = self._path(name)
        self._count(self._mapping.settle())
        self._write(path)
        self._saved = self._version
        self.get_logger().info(f"map saved: {path}")
        return path

    def _write(self, path: pathlib.Path, max_cells: float | None = None) -> None:
        height_map, obstacle_map = self._mapping.maps(max_cells)
        layers = self._mapping.layers(height_map.geometry)
        map_directory.save(path, height_map, obstacle_map, self._frame, layers=layers)

    def _load(self, name: str) -> None:
        path = self._path(name)
        self._mapping.load(path)
        self._replace_map()
        self._saved = self._version
        self.get_logger().info(f"map loaded: {path}")

    def _save_map(self, request: SaveMap.Request, response: SaveMap.Response) -> SaveMap.Response:
        try:
            response.path = str(self._save(request.name))
            response.success = True
        except InputError as error:
            response.message = str(error)
            self.get_logger().error(f"map not saved: {error}")
        return response

    def _load_map(self, request: LoadMap.Request, response: LoadMap.Response) -> LoadMap.Response:
        try:
            self._load(request.name)
            response.success = True
        except InputError as error:
            response.message = str(error)
            self.get_logger().error(f"map not loaded: {error}")
        return response

    def _clear_map(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            self._mapping.clear()
        except InputError as error:
            response.message = str(error)
            return response
        self._replace_map()
        response.success = True
        self.get_logger().info("map cleared")
        return response

    def _explain(self, request: Explain.Request, response: Explain.Response) -> Explain.Response:
        try:
            found = self._mapping.explain(request.point)
        except InputError as error:
            response.message = str(error)
            return response
        explanations.fill_response(response, found, self._frame)
        response.success = True
        return response

    def _on_clicked_point(self, message: PointStamped) -> None:
        found = self.dropped.decoded("clicked_point", self._mapping.explain, message)
        if found is not None:
            marker = Marker(ns="explanation", type=Marker.TEXT_VIEW_FACING)
            explanations.fill_text(marker, found, self._mapping.stamp_ns, self._frame)
            self.publish("~/explanation", marker)

    def _get_map(self, _: GetMap.Request, response: GetMap.Response) -> GetMap.Response:
        try:
            height_map, obstacle_map = self._mapping.maps()
        except InputError as error:
            self.get_logger().error(str(error))
            return response
        encode.fill_occupancy_grid(
            response.map,
            obstacle_map.occupancy,
            height_map.geometry,
            self._mapping.stamp_ns,
            self._frame,
        )
        return response


def main() -> int:
    """Run the node."""
    return runtime.run(MappingNode)


if __name__ == "__main__":
    sys.exit(main())
