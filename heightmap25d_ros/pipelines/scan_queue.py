# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans and clouds wait in a queue until their poses are known, and leave it in order of time.

What comes out depends on the stamps of the messages, never on wall time, and not on how the
topics interleave on their way here (as long as nothing comes later than ``wait_limit``): the
node and the command line make the same map from the same bag.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.io import decode, point_cloud
from heightmap25d_ros.io.decode import Odometry, Transform
from heightmap25d_ros.mapping import sensor_model
from heightmap25d_ros.mapping.cloud import Cloud, cloud_beams
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params import sources
from heightmap25d_ros.params.sections import IntakeParams, OdometryParams, Params
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.input_watch import InputWatch
from heightmap25d_ros.pipelines.map_correction import MapCorrection
from heightmap25d_ros.pipelines.odometry_gate import OdometryGate
from heightmap25d_ros.pipelines.odometry_spikes import OdometrySpikes
from heightmap25d_ros.pipelines.repeated_scans import RepeatedScans
from heightmap25d_ros.pipelines.robot_pose import robot_pose
from heightmap25d_ros.pipelines.silence import ODOMETRY, Silence
from heightmap25d_ros.pipelines.transform_buffer import JUMP_BACK_NS, Missing, TransformBuffer
from heightmap25d_ros.pose_interpolation import span

_MOST_FRAMES = 1000  # without mount that are remembered: each scan may name a new one

HISTORY = 30.0  # [s] beyond ``wait_limit`` that poses are kept, for lasers whose scans come late


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """A scan or a cloud with its poses.

    Attributes
    ----------
    topic : str
    scan : Scan or Cloud
    T_map_base, T_base_sensor : (N, 4, 4) or (1, 4, 4) float64
        At each of its ``beam_stamps_ns``, or once where it is the same for all beams.
    """

    topic: str
    scan: Scan | Cloud
    T_map_base: se3.Matrix
    T_base_sensor: se3.Matrix

    def beams(self, params: Params) -> Beams:
        """Its beams in the map, see `sensor_model.beams` and `cloud_beams`."""
        poses, lone_return = (self.T_map_base, self.T_base_sensor), params.mapper.lone_return
        sensor = sources.sensor_of(params, self.topic)
        if isinstance(self.scan, Cloud):
            cloud = sources.cloud_of(params, self.topic)
            return cloud_beams(self.scan, *poses, sensor, cloud, lone_return)
        return sensor_model.beams(self.scan, *poses, sensor, lone_return)


def sample_reading() -> Reading:
    """A scan and its poses through a queue; it compiles all that this needs, or loads it."""
    queue = ScanQueue(IntakeParams(scan_topics=("scan",), mounts=(0.0,) * 6))
    base_frame, readings = IntakeParams().base_frame, []
    for stamp_ns in range(0, 10**9, 10**8):
        T = se3.from_quaternion([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
        readings += queue.add_odometry(
            Odometry(stamp_ns=stamp_ns, frame_id="odom", child_frame_id=base_frame, T=T)
        )
        ranges = np.full(3, 1.0, np.float32)
        scan = Scan(
            stamp_ns=stamp_ns,
            angle_min=0.0,
            angle_increment=0.1,
            time_increment=1e-3,
            ranges=ranges,
        )
        readings += queue.add_scan("scan", scan)
    return readings[0]


@dataclass(frozen=True, slots=True)
class _Waiting:
    """A scan or a cloud in the queue, which is sorted by (stamp, topic)."""

    topic: str
    scan: Scan | Cloud
    beam_stamps_ns: NDArray[np.int64]
    first_ns: int
    last_ns: int

    @property
    def order(self) -> tuple[int, str]:
        return self.scan.stamp_ns, self.topic


@dataclass(frozen=True, slots=True)
class _LookupFailure:
    """Which transform could not be looked up, and why."""

    missing: Missing
    of: str
    frame: str = ""


class ScanQueue:
    """Joins scans with the poses of the robot and of the lasers at each beam's own time.

    Messages (``take_...``) or decoded values (``add_...``) go in; each call returns the readings
    that it completed. A bad message is counted and changes nothing.

    A scan is released when odometry brackets all of its beams, its mount is known, and every other
    laser has come as far, so that scans leave in the order of (stamp, topic). A laser silent for
    ``wait_limit`` is not waited for. The odometry's stamps are the clock: when they jump back (a
    bag that loops), all starts over.

    Parameters
    ----------
    params : IntakeParams
    dropped : Drops, optional
        Where to count what is not used.
    odometry : OdometryParams, optional
        What is no motion of a robot but a jump of its odometry.
    mounts : mapping of str to (6,) float [m, rad], optional
        Topic -> x, y, z, roll, pitch, yaw, in place of those of the parameters and of /tf.
    is_bridging : bool
        Whether poses stay continuous where the odometry jumps; otherwise they are as it has them.

    Attributes
    ----------
    dropped : Drops
    gate : OdometryGate
    correction : MapCorrection
    watch : InputWatch
    silence : Silence
        Of the odometry and each laser; whoever uses it lets the time pass.
    odometry : Odometry or None
        The newest pose of the robot.
    """

    def __init__(
        self,
        params: IntakeParams,
        dropped: Drops | None = None,
        odometry: OdometryParams | None = None,
        mounts: Mapping[str, Sequence[float]] | None = None,
        *,
        is_bridging: bool = True,
    ) -> None:
        self.dropped = Drops() if dropped is None else dropped
        self.odometry: Odometry | None = None
        self._params = params
        self._wait_limit_ns = round(params.wait_limit * 1e9)
        history = params.wait_limit + HISTORY
        self._odometry = TransformBuffer(max_gap=params.odom_gap, history=history)
        self._transforms = TransformBuffer(
            max_gap=params.odom_gap, history=history, dropped=self.dropped
        )
        self._fixed_mounts: dict[str, se3.Matrix] = {}
        if params.mounts:
            poses = se3.from_xyz_rpy(np.reshape(params.mounts, (-1, 6)))
            self._fixed_mounts |= dict(zip(params.scan_topics, poses[:, None], strict=True))
        if params.cloud_mounts:
            poses = se3.from_xyz_rpy(np.reshape(params.cloud_mounts, (-1, 6)))
            self._fixed_mounts |= dict(zip(params.cloud_topics, poses[:, None], strict=True))
        for topic, mount in (mounts or {}).items():
            self._fixed_mounts[topic] = se3.from_xyz_rpy(np.reshape(mount, (1, 6)))
        self.gate = OdometryGate(odometry or OdometryParams(), self.dropped)
        self._spikes = OdometrySpikes(odometry or OdometryParams(), self.dropped)
        self._repeated = RepeatedScans()
        self.watch = InputWatch()
        self.silence = Silence([ODOMETRY, *params.source_topics], params.timeout)
        self.correction = MapCorrection(self.gate, is_bridging=is_bridging)
        self._odom_frame = ""
        self._odom_stamp_ns = -1
        self._waiting: list[_Waiting] = []
        self._newest_ns: dict[str, int] = {}
        self._released_ns: dict[str, int] = {}
        self._given_up: set[str] = set()

    def take_scan(self, topic: str, message: Any) -> list[Reading]:
        """Take a sensor_msgs/LaserScan of one of ``scan_topics``."""
        scan = self.dropped.decoded("scan", decode.scan, message)
        return [] if scan is None else self.add_scan(topic, scan)

    def take_cloud(self, topic: str, message: Any) -> list[Reading]:
        """Take a sensor_msgs/PointCloud2 of one of ``cloud_topics``."""
        cloud = self.dropped.decoded("cloud", point_cloud.cloud, message)
        return [] if cloud is None else self.add_scan(topic, cloud)

    def take_odometry(self, message: Any) -> list[Reading]:
        """Take a pose of the robot, in a message or decoded, see `robot_pose`."""
        odometry = robot_pose(message, self._params.base_frame, self.dropped)
        return [] if odometry is None else self.add_odometry(odometry)

    def take_transforms(self, message: Any, *, is_static: bool) -> list[Reading]:
        """Take a tf2_msgs/TFMessage of /tf or of /tf_static."""
        used = self._transforms.take(message, is_static=is_static)
        return self._release() if used else []

    def set_correction(self, T_map_odom: se3.Matrix, stamp_ns: int = 0) -> None:
        """Pose (4, 4) of the odometry's frame of a stamp in the map, for scans released later."""
        self.correction.set(T_map_odom, stamp_ns)

    def add_scan(self, topic: str, scan: Scan | Cloud) -> list[Reading]:
        """Add a scan of one of ``scan_topics``, or a cloud of one of ``cloud_topics``."""
        if topic not in self._params.source_topics:
            raise ValueError(f"{topic} is not one of the topics {self._params.source_topics}")
        stamps = scan.beam_stamps_ns()
        first_ns, last_ns = span(stamps)
        self.watch.observe_scan(topic, scan, last_ns - first_ns)
        newest = self._newest_ns.get(topic, scan.stamp_ns)
        if scan.stamp_ns < newest - JUMP_BACK_NS:
            self._forget_waiting([topic], after_ns=scan.stamp_ns)
            newest = scan.stamp_ns
        self._newest_ns[topic] = max(newest, scan.stamp_ns)

        waiting = _Waiting(topic, scan, stamps, first_ns, last_ns)
        released = self._released_ns.get(topic, -1)
        if scan.stamp_ns < released:
            self.dropped.record(f"{scan.KIND}: out of order")
        elif scan.stamp_ns == released or waiting.order in (w.order for w in self._waiting):
            self.dropped.record(f"{scan.KIND}: stamp seen before")
        elif self._is_repeated(topic, scan):
            self.dropped.record("scan: the same as before, though the robot moves", topic)
        else:
            insort(self._waiting, waiting, key=lambda w: w.order)
            self.silence.hear(topic)
        return self._release()

    def _is_repeated(self, topic: str, scan: Scan | Cloud) -> bool:
        if isinstance(scan, Cloud) or self.odometry is None:
            return False
        return self._repeated.is_repeated(topic, scan.ranges, self.odometry.T)

    def add_odometry(self, odometry: Odometry) -> list[Reading]:
        """Add a pose of the robot; an odd one waits, see `OdometrySpikes` and `OdometryGate`."""
        if self._is_refused(odometry):
            return []
        if odometry.stamp_ns < self._odom_stamp_ns:
            self._start_over(odometry)
        self._use_odometry(self._spikes.admit(odometry))
        return self._release()

    def _is_refused(self, odometry: Odometry) -> bool:
        refusal = self.gate.refusal(odometry, self._params.base_frame)
        if refusal is not None:
            self.dropped.record(*refusal)
        return refusal is not None

    def _use_odometry(self, poses: Iterable[Odometry]) -> None:
        """Use poses that have waited long enough; those that came meanwhile may be out of order."""
        sound = (p for p in poses if not self._is_refused(p))
        for odometry in chain.from_iterable(map(self.gate.admit, sound)):
            stamp, frame = odometry.stamp_ns, odometry.frame_id
            for topic in self._params.source_topics:
                self._newest_ns.setdefault(topic, stamp - 1)
            self.odometry, self._odom_frame, self._odom_stamp_ns = odometry, frame, stamp
            self.watch.observe_odometry(odometry)
            self.silence.hear(ODOMETRY)
            child = odometry.child_frame_id
            self._odometry.add([Transform(parent=frame, child=child, stamp_ns=stamp, T=odometry.T)])

    def begin_drive(self) -> None:
        """The next messages are of another drive: nothing of before is joined with them.

        What still waits is not used, see `flush`; static transforms stay.
        """
        self.correction.restart()
        self._spikes.restart()
        self._waiting.clear()
        self._odometry.clear()
        self._transforms.forget_after(-1)
        self._newest_ns.clear()
        self._released_ns.clear()
        self._given_up.clear()
        self._odom_stamp_ns = -1

    def settle(self) -> list[Reading]:
        """Returns what has its poses now, without waiting for the other lasers."""
        return self._release(is_waiting_for_others=False)

    def flush(self) -> list[Reading]:
        """Nothing more will come: returns what is ready and counts the rest as dropped."""
        self._use_odometry(self._spikes.finish())
        self.gate.finish()
        return self._release(is_end=True)

    def _start_over(self, odometry: Odometry) -> None:
        """The clock jumped back; where the robot stayed, alone the clock was wrong."""
        stamp_ns, before = odometry.stamp_ns, self.odometry
        self.dropped.record("poses: clock jumped back")
        has_stayed = before is not None and self.gate.is_continuous(before, odometry)
        self.correction.restart(stamp_ns if has_stayed else None)
        self._spikes.restart()
        self._forget_waiting(self._params.source_topics, after_ns=stamp_ns)
        self._transforms.forget_after(stamp_ns + JUMP_BACK_NS)
        self._newest_ns = {topic: min(ns, stamp_ns - 1) for topic, ns in self._newest_ns.items()}
        self._released_ns.clear()

    def _forget_waiting(self, topics: Collection[str], *, after_ns: int) -> None:
        """Forget the scans of before the jump; up to a second ahead may be of after it."""
        kept: list[_Waiting] = []
        for waiting in self._waiting:
            if waiting.topic in topics and waiting.scan.stamp_ns > after_ns + JUMP_BACK_NS:
                self.dropped.record(f"{waiting.scan.KIND}: clock jumped back")
            else:
                kept.append(waiting)
        self._waiting = kept

    def _release(
        self, *, is_waiting_for_others: bool = True, is_end: bool = False
    ) -> list[Reading]:
        """Take out of the queue what is ready or never will be; nothing overtakes in time."""
        readings: list[Reading] = []
        kept: list[_Waiting] = []
        for waiting in self._waiting:
            is_late = is_end or self._is_late(waiting)
            is_next = not is_waiting_for_others or self._others_have_come(waiting.scan.stamp_ns)
            if not is_late and (kept or not is_next):
                kept.append(waiting)
                continue
            outcome = self._reading(waiting)
            if isinstance(outcome, Reading):
                self._released_ns[waiting.topic] = waiting.scan.stamp_ns
                readings.append(outcome)
            elif is_late or self._is_final(outcome):
                self._give_up(waiting, outcome)
            else:
                kept.append(waiting)
        self._waiting = kept
        return readings

    def _is_late(self, waiting: _Waiting) -> bool:
        clock = max(self._odom_stamp_ns, self._newest_ns[waiting.topic])
        return clock > waiting.last_ns + self._wait_limit_ns

    def _others_have_come(self, stamp_ns: int) -> bool:
        """Whether each laser has come as far as a stamp, or has fallen silent."""
        silent_before = self._odom_stamp_ns - self._wait_limit_ns
        return all(ns >= stamp_ns or ns < silent_before for ns in self._newest_ns.values())

    def _reading(self, waiting: _Waiting) -> Reading | _LookupFailure:
        stamps, base_frame = waiting.beam_stamps_ns, self._params.base_frame
        begin = waiting.first_ns
        if self.gate.is_torn(begin, waiting.last_ns):
            return _LookupFailure(Missing.TORN, "the odometry")
        T_odom_base = self._odometry.lookup(self._odom_frame, base_frame, stamps)
        if isinstance(T_odom_base, Missing):
            return _LookupFailure(T_odom_base, "the odometry")
        mount = self._fixed_mounts.get(waiting.topic)
        if mount is None:
            frame = waiting.scan.frame_id
            looked_up = self._transforms.lookup(base_frame, frame, stamps)
            if isinstance(looked_up, Missing):
                return _LookupFailure(looked_up, "its mount", frame)
            mount = looked_up
        if isinstance(waiting.scan, Scan):
            self.watch.mounts.observe(waiting.topic, waiting.scan, T_odom_base, mount)
        return Reading(
            topic=waiting.topic,
            scan=waiting.scan,
            T_map_base=se3.compose(self.correction.T_map_odom(begin)[None], T_odom_base),
            T_base_sensor=mount,
        )

    def _is_final(self, failure: _LookupFailure) -> bool:
        """Whether no message that may still come can help."""
        if failure.missing is Missing.UNCONNECTED:
            return failure.frame in self._given_up
        return failure.missing is not Missing.NOT_YET

    def _give_up(self, waiting: _Waiting, failure: _LookupFailure) -> None:
        """Count a scan as dropped; a mount that was waited for in vain is not waited for again."""
        example = f"frame {failure.frame!r}" if failure.frame else ""
        reason = f"{waiting.scan.KIND}: {failure.missing.value} {failure.of}"
        self.dropped.record(reason, example)
        if failure.missing is Missing.UNCONNECTED and len(self._given_up) < _MOST_FRAMES:
            self._given_up.add(failure.frame)
