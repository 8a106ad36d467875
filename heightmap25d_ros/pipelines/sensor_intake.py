# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a robot's sensors in: what all pipelines have in common that use its scans."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, Generic, TypeVar

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.params import sources
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.input_watch import InputWatch
from heightmap25d_ros.pipelines.scan_queue import Reading, ScanQueue
from heightmap25d_ros.pipelines.self_check import Finding, findings_of_drive

_Outcome = TypeVar("_Outcome")


class SensorIntake(ABC, Generic[_Outcome]):
    """Joins scans with poses, and hands them on.

    Each ``take_...`` takes a message in, by duck type, and returns what came of the scans that it
    completed. A bad message is counted and changes nothing.

    Parameters
    ----------
    params : Params
    is_bridging : bool
        See `ScanQueue`.

    Attributes
    ----------
    dropped : Drops
    """

    def __init__(self, params: Params, *, is_bridging: bool = True) -> None:
        self._params = params
        self.dropped = Drops()
        self._queue = ScanQueue(
            params.intake, self.dropped, params.odometry, sources.mounts(params),
            is_bridging=is_bridging,
        )  # fmt: skip
        for notice in sources.without_topic(params):
            self.dropped.notice(notice)

    @property
    def scan_topics(self) -> tuple[str, ...]:
        """The topics that `take_scan` knows."""
        return self._params.intake.scan_topics

    @property
    def cloud_topics(self) -> tuple[str, ...]:
        """The topics that `take_cloud` knows."""
        return self._params.intake.cloud_topics

    @property
    def watch(self) -> InputWatch:
        """What was noticed about scans and poses."""
        return self._queue.watch

    def problems(self) -> list[Finding]:
        """What was wrong with the messages of the whole drive, see `findings_of_drive`."""
        return findings_of_drive(self.watch, self.dropped)

    def noticed(self) -> list[str]:
        """All that was wrong with the messages of the whole drive, in sentences."""
        return [*self.dropped.notices, *map(str, self.problems())]

    def nothing_of(self, path: Path, told: str) -> InputError:
        """What to say where nothing came of a bag, and why."""
        reasons = [*map(str, self.problems()), str(self.dropped)]
        return InputError("; ".join(filter(None, [f"{path}: {told}", *reasons])))

    def take_scan(self, topic: str, message: Any) -> list[_Outcome]:
        """Take a sensor_msgs/LaserScan of one of ``intake.scan_topics`` in."""
        return self._use(self._queue.take_scan(topic, message))

    def take_cloud(self, topic: str, message: Any) -> list[_Outcome]:
        """Take a sensor_msgs/PointCloud2 of one of ``intake.cloud_topics`` in."""
        return self._use(self._queue.take_cloud(topic, message))

    def take_odometry(self, message: Any) -> list[_Outcome]:
        """Take a pose of the robot in, see `robot_pose`."""
        return self._use(self._queue.take_odometry(message))

    def take_transforms(self, message: Any, *, is_static: bool) -> list[_Outcome]:
        """Take a tf2_msgs/TFMessage of /tf or of /tf_static in."""
        return self._use(self._queue.take_transforms(message, is_static=is_static))

    def flush(self) -> list[_Outcome]:
        """No more messages will come: use what is ready, drop what still waits."""
        return self._use(self._queue.flush())

    @abstractmethod
    def _use(self, readings: list[Reading]) -> list[_Outcome]:
        """Use scans that have their poses; what came of them."""
