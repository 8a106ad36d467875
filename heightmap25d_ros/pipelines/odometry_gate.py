# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of the odometry that no robot can have driven: skipped, bridged, or reported.

A pose is judged by the motion that it implies since the last one. An implausible one waits for the
next: a single wild pose is skipped, a jump that stays begins a new frame of the odometry. Where
hardly any time lies in it, the robot has not moved, its driver started anew: the new frame follows
by continuity. Where the robot may have moved, the frame stays unknown.

Poses in a frame of another name are refused, unless for a while none comes in the present one: then
it was the present one that was odd, or the driver was replaced, and that is a jump as well.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.io.decode import Odometry
from heightmap25d_ros.params.sections import OdometryParams
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pipelines.transform_buffer import JUMP_BACK_NS

SKIPPED = "odometry: implausible pose"
BRIDGED = "odometry: jumped, the robot stayed"
UNKNOWN = "odometry: jumped, the pose is unknown"
RETURNED = "odometry: came back after a jump"
JUMPS = (SKIPPED, BRIDGED, UNKNOWN, RETURNED)
"""Reasons under which the gate counts what it notices."""

_AT_ORIGIN = 1e-6  # [m, rad] as near to the identity is a driver's first pose, not a place
_LEVELLED = 0.03  # [rad] of tilt in a jump up to which roll and pitch are gravity's on both sides
_REPLACED_NS = 10**9  # of poses in a frame of another name, after which it is the present one
_SHORTEST = 1_000_000  # [ns] poses that are closer in time do not tell a speed
_MOST = 100  # frames and gaps that are remembered


@dataclass(frozen=True, slots=True, kw_only=True)
class Jump:
    """A change of the odometry's frame.

    Attributes
    ----------
    before, after : Odometry
        The last pose in the old frame and the first one in the new frame.
    T_before_after : (4, 4) float64
        Pose of the new frame in the old one, if the robot has not left its path.
    is_known : bool
        Whether it has not: hardly any time lies in the jump.
    detail : str
        The motion that the jump would have been.
    """

    before: Odometry
    after: Odometry
    T_before_after: se3.Matrix
    is_known: bool
    detail: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Frame:
    """A frame of the odometry: where it lies in the first one, from a stamp on."""

    begin_ns: int
    T_first_odom: se3.Matrix
    is_known: bool = True
    unseen_ns: int = 0
    """Time in which the robot may have moved before the frame began."""


class OdometryGate:
    """Admits the poses of the odometry that are plausible, and keeps track of its frames.

    Parameters
    ----------
    params : OdometryParams
    dropped : Drops
        Where to count what is implausible.

    Attributes
    ----------
    jump : Jump or None
        The newest one.
    """

    def __init__(self, params: OdometryParams, dropped: Drops) -> None:
        self._params = params
        self._dropped = dropped
        self._bridge_ns = round(params.bridge_time * 1e9)
        self.restart()

    def restart(self, same_from_ns: int | None = None) -> None:
        """Time started over: nothing of before counts.

        From a stamp [ns] on the odometry's frame is the newest one of before, where one is given.
        """
        if same_from_ns is None:
            self.jump: Jump | None = None
            self._frames = [_Frame(begin_ns=0, T_first_odom=np.eye(4))]
        else:
            newest = self._frames[-1]
            self._frames = [replace(newest, begin_ns=min(newest.begin_ns, same_from_ns))]
        self._last: Odometry | None = None
        self._previous: Odometry | None = None
        self._suspect: tuple[Odometry, str] | None = None
        self._other: Odometry | None = None
        self._gaps: deque[tuple[int, int]] = deque(maxlen=_MOST)

    def refusal(self, odometry: Odometry, base_frame: str) -> tuple[str, str] | None:
        """Why a pose is of no use, and an example; None where it has to be admitted."""
        child, frame, stamp = odometry.child_frame_id, odometry.frame_id, odometry.stamp_ns
        if child != base_frame:
            return "odometry: of another frame", f"of {child!r}, not of {base_frame!r}"
        if frame == child:
            return "odometry: of a frame in itself", repr(child)
        if self._last is None:
            return None
        if frame != self._last.frame_id and not self._has_replaced(odometry):
            return "odometry: in another frame", f"in {frame!r}, not in {self._last.frame_id!r}"
        newest = self._last.stamp_ns
        if newest - JUMP_BACK_NS <= stamp < newest:
            return "odometry: out of order", ""
        waiting = newest if self._suspect is None else self._suspect[0].stamp_ns
        is_seen = stamp in (newest, waiting)
        return ("odometry: stamp seen before", "") if is_seen else None

    def _has_replaced(self, odometry: Odometry) -> bool:
        """Whether poses in a frame of another name have long come alone."""
        other = self._other
        is_first = other is None or other.frame_id != odometry.frame_id
        if other is None or is_first or odometry.stamp_ns < other.stamp_ns:
            self._other = odometry
            return False
        return odometry.stamp_ns > other.stamp_ns + _REPLACED_NS

    def admit(self, odometry: Odometry) -> list[Odometry]:
        """The poses to use now, in order: this one, with the one before it, or none yet."""
        last = self._last
        if last is None:
            return self._use(odometry)
        if odometry.frame_id != last.frame_id:
            return self._replace_frame(last, odometry)
        strain, detail = self._strain(last.T, odometry.T, odometry.stamp_ns - last.stamp_ns)
        suspect, first_detail = self._suspect or (None, "")
        from_suspect = math.inf
        if suspect is not None:
            time_ns = odometry.stamp_ns - suspect.stamp_ns
            from_suspect, _ = self._strain(suspect.T, odometry.T, time_ns)
        if strain <= min(1.0, from_suspect):
            if suspect is not None:
                self.finish()
                self._gaps.append((last.stamp_ns, odometry.stamp_ns))
            return self._use(odometry)
        if strain > 1.0 and self._comes_back(last, odometry, detail):
            return self._use(odometry)
        if suspect is None or from_suspect > 1.0:
            self.finish()
            self._suspect = odometry, detail
            return []
        return self._follow_jump(last, suspect, odometry, first_detail)

    def _follow_jump(
        self, last: Odometry, first: Odometry, second: Odometry, detail: str
    ) -> list[Odometry]:
        """A jump that stays: its second pose goes on from its first one."""
        self._suspect = None
        if self._previous is None:  # one pose does not outvote two
            present = replace(self._frames[-1], begin_ns=0)
            self._change_frame(SKIPPED, present, last, first, detail)
        else:
            self._begin_frame(last, first, second, detail)
        return [*self._use(first), *self._use(second)]

    def _replace_frame(self, last: Odometry, odometry: Odometry) -> list[Odometry]:
        """Poses in a frame of another name go on, from where nobody knows."""
        self.finish()
        detail = f"from {last.frame_id!r} to {odometry.frame_id!r}"
        if self._previous is None:  # one pose does not outvote many
            present = replace(self._frames[-1], begin_ns=0)
            self._change_frame(SKIPPED, present, last, odometry, detail)
        else:
            self._begin_frame(last, odometry, odometry, detail)
        return self._use(odometry)

    def is_continuous(self, a: Odometry, b: Odometry) -> bool:
        """Whether a robot can have both poses in hardly any time, whatever their stamps say."""
        return self._strain(a.T, b.T, 0)[0] <= 1.0

    def finish(self) -> None:
        """What still waits is skipped."""
        if self._suspect is not None:
            self._dropped.record(SKIPPED, self._suspect[1])
            self._suspect = None

    def is_torn(self, first_ns: int, last_ns: int) -> bool:
        """Whether an implausible pose or a jump lies within a time."""
        return any(first_ns < end and last_ns > begin for begin, end in self._gaps)

    def T_first_odom(self, stamp_ns: int) -> se3.Matrix:
        """Pose (4, 4) of the odometry's frame at a stamp in the first one."""
        return self._frame(stamp_ns).T_first_odom

    def is_known(self, stamp_ns: int) -> bool:
        """Whether the frame at a stamp has a known pose in the first one."""
        return self._frame(stamp_ns).is_known

    @property
    def unknown_since_ns(self) -> int | None:
        """Since when the pose is unknown [ns]; None where it is known."""
        newest = self._frames[-1]
        return None if newest.is_known else newest.begin_ns

    def locate(self) -> None:
        """Others tell the pose of the newest frame from now on."""
        self._frames = [replace(self._frames[-1], is_known=True, unseen_ns=0)]

    def begin_anew(self) -> None:
        """The newest frame is the first one; what still waits of before is not used."""
        if len(self._frames) == 1 and self._frames[0].is_known and not self._frames[0].begin_ns:
            return
        begin = self._frames[-1].begin_ns
        self._frames = [_Frame(begin_ns=0, T_first_odom=np.eye(4))]
        self._gaps.append((0, begin))

    def _frame(self, stamp_ns: int) -> _Frame:
        index = bisect_right(self._frames, stamp_ns, key=lambda frame: frame.begin_ns)
        return self._frames[max(index - 1, 0)]

    def _use(self, odometry: Odometry) -> list[Odometry]:
        self._previous, self._last, self._other = self._last, odometry, None
        return [odometry]

    def _strain(self, T_a: se3.Matrix, T_b: se3.Matrix, time_ns: int) -> tuple[float, str]:
        """Motion between two poses as a share of what is plausible, and which motion it is."""
        params, seconds = self._params, abs(time_ns) * 1e-9
        x, y, z = (T_b[:3, 3] - T_a[:3, 3]).tolist()
        step, (tilt, turn) = math.hypot(x, y, z), _tilt_and_turn(T_a, T_b)
        near, small = params.position_tolerance, params.angle_tolerance
        strains = (
            (step / (near + params.max_speed * seconds), f"{step:.3g} m"),
            (abs(z) / (near + params.max_climb_rate * seconds), f"{z:+.3g} m of height"),
            (tilt / (small + params.max_tilt_rate * seconds), f"{tilt:.3g} rad of roll and pitch"),
            (turn / (small + params.max_turn_rate * seconds), f"{turn:.3g} rad of yaw"),
        )
        strain, motion = max(strains)
        has_moved = step + tilt + turn > near
        if strain <= 1.0 and has_moved and np.abs(T_b - np.eye(4)).max() < _AT_ORIGIN:
            strain, motion = math.inf, f"{step:.3g} m to the origin"
        return strain, f"{motion} in {seconds:.3g} s"

    def _comes_back(self, last: Odometry, odometry: Odometry, detail: str) -> bool:
        """Whether a pose goes on in an earlier frame, which is the present one again then."""
        newest = self._frames[-1]
        T_first_base = newest.T_first_odom @ last.T
        time_ns = odometry.stamp_ns - last.stamp_ns + newest.unseen_ns
        for frame in reversed(self._frames[:-1]):
            T_first_now = frame.T_first_odom @ odometry.T
            if self._strain(T_first_base, T_first_now, time_ns)[0] <= 1.0:
                self._suspect = None
                begun = replace(frame, begin_ns=odometry.stamp_ns)
                self._change_frame(RETURNED, begun, last, odometry, detail)
                return True
        return False

    def _begin_frame(self, last: Odometry, first: Odometry, second: Odometry, detail: str) -> None:
        """The first pose after a jump is in another frame than the last one before it."""
        time_ns = first.stamp_ns - last.stamp_ns
        is_bridged = time_ns <= self._bridge_ns
        present = self._frames[-1]
        T_last_first = np.eye(4)
        if is_bridged:
            rates = [_rate(self._previous, last), _rate(first, second)]
            known = [rate for rate in rates if rate is not None]
            if known:
                T_last_first = se3.from_xyz_rpy(np.mean(known, axis=0) * time_ns)
        T_before_after = _joined(last.T @ T_last_first, first.T)
        frame = _Frame(
            begin_ns=first.stamp_ns,
            T_first_odom=present.T_first_odom @ T_before_after,
            is_known=is_bridged and present.is_known,
            unseen_ns=present.unseen_ns + (0 if is_bridged else time_ns),
        )
        self._change_frame(BRIDGED if is_bridged else UNKNOWN, frame, last, first, detail)

    def _change_frame(
        self, reason: str, frame: _Frame, last: Odometry, first: Odometry, detail: str
    ) -> None:
        self._dropped.record(reason, detail)
        self._gaps.append((last.stamp_ns, first.stamp_ns))
        T_before_after = se3.inverse(self._frames[-1].T_first_odom) @ frame.T_first_odom
        if reason == SKIPPED:  # the frame was never another one
            T_before_after = _joined(last.T, first.T)
        self.jump = Jump(
            before=last,
            after=first,
            T_before_after=T_before_after,
            is_known=frame.is_known,
            detail=detail,
        )
        self._frames = [*self._frames[-_MOST:], frame]


def _tilt_and_turn(T_a: se3.Matrix, T_b: se3.Matrix) -> tuple[float, float]:
    """Angles [rad] between the vertical axes of two poses, and about them."""
    R = T_a[:3, :3].T @ T_b[:3, :3]
    tilt = math.atan2(math.hypot(R[0, 2], R[1, 2]), R[2, 2])
    return tilt, abs(math.atan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1]))


def _rate(a: Odometry | None, b: Odometry) -> se3.Matrix | None:
    """(6,): motion along and about the axes of the robot per nanosecond; None where unknown."""
    if a is None or b.stamp_ns - a.stamp_ns < _SHORTEST:
        return None
    motion = se3.to_xyz_rpy(se3.inverse(a.T) @ b.T)
    return np.asarray(motion / (b.stamp_ns - a.stamp_ns))


def _joined(T_a_base: se3.Matrix, T_b_base: se3.Matrix) -> se3.Matrix:
    """``T_a_b`` of two frames from a pose in each: level, unless it is tilted in one of them."""
    T_a_b = T_a_base @ se3.inverse(T_b_base)
    roll, pitch, yaw = se3.to_xyz_rpy(T_a_b)[3:]
    if math.hypot(roll, pitch) > _LEVELLED:
        return np.asarray(T_a_b)
    level = se3.from_xyz_rpy([0.0, 0.0, 0.0, 0.0, 0.0, yaw])
    level[:3, 3] = T_a_base[:3, 3] - level[:3, :3] @ T_b_base[:3, 3]
    return level
