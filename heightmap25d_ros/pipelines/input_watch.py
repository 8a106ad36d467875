# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is noticed about the scans and poses that come: numbers from which `self_check` judges."""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.io.decode import Odometry
from heightmap25d_ros.mapping.cloud import Cloud
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.mapping.sensor_model import count_returns
from heightmap25d_ros.pipelines.drops import BELOW_RANGE_MIN, BEYOND_RANGE_MAX, Drops
from heightmap25d_ros.pipelines.mount_watch import MountWatch
from heightmap25d_ros.pipelines.repeated_scans import difference

RETURNS, BEYOND, BELOW, AT_MAX = "returns", "beyond range_max", "below range_min", "at range_max"
"""What is counted of the ranges: finite ones that are returns, and where they lie."""

REPEATED = "repeated"
"""Scans that are counted: the same ranges again and again, while the robot moved."""

LOST = "lost"
"""Scans that are counted: they did not come, by the stamps of those before and after them."""

_STEADY = 10  # times in a row between two scans that are the same: what is missing is known
_SAME_PERIOD = 0.2  # share by which these may differ
_PERIOD_SHARE = 0.02  # of a new one in their mean
_SHORTEST = 0.002  # [s] between two scans of a laser: parts of one come closer together
_PAUSE = 2.0  # [s] without scans: the laser was switched off, or the bag has a gap

_REPEATS = 10  # scans in a row with the same ranges that are no accident
_COMPARED = 1000  # points of a cloud that are compared with those of the one before
_MOVED = 0.1  # [m, rad] after which no laser measures the same

_RECENT = 100
"""Scans of each laser from which times are estimated."""

_ENOUGH = 10
"""Scans from which on times are estimated at all."""

AHEAD, BEHIND = 0.15, 0.25
"""Offset between the stamps of scans and of odometry from which on it is told [s].

Both are late by nature: odometry by its period and by filters, scans by their sweep.
"""

LONGER = 1.25
"""A scan that lasts longer than this share of the time to the next one is told."""


class Flatness:
    """Counts poses of the odometry for as long as all of them lie exactly in the plane."""

    def __init__(self) -> None:
        self.poses = 0
        self._is_flat = True

    def observe(self, z: float, x: float, y: float) -> None:
        """Look at a pose: its z, and x and y of its quaternion, or of its z axis."""
        if not self._is_flat:
            return
        self._is_flat = z == x == y == 0.0
        self.poses = self.poses + 1 if self._is_flat else 0


@dataclass(slots=True)
class _Repeat:
    """Ranges of a laser, where the robot was when they came, and how often they have come."""

    ranges: NDArray[np.float32]
    T_odom_base: se3.Matrix
    count: int = 1


@dataclass(slots=True)
class _Rhythm:
    """The newest stamp of a laser, and the time between two scans that has been usual."""

    stamp_ns: int
    period_ns: float = 0.0
    steady: int = 0
    odd: int = 0

    def lost_before(self, stamp_ns: int) -> int:
        """How many scans are missing before the next one; none of a laser without a rhythm."""
        time_ns, self.stamp_ns = stamp_ns - self.stamp_ns, stamp_ns
        lost = round(time_ns / self.period_ns) - 1 if self.period_ns else 0
        away = abs(time_ns - (lost + 1) * self.period_ns)
        is_whole = away <= (_SAME_PERIOD + _PERIOD_SHARE * max(lost, 0)) * self.period_ns
        is_known = self.steady >= _STEADY and self.odd < _STEADY and lost >= 0 and is_whole
        if is_known:
            self.odd = self.odd + 1 if lost else 0
            self.period_ns += 0.0 if lost else _PERIOD_SHARE * (time_ns - self.period_ns)
            return lost if time_ns < _PAUSE * 1e9 else 0
        is_same = abs(time_ns - self.period_ns) <= _SAME_PERIOD * self.period_ns
        is_period = is_same and time_ns > _SHORTEST * 1e9
        self.steady, self.odd = (self.steady + 1 if is_period else 0), 0
        before = self.period_ns if is_period else time_ns
        self.period_ns = max(before + (time_ns - before) / (self.steady + 1), 0.0)
        return 0


class InputWatch:
    """Looks at scans as they come, and at their ranges as they are used.

    Attributes
    ----------
    counts : Counter of str
        Returns of used scans, and how many of them lie out of range; scans that are repeated.
    scans, used : int
        Scans that came, and those that were used.
    flatness : Flatness
    mounts : MountWatch
    clouds : dict of topic to str
        How its newest cloud was read.
    """

    def __init__(self) -> None:
        self.clouds: dict[str, str] = {}
        self._new_layouts: list[str] = []
        self.counts: Counter[str] = Counter()
        self.scans = self.used = 0
        self.flatness = Flatness()
        self.mounts = MountWatch()
        self._examples: dict[str, str] = {}
        self._rhythms: dict[str, _Rhythm] = {}
        self._sweeps: dict[str, deque[tuple[int, float]]] = defaultdict(
            lambda: deque(maxlen=_RECENT)
        )
        self._offsets: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=_RECENT))
        self._odometry: deque[int] = deque(maxlen=_RECENT)
        self._T_odom_base = np.eye(4)
        self._repeats: dict[str, _Repeat] = {}

    def observe_odometry(self, odometry: Odometry) -> None:
        """A pose has come."""
        self._odometry.append(odometry.stamp_ns)
        T = self._T_odom_base = odometry.T
        self.flatness.observe(T[2, 3], T[0, 2], T[1, 2])

    def observe_scan(self, topic: str, scan: Scan | Cloud, sweep_ns: int) -> None:
        """A scan or a cloud has come, after the newest pose; its beams took so long [ns]."""
        self.scans += 1
        self._sweeps[topic].append((scan.stamp_ns, sweep_ns * 1e-9))
        self._observe_lost(topic, scan.stamp_ns)
        if self._odometry:
            self._offsets[topic].append((scan.stamp_ns - self._odometry[-1]) * 1e-9)
        if isinstance(scan, Cloud):
            self._note_layout(topic, scan.told)
            self._observe_repeat(topic, scan.points[:: 1 + len(scan.points) // _COMPARED])
        else:
            self._observe_repeat(topic, scan.ranges)

    def _observe_lost(self, topic: str, stamp_ns: int) -> None:
        """Count scans that were sent and did not come: DDS tells of none that it drops."""
        rhythm = self._rhythms.get(topic)
        if rhythm is None:
            self._rhythms[topic] = _Rhythm(stamp_ns)
            return
        lost = rhythm.lost_before(stamp_ns)
        if lost > 0:
            self.counts[LOST] += lost
            self._examples[LOST] = f"the last ones of {topic}"

    def _note_layout(self, topic: str, told: str) -> None:
        if self.clouds.get(topic) != told:
            self.clouds[topic] = told
            self._new_layouts.append(f"{topic}: {told}")

    def new_layouts(self) -> list[str]:
        """How clouds are read since the last call: a line for each topic where that is new."""
        new, self._new_layouts = self._new_layouts, []
        return new

    def _observe_repeat(self, topic: str, ranges: NDArray[np.float32]) -> None:
        """Count a scan whose ranges are those of the ones before, which the robot has left."""
        before = self._repeats.get(topic)
        is_same = before is not None and not difference(before.ranges, ranges)[0]
        if before is None or not is_same or not np.isfinite(ranges).any():
            self._repeats[topic] = _Repeat(ranges, self._T_odom_base)
            return
        before.count += 1
        moved = np.abs(self._T_odom_base - before.T_odom_base).max()
        if before.count >= _REPEATS and moved > _MOVED:
            self.counts[REPEATED] += 1
            self._examples[REPEATED] = f"{topic}: {before.count} scans in a row are the same"

    def observe_ranges(self, scan: Scan | Cloud, convention: str, dropped: Drops) -> None:
        """A scan is used; count the returns that lie out of its range. A cloud has none.

        Parameters
        ----------
        scan : Scan or Cloud
        convention : str
            Parameter ``sensor.no_return``.
        dropped : Drops
        """
        self.used += 1
        if isinstance(scan, Cloud):
            return
        places = {
            BEYOND: (np.greater, scan.range_max, "a range_max of"),
            BELOW: (np.less, scan.range_min, "a range_min of"),
            AT_MAX: (np.equal, scan.range_max, "range_max"),
        }
        returns, *counts = count_returns(scan, convention)
        self.counts[RETURNS] += returns
        for (place, (is_there, limit, told)), count in zip(places.items(), counts, strict=True):
            if count:
                self.counts[place] += count
                is_one = np.isfinite(scan.ranges) & is_there(scan.ranges, np.float32(limit))
                median = float(np.median(scan.ranges[is_one].astype(np.float64)))
                self._examples[place] = f"the median is {median:.4g} m against {told} {limit:g} m"
        examples = self._examples
        dropped.record(BEYOND_RANGE_MAX, examples.get(BEYOND, ""), counts[0])
        dropped.record(BELOW_RANGE_MIN, examples.get(BELOW, ""), counts[1])

    def example(self, place: str) -> str:
        """Of the returns in one of these places: the newest scan's median and the limit.

        Of `REPEATED`: the laser, and how many there are; of `LOST`: the laser.
        """
        return self._examples.get(place, "")

    def sweep_fault(self) -> str:
        """Which laser's scans last longer than the time to the next one; empty where none do."""
        for topic, seen in self._sweeps.items():
            stamps = [stamp for stamp, _ in seen]
            if len(seen) < _ENOUGH or max(stamps) == min(stamps):
                continue
            period = (max(stamps) - min(stamps)) * 1e-9 / (len(stamps) - 1)
            sweep = float(np.median([sweep for _, sweep in seen]))
            if sweep > LONGER * period:
                return (
                    f"{topic}: by its time_increment a scan lasts {sweep:.3g} s, and the next one "
                    f"comes after {period:.3g} s"
                )
        return ""

    def offset_fault(self) -> str:
        """How far a laser's stamps are off the odometry's; empty where they go together."""
        if len(self._odometry) < _ENOUGH:
            return ""
        period = float(np.median(np.diff(self._odometry))) * 1e-9
        for topic, offsets in self._offsets.items():
            # The newest pose is half a period old on average when a scan comes.
            offset = float(np.median(offsets)) - period / 2
            if len(offsets) >= _ENOUGH and not -BEHIND - period <= offset <= AHEAD + period:
                side = "ahead of" if offset > 0 else "behind"
                return f"{topic}: scan stamps are {abs(offset):.2f} s {side} the odometry's"
        return ""
