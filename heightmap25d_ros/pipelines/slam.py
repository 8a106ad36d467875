# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans and odometry in, a map without known poses out: what ``heightmap25d slam`` drives.

`Slam` localizes a drive on the map that it makes of it. `CorrectedMapping` is the same drive once
more, into a map with the poses that came of it, held against a finished map if there is one.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.localization.landmarks import Landmarks
from heightmap25d_ros.params import sources
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import replayed
from heightmap25d_ros.pipelines.scan_queue import Reading
from heightmap25d_ros.pipelines.sensor_intake import SensorIntake
from heightmap25d_ros.slam.map_pass import MapPass, ScanPose
from heightmap25d_ros.slam.own_map_tracker import OwnMapTracker
from heightmap25d_ros.slam.refinement import disagreed, refined_poses


class _Drive(SensorIntake[Reading]):
    """A drive, scan by scan, with poses in odom."""

    def _use(self, readings: list[Reading]) -> list[Reading]:
        for reading in readings:
            self._integrate(reading)
        return readings

    @abstractmethod
    def _integrate(self, reading: Reading) -> None:
        """Use one scan."""


class Slam(_Drive):
    """A drive, localized on the map that is made of it.

    Each ``take_...`` takes a message in, by duck type, and returns the scans that it completed. A
    bad message is counted and changes nothing.

    Parameters
    ----------
    params : Params, optional

    Attributes
    ----------
    tracker : OwnMapTracker
    dropped : Drops
    """

    def __init__(self, params: Params | None = None) -> None:
        super().__init__(params or Params())
        self.tracker = OwnMapTracker(self._params)

    def flush(self) -> list[Reading]:
        """No more messages will come: use what is ready, and look back once more."""
        readings = super().flush()
        self.tracker.finish()
        return readings

    def _integrate(self, reading: Reading) -> None:
        self.watch.observe_ranges(
            reading.scan, sources.sensor_of(self._params, reading.topic).no_return, self.dropped
        )
        beams = reading.beams(self._params)
        self.tracker.integrate(beams, reading.T_map_base[-1], reading.scan.stamp_ns)


class CorrectedMapping(_Drive):
    """The same drive into a map, with poses of odom in the map.

    Parameters
    ----------
    mapping : Mapping
        Where it is merged.
    poses : iterable of ScanPose
        Of the scans, in their order.
    params : Params
    landmarks : Landmarks, optional
        Of a finished map, against which the poses are held once more.

    Attributes
    ----------
    mapping
    poses : list of ScanPose
        As they were merged; those that are not sure were not.
    trajectory : list of (int, (4, 4) float64)
        Stamp [ns] and pose of the robot in the map at each scan.
    """

    def __init__(
        self,
        mapping: Mapping,
        poses: Iterable[ScanPose],
        params: Params,
        landmarks: Landmarks | None = None,
    ) -> None:
        super().__init__(params)
        self.poses: list[ScanPose] = []
        self.trajectory: list[tuple[int, se3.Matrix]] = []
        self.mapping = mapping
        self._given: Iterator[ScanPose] = iter(poses)
        self._pass = None if landmarks is None else MapPass(landmarks, params)

    @property
    def disagreed(self) -> float:
        """Distance [m] along which the finished map and the given poses disagree."""
        return 0.0 if self._pass is None else self._pass.disagreed

    def _integrate(self, reading: Reading) -> None:
        pose = next(self._given)
        assert pose.stamp_ns == reading.scan.stamp_ns
        if self._pass is not None:
            beams = reading.beams(self._params)
            pose = self._pass.pose(beams, reading.T_map_base[-1], pose)
        placed = replace(reading, T_map_base=np.asarray(pose.T_map_odom @ reading.T_map_base))
        if pose.is_sure:
            self.mapping.merge(placed)
        self.poses.append(pose)
        self.trajectory.append((pose.stamp_ns, placed.T_map_base[0]))


@dataclass(frozen=True, slots=True, kw_only=True)
class SlamResult:
    """A map without known poses, and what it was made of.

    Attributes
    ----------
    mapping : Mapping
        The map.
    slam : Slam
        The drive as it was localized, with all that was noticed.
    odometry, trajectory : list of (int, (4, 4) float64)
        Stamp [ns] of each scan, and pose of the robot: by odometry alone, and in the map.
    disagreed : float [m]
        Travelled where these are not what localization on the own map has found.
    poses : list of ScanPose
        Of the map that it was made with.
    """

    mapping: Mapping
    slam: Slam
    odometry: list[tuple[int, se3.Matrix]]
    trajectory: list[tuple[int, se3.Matrix]]
    disagreed: float
    poses: list[ScanPose]


def slam_bag(
    bag: Bag, params: Params, odom_topic: str, stretch: tuple[int, int] | None = None
) -> SlamResult:
    """Map a bag without known poses: the same bag, the same map.

    The drive is localized on the map made so far; its poses are then refined together, and the map
    is made anew with these. The bag is read twice, so that the memory does not grow with its
    length, but for the poses and some returns of each metre.

    Parameters
    ----------
    bag : Bag
    params : Params
        With the scan topics of the bag.
    odom_topic : str
        Of the robot's poses, see `replay.pose_topic`.
    stretch : (int, int) [ns], optional
        See `replay.replayed`.

    Raises
    ------
    InputError
        If the bag is damaged, or nothing could be mapped.
    """
    slam = Slam(params)
    odometry = [
        (reading.scan.stamp_ns, reading.T_map_base[0])
        for step in replayed(bag, slam, odom_topic, params.intake, stretch)
        for reading in step.outcomes
    ]
    poses = refined_poses(slam.tracker, params.scan_filter)
    made = CorrectedMapping(Mapping(params), poses, params)
    map_again(bag, made, odom_topic, params, stretch)
    return SlamResult(
        mapping=made.mapping, slam=slam, odometry=odometry, trajectory=made.trajectory,
        disagreed=disagreed(slam.tracker, poses), poses=poses,
    )  # fmt: skip


def map_again(
    bag: Bag,
    pipeline: CorrectedMapping,
    odom_topic: str,
    params: Params,
    stretch: tuple[int, int] | None = None,
) -> None:
    """Give a bag to a pipeline, whose scans must be as before; parameters are `slam_bag`'s."""
    for _ in replayed(bag, pipeline, odom_topic, params.intake, stretch):
        pass
