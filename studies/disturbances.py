# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What drivers, networks and clocks do to the messages of a drive; for measure_degradation.py.

A disturbance takes the events of a drive, and gives back others in the order in which they arrive.
Poses are on /odom, the lasers are /scan and /scan_down. Times are in seconds since the start; the
robot has driven for half of its time at `Drive.half`.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.io import decode

ODOM, LEVEL, DOWN = "/odom", "/scan", "/scan_down"
MOVING = (ODOM, LEVEL, DOWN)
SECOND = 10**9


class Event(NamedTuple):
    """A message, when it was recorded, which is when it is true, and when it arrives [ns]."""

    topic: str
    message: Any
    recorded_ns: int
    arrives_ns: int


@dataclass(frozen=True)
class Drive:
    """Events in the order in which they arrive; from when to when they were recorded [ns]."""

    events: Sequence[Event]
    start_ns: int
    end_ns: int
    random: np.random.Generator

    @property
    def half(self) -> float:
        return (self.end_ns - self.start_ns) * 0.5e-9

    def seconds(self, event: Event) -> float:
        return (event.recorded_ns - self.start_ns) * 1e-9


Disturbance = Callable[[Drive], list[Event]]
Change = Callable[[Drive, Event], Event | None]


def each(change: Change, *topics: str) -> Disturbance:
    """Each message of some topics becomes another one, or none."""

    def disturbed(drive: Drive) -> list[Event]:
        changed = (change(drive, e) if e.topic in topics else e for e in drive.events)
        return [event for event in changed if event is not None]

    return disturbed


def dropped(share: float, *topics: str) -> Disturbance:
    return each(lambda d, e: None if d.random.random() < share else e, *topics)


def gap(seconds: float, *topics: str) -> Disturbance:
    return each(lambda d, e: None if d.half <= d.seconds(e) < d.half + seconds else e, *topics)


def duplicated(drive: Drive) -> list[Event]:
    """One in ten messages comes twice, the second time up to 0.2 s later."""
    again = [
        _late(e, drive.random.uniform(0.0, 0.2))
        for e in drive.events
        if e.topic in MOVING and drive.random.random() < 0.1
    ]
    return sorted([*drive.events, *again], key=lambda e: e.arrives_ns)


def _late(event: Event, seconds: float) -> Event:
    return event._replace(arrives_ns=event.arrives_ns + int(seconds * SECOND))


def delayed(most: float, *topics: str) -> Disturbance:
    """Each message arrives up to so many seconds late: they overtake one another."""

    def disturbed(drive: Drive) -> list[Event]:
        late = [
            _late(e, drive.random.uniform(0.0, most)) if e.topic in topics else e
            for e in drive.events
        ]
        return sorted(late, key=lambda e: e.arrives_ns)

    return disturbed


def shifted_stamps(of: Callable[[Drive, Event], float], *topics: str) -> Disturbance:
    """The stamps are wrong by so many seconds."""
    return each(lambda d, e: _stamped(e, of(d, e)), *topics)


def _stamped(event: Event, seconds: float) -> Event:
    if not seconds:
        return event
    message = copy.copy(event.message)
    message.header = copy.deepcopy(message.header)
    stamp = message.header.stamp
    stamp_ns = stamp.sec * SECOND + stamp.nanosec + round(seconds * SECOND)
    stamp.sec, stamp.nanosec = divmod(stamp_ns, SECOND)
    return event._replace(message=message)


def poses(of: Callable[[Drive, float, se3.Matrix], se3.Matrix]) -> Disturbance:
    """Other poses, from the time and the pose."""

    def change(drive: Drive, event: Event) -> Event:
        T = decode.odometry(event.message).T
        changed = of(drive, drive.seconds(event), T)
        return event if changed is T else _with_pose(event, changed)

    return each(change, ODOM)


def _with_pose(event: Event, T: se3.Matrix) -> Event:
    message = copy.deepcopy(event.message)
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    position.x, position.y, position.z = T[:3, 3].tolist()
    if np.isfinite(T).all():
        turn.x, turn.y, turn.z, turn.w = se3.to_quaternion(T).tolist()
    return event._replace(message=message)


def _offset(*xyz_rpy: float) -> se3.Matrix:
    """Of x, y, z [m], roll, pitch, yaw [rad], as far as they are given."""
    return se3.from_xyz_rpy([*xyz_rpy, *[0.0] * (6 - len(xyz_rpy))])


def bursts(count: int, length: int, *xyz_rpy: float, wait: int = 60) -> Disturbance:
    """So many times, from one third of the drive on, so many poses in a row that are off."""
    T_off = _offset(*xyz_rpy)

    def disturbed(drive: Drive) -> list[Event]:
        numbers = [i for i, e in enumerate(drive.events) if e.topic == ODOM]
        begin = len(numbers) // 3
        bad = {
            numbers[begin + wait * turn + place]
            for turn in range(count) for place in range(length)
            if begin + wait * turn + place < len(numbers)
        }  # fmt: skip
        return [
            _with_pose(e, decode.odometry(e.message).T @ T_off) if i in bad else e
            for i, e in enumerate(drive.events)
        ]

    return disturbed


def ranges(
    of: Callable[[Drive, float, np.ndarray], np.ndarray], *topics: str, begin: float = 0.0,
    seconds: float = np.inf,
) -> Disturbance:  # fmt: skip
    """Other ranges, from ``begin`` seconds after half of the drive on, for so many seconds."""

    def change(drive: Drive, event: Event) -> Event:
        at = drive.seconds(event) - drive.half
        if not begin <= at < begin + seconds:
            return event
        message = copy.copy(event.message)
        message.ranges = np.asarray(of(drive, at, message.ranges), np.float32)
        return event._replace(message=message)

    return each(change, *topics)


def stuck(seconds: float, *topics: str) -> Disturbance:
    """Lasers that give the same ranges again and again, with new stamps."""

    def disturbed(drive: Drive) -> list[Event]:
        first: dict[str, np.ndarray] = {}

        def of(_: Drive, __: float, now: np.ndarray) -> np.ndarray:
            return first.setdefault(topic, now)

        for topic in topics:
            drive = replace(drive, events=ranges(of, topic, seconds=seconds)(drive))
        return list(drive.events)

    return disturbed


def mounted_wrong(frame: str, *rpy_degrees: float) -> Disturbance:
    """A static transform that is off by some degrees."""
    T_off = se3.from_xyz_rpy([0.0, 0.0, 0.0, *np.radians(rpy_degrees)])

    def change(_: Drive, event: Event) -> Event:
        message = copy.deepcopy(event.message)
        for stamped in message.transforms:
            if stamped.child_frame_id == frame:
                rotation = stamped.transform.rotation
                R = se3.from_quaternion(
                    [0.0, 0.0, 0.0], [rotation.x, rotation.y, rotation.z, rotation.w]
                )
                turned = se3.to_quaternion(R @ T_off).tolist()
                rotation.x, rotation.y, rotation.z, rotation.w = turned
        return event._replace(message=message)

    return each(change, "/tf_static")


def _restart(drive: Drive, seconds: float, T: se3.Matrix, kept: dict[str, Any]) -> se3.Matrix:
    """Begins at 0 again, with the roll and pitch that it had."""
    if seconds < drive.half:
        return T
    if "T" not in kept:
        x, y, z, _, _, yaw = se3.to_xyz_rpy(T)
        kept["T"] = se3.inverse(se3.from_xyz_rpy([x, y, z, 0.0, 0.0, yaw]))
    return np.asarray(kept["T"] @ T)


def restarted(drive: Drive) -> list[Event]:
    kept: dict[str, Any] = {}
    return poses(lambda d, s, T: _restart(d, s, T, kept))(drive)


def from_half(*xyz_rpy: float, seconds: float = np.inf) -> Disturbance:
    """Poses in another frame, from half of the drive on."""
    T_off = _offset(*xyz_rpy)
    return poses(lambda d, s, T: T_off @ T if d.half <= s < d.half + seconds else T)


def _nan(T: se3.Matrix) -> se3.Matrix:
    T = T.copy()
    T[0, 3] = np.nan
    return T


def _all_lasers(value: float) -> Callable[[Drive, float, np.ndarray], np.ndarray]:
    return lambda _, __, now: np.full_like(now, value)


DISTURBANCES: dict[str, Disturbance] = {
    "undisturbed": lambda drive: list(drive.events),
    "10 % of all messages dropped": dropped(0.1, *MOVING),
    "50 % of all messages dropped": dropped(0.5, *MOVING),
    "90 % of all messages dropped": dropped(0.9, *MOVING),
    "10 % of all messages twice": duplicated,
    "delays of up to 0.1 s, overtaking": delayed(0.1, *MOVING),
    "delays of the scans of up to 0.5 s": delayed(0.5, LEVEL, DOWN),
    "stamps of the scans off by 5 ms (sigma)": shifted_stamps(
        lambda d, e: d.random.normal(0.0, 0.005), LEVEL, DOWN
    ),
    "stamps of the odometry 50 ms late": shifted_stamps(lambda d, e: 0.05, ODOM),
    "odometry silent for 0.3 s": gap(0.3, ODOM),
    "odometry silent for 1.2 s": gap(1.2, ODOM),
    "odometry silent for 3 s": gap(3.0, ODOM),
    "scans silent for 3 s": gap(3.0, LEVEL, DOWN),
    "all silent for 3 s": gap(3.0, *MOVING),
    "3 s of NaN odometry": poses(
        lambda d, s, T: _nan(T) if d.half <= s < d.half + 3.0 else T
    ),
    "one odometry stamp 10 s ahead": shifted_stamps(
        lambda d, e: 10.0 if abs(d.seconds(e) - d.half) < 0.01 else 0.0, ODOM
    ),
    "clock jumps 5 s back": shifted_stamps(
        lambda d, e: -5.0 if d.seconds(e) >= d.half else 0.0, *MOVING
    ),
    "one wild pose, 720 m away": bursts(1, 1, 720.0, 30.0, 2.0),
    "10 spikes of 3 poses, pitched by 20 degrees": bursts(
        10, 3, 0.0, 0.0, 0.0, 0.0, np.radians(20.0), 0.0
    ),
    "10 spikes of 3 poses, pitched by 5 degrees": bursts(
        10, 3, 0.0, 0.0, 0.0, 0.0, np.radians(5.0), 0.0
    ),
    "10 spikes of 1 pose, 0.3 m up": bursts(10, 1, 0.0, 0.0, 0.3),
    "10 spikes of 3 poses, 0.3 m up": bursts(10, 3, 0.0, 0.0, 0.3),
    "10 spikes of 3 poses, 0.15 m up": bursts(10, 3, 0.0, 0.0, 0.15),
    "10 glitches of 5 poses, 0.5 m sideways": bursts(10, 5, 0.0, 0.5),
    "10 glitches of 5 poses, turned by 5 degrees": bursts(
        10, 5, 0.0, 0.0, 0.0, 0.0, 0.0, np.radians(5.0)
    ),
    "odometry begins at 0 again": restarted,
    "odometry jumps 1 m sideways": from_half(0.0, 1.0),
    "odometry jumps 1 m, and back after 5 s": from_half(0.0, 1.0, seconds=5.0),
    "both lasers repeat a scan for 1 s": stuck(1.0, LEVEL, DOWN),
    "both lasers repeat a scan for 5 s": stuck(5.0, LEVEL, DOWN),
    "laser down repeats a scan for 5 s": stuck(5.0, DOWN),
    "level laser dead from half on": gap(np.inf, LEVEL),
    "laser down dead from half on": gap(np.inf, DOWN),
    "both lasers see nothing for 5 s": ranges(_all_lasers(np.inf), LEVEL, DOWN, seconds=5.0),
    "both lasers see 0.3 m for 1 s": ranges(_all_lasers(0.3), LEVEL, DOWN, seconds=1.0),
    "5 % of the returns anywhere": ranges(
        lambda d, _, now: np.where(
            d.random.random(len(now)) < 0.05, d.random.uniform(0.1, 30.0, len(now)), now
        ), LEVEL, DOWN, begin=-np.inf,
    ),
    "laser down mounted 2 degrees off (pitch)": mounted_wrong("laser_down", 0.0, 2.0, 0.0),
    "level laser mounted 2 degrees off (pitch)": mounted_wrong("laser", 0.0, 2.0, 0.0),
    "level laser mounted 2 degrees off (yaw)": mounted_wrong("laser", 0.0, 0.0, 2.0),
}  # fmt: skip
