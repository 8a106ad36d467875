# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where frames are to one another, at any time that is known: a small tf2 buffer.

Nothing is extrapolated, and there is no identity for want of something better: a lookup is a
pose, or the reason why there is none.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.decode import Transform
from heightmap25d_ros.pipelines.drops import Drops
from heightmap25d_ros.pose_interpolation import interpolate, span

DEEPEST = 100
"""Frames above one another; what lies farther up is not looked at."""

MOST_FRAMES = 1000
"""Moving frames that nobody asked for, of which a little is kept; and static ones, in tens."""

_SAME = 1e-3  # [m, 1] up to which two transforms say the same

_KEPT = 64  # transforms of a frame that nobody has asked for

_IDENTITY = np.eye(4)[None]

JUMP_BACK_NS = 1_000_000_000
"""A stamp this far [ns] before the newest one means that time started over (a bag that loops)."""


class Missing(Enum):
    """Why a lookup has no pose: where its stamps lie as to the poses that are known."""

    UNCONNECTED = "without"
    TOO_EARLY = "before"
    NOT_YET = "after"
    GAP = "in a gap of"
    TORN = "beside a jump of"


class _Edge:
    """The poses of one frame in its parent, sorted by their stamps; one for ever if static."""

    __slots__ = ("is_static", "parent", "poses", "stamps")

    def __init__(self, parent: str, *, is_static: bool) -> None:
        self.parent = parent
        self.is_static = is_static
        self.stamps: list[int] = []
        self.poses: list[se3.Matrix] = []

    def add(self, stamp_ns: int, T: se3.Matrix, history_ns: int) -> None:
        if self.stamps and stamp_ns < self.stamps[-1] - JUMP_BACK_NS:
            self.stamps.clear()
            self.poses.clear()
        place = bisect_left(self.stamps, stamp_ns)
        if place < len(self.stamps) and self.stamps[place] == stamp_ns:
            return
        self.stamps.insert(place, stamp_ns)
        self.poses.insert(place, T)
        outdated = bisect_left(self.stamps, self.stamps[-1] - history_ns)
        del self.stamps[:outdated], self.poses[:outdated]

    def at(self, query_ns: NDArray[np.int64], max_gap_ns: int) -> se3.Matrix | Missing:
        if self.is_static:
            return self.poses[0][None]
        first, last = span(query_ns)
        if first < self.stamps[0]:
            return Missing.TOO_EARLY
        if last > self.stamps[-1]:
            return Missing.NOT_YET
        around = slice(bisect_right(self.stamps, first) - 1, bisect_left(self.stamps, last) + 1)
        stamps = np.array(self.stamps[around])
        if (stamps[1:] - stamps[:-1]).max(initial=0) > max_gap_ns:
            too_wide = np.diff(stamps) > max_gap_ns
            after = np.searchsorted(stamps, query_ns)
            between = stamps[after] != query_ns
            if too_wide[after[between] - 1].any():
                return Missing.GAP
        return interpolate(stamps, np.array(self.poses[around]), query_ns)


@dataclass(slots=True, eq=False)
class _Path:
    """The way between two frames, from their common ancestor down to both.

    Attributes
    ----------
    to_source, to_target : list of _Edge
    T_target_source : (1, 4, 4) float64 or None
        Where nothing moves, once it was looked up.
    """

    to_source: list[_Edge]
    to_target: list[_Edge]
    T_target_source: se3.Matrix | None = None

    @property
    def is_static(self) -> bool:
        """Whether nothing moves."""
        return all(edge.is_static for edge in (*self.to_source, *self.to_target))


class TransformBuffer:
    """The recent poses of all frames to one another.

    Other machines and arms share /tf. Of moving frames that no lookup has led over, only the last
    few messages are kept, unread; they are read when one does.

    Parameters
    ----------
    max_gap : float [s]
        Poses farther apart than this are not interpolated.
    history : float [s]
        How long poses are kept, seen from the newest one of their frame.
    dropped : Drops, optional
        Where to count what is malformed or closes a loop.
    """

    def __init__(
        self, *, max_gap: float, history: float = 30.0, dropped: Drops | None = None
    ) -> None:
        self._dropped = Drops() if dropped is None else dropped
        self._max_gap_ns = round(max_gap * 1e9)
        self._history_ns = round(history * 1e9)
        self._edges: dict[str, _Edge] = {}
        self._paths: dict[tuple[str, str], _Path] = {}  # looked up before
        self._missed: set[str] = set()  # frames that were asked for, and have no parent yet
        self._ends: set[str] = set()  # frames above others: what they are in matters to nobody
        self._unread: dict[str, deque[Any]] = {}
        self._contradicted: set[str] = set()  # static frames, of which that has been told
        self._refused: dict[str, dict[str, int]] = {}  # what stood in a frame's way, and its stamps

    def take(self, message: Any, *, is_static: bool) -> list[Transform]:
        """Take a tf2_msgs/TFMessage; what of it is used at once.

        Parameters
        ----------
        message : tf2_msgs.msg.TFMessage
        is_static : bool
            Whether it is of /tf_static.
        """
        stamped = message.transforms
        if not is_static:
            stamped = [one for one in stamped if self._is_used(one)]
        return self._decoded(stamped, is_static=is_static) if stamped else []

    def _decoded(
        self, stamped: Iterable[Any], *, is_static: bool, is_displacing: bool = True
    ) -> list[Transform]:
        transforms = self._dropped.decoded("transforms", decode.transforms, stamped) or []
        try:
            self.add(transforms, is_static=is_static, is_displacing=is_displacing)
        except InputError as error:
            fault = str(error).rpartition(": ")[2]
            self._dropped.record(f"transforms: {fault}", str(error))
        return transforms

    def _is_used(self, stamped: Any) -> bool:
        """Whether a transform is of a frame that is asked for; otherwise it is put aside."""
        child = stamped.child_frame_id.lstrip("/")
        if child in self._edges or child in self._missed:
            return True
        if child in self._ends and self._is_reversed(stamped):
            return True
        unread = self._unread.get(child)
        if unread is None:
            if len(child) > decode.LONGEST_FRAME:
                return True  # is refused
            if len(self._unread) >= MOST_FRAMES:
                del self._unread[next(iter(self._unread))]
            unread = self._unread[child] = deque(maxlen=_KEPT)
        unread.append(stamped)
        return False

    def _is_reversed(self, stamped: Any) -> bool:
        """Whether a transform puts a frame in one that may be below it, which is to be told."""
        return stamped.header.frame_id.lstrip("/") in self._edges

    def _end_at(self, frame: str) -> None:
        """No lookup leads on upward from a frame: only what reverses others matters of it."""
        if frame not in self._ends and len(self._ends) < MOST_FRAMES:
            self._ends.add(frame)
            unread = filter(self._is_reversed, self._unread.get(frame, ()))
            self._decoded(list(unread), is_static=False, is_displacing=False)

    def add(
        self,
        transforms: Iterable[Transform],
        *,
        is_static: bool = False,
        is_displacing: bool = True,
    ) -> None:
        """Take transforms in, in any order of stamps; of equal stamps the first one stays.

        A frame that comes with another parent moves there and its past is forgotten. So is the
        past of a frame whose stamps jump back by more than `JUMP_BACK_NS`. A static frame stays
        where it is, whatever is said of it as a moving one; the first contradiction is counted.

        A transform that would close a loop is refused, unless what stands in its way is weaker:
        moving frames yield to a static one, to a moving one if it comes twice while they are not
        heard, and a static transform to its own reverse.

        Parameters
        ----------
        transforms : iterable of Transform
        is_static : bool
            Whether they hold for all times, as those of /tf_static.
        is_displacing : bool
            Whether what is weaker yields to them.

        Raises
        ------
        InputError
            If a transform would close a loop, or there are too many frames; the others are taken.
        """
        faults = []
        for transform in transforms:
            child, edge = transform.child, self._edges.get(transform.child)
            if edge is not None and edge.is_static and not is_static:
                self._hold_against(edge, transform)
                continue
            if edge is None or edge.parent != transform.parent or is_static:
                loop = self._loop(transform)
                if loop and is_displacing:
                    loop = self._cut(transform.child, loop, is_static=is_static)
                fault = "closes a loop" if loop is not None else self._too_many(child)
                if fault:
                    faults.append(f"transform {transform.parent} -> {child}: {fault}")
                    continue
                edge = self._edges[child] = _Edge(transform.parent, is_static=is_static)
                self._paths.clear()
                self._missed.discard(child)
                self._unread.pop(child, None)
            edge.add(transform.stamp_ns, transform.T, self._history_ns)
        if faults:
            raise InputError(faults[0])

    def _hold_against(self, edge: _Edge, transform: Transform) -> None:
        """Count the first transform that contradicts a static one."""
        is_same = edge.parent == transform.parent and np.allclose(
            edge.poses[0], transform.T, atol=_SAME
        )
        if not is_same and transform.child not in self._contradicted:
            self._contradicted.add(transform.child)
            self._dropped.record(
                "transforms: contradict a static one",
                f"{transform.parent} -> {transform.child}; it is static in {edge.parent}",
            )

    def _too_many(self, child: str) -> str:
        """Whether there is no room for a frame, in words."""
        is_new = child not in self._edges
        return "too many frames" if is_new and len(self._edges) >= 10 * MOST_FRAMES else ""

    def _loop(self, transform: Transform) -> list[str] | None:
        """The frames whose transforms a transform would close to a loop; None if it does not."""
        frames = [transform.parent]
        while frames[-1] != transform.child:
            edge = self._edges.get(frames[-1])
            if edge is None or len(frames) > DEEPEST:
                return None
            frames.append(edge.parent)
        return frames[:-1]

    def _cut(self, child: str, loop: list[str], *, is_static: bool) -> list[str] | None:
        """Forget what is weaker in a loop than a transform of a child; the loop if nothing is."""
        moving = {f: self._edges[f].stamps[-1] for f in loop if not self._edges[f].is_static}
        if is_static:
            weaker = list(moving) or (loop if len(loop) == 1 else [])
        else:
            before, self._refused[child] = self._refused.get(child, {}), moving
            weaker = [frame for frame, stamp in moving.items() if before.get(frame) == stamp]
        for frame in weaker:
            parent = self._edges.pop(frame).parent
            self._paths.clear()
            self._dropped.record(
                "transforms: closed a loop with a better one", f"{parent} -> {frame}"
            )
        return None if weaker else loop

    def forget_after(self, stamp_ns: int) -> None:
        """Forget the frames that move and reach beyond a stamp: time started over there."""
        self._edges = {
            child: edge
            for child, edge in self._edges.items()
            if edge.is_static or edge.stamps[-1] <= stamp_ns
        }
        self._paths.clear()
        self._unread.clear()

    def clear(self) -> None:
        """Forget all frames."""
        self._edges.clear()
        self._paths.clear()

    def lookup(
        self, target: str, source: str, stamps_ns: NDArray[np.int64]
    ) -> se3.Matrix | Missing:
        """Pose of the source frame in the target frame at each stamp.

        Parameters
        ----------
        target, source : str
        stamps_ns : (N,) int64 [ns]

        Returns
        -------
        (N, 4, 4) float64, or (1, 4, 4) where nothing moves, or Missing
            A `Missing` that time can mend (`NOT_YET`) only where none is final.
        """
        path = self._paths.get((target, source)) or self._path(target, source)
        if path is None:
            return Missing.UNCONNECTED
        if path.T_target_source is not None:
            return path.T_target_source
        found = self._between(path, stamps_ns)
        if not isinstance(found, Missing) and path.is_static:
            path.T_target_source = found
        return found

    def _between(self, path: _Path, stamps_ns: NDArray[np.int64]) -> se3.Matrix | Missing:
        T_common_source = self._along(path.to_source, stamps_ns)
        T_common_target = self._along(path.to_target, stamps_ns)
        if isinstance(T_common_source, Missing) or isinstance(T_common_target, Missing):
            return _final_first([T_common_source, T_common_target])
        if not path.to_target:
            return T_common_source
        return se3.compose(se3.inverse(T_common_target), T_common_source)

    def _path(self, target: str, source: str) -> _Path | None:
        below = self._below_common(target, source)
        if below is None:
            return None
        down, aside = ([self._edges[frame] for frame in reversed(frames)] for frames in below)
        path = self._paths[target, source] = _Path(down, aside)
        return path

    def chain(self, target: str, source: str) -> list[str]:
        """The frames whose poses in their parents lie between two frames; none if unconnected."""
        below = self._below_common(target, source)
        return [] if below is None else [*below[0], *below[1]]

    def _below_common(self, target: str, source: str) -> tuple[list[str], list[str]] | None:
        """From the source, and from the target, upward to below their common ancestor."""
        above_source = self._upward(source, target)
        if above_source[-1] == target:
            self._end_at(target)
            return above_source[:-1], []
        above_target = self._upward(target)
        common = next((frame for frame in above_source if frame in above_target), None)
        if common is None:
            return None
        return (
            above_source[: above_source.index(common)],
            above_target[: above_target.index(common)],
        )

    def is_connected(self, target: str, source: str) -> bool:
        """Whether two frames have a common ancestor, at whatever time."""
        return self._upward(target)[-1] == self._upward(source)[-1]

    def newest_stamp(self, target: str, source: str) -> int | None:
        """Newest stamp [ns] at which a lookup has a pose, as tf2's; None where nothing moves."""
        edges = [self._edges[frame] for frame in self.chain(target, source)]
        return min((edge.stamps[-1] for edge in edges if not edge.is_static), default=None)

    def _upward(self, frame: str, end: str = "") -> list[str]:
        """A frame, its parent, and so on to an end or the root; they are used from now on."""
        frames = [frame]
        while len(frames) <= DEEPEST and frames[-1] != end:
            edge = self._edges.get(frames[-1]) or self._read(frames[-1])
            if edge is None:
                break
            frames.append(edge.parent)
        return frames

    def _read(self, frame: str) -> _Edge | None:
        """Read what was put aside of a frame; its transforms are used from now on."""
        unread = self._unread.pop(frame, ())
        if not unread and len(self._missed) < MOST_FRAMES:
            self._missed.add(frame)
        # A lookup is under way, whose frames must stay.
        self._decoded(unread, is_static=False, is_displacing=False)
        return self._edges.get(frame)

    def _along(self, edges: list[_Edge], stamps_ns: NDArray[np.int64]) -> se3.Matrix | Missing:
        """Pose of the last frame of a path downward in the parent of its first one."""
        outcomes = [edge.at(stamps_ns, self._max_gap_ns) for edge in edges]
        poses = [T for T in outcomes if not isinstance(T, Missing)]
        if len(poses) < len(outcomes):
            return _final_first(outcomes)
        return reduce(se3.compose, poses) if poses else _IDENTITY


def _final_first(outcomes: Sequence[se3.Matrix | Missing]) -> Missing:
    missing = [outcome for outcome in outcomes if isinstance(outcome, Missing)]
    return next((reason for reason in missing if reason is not Missing.NOT_YET), missing[0])
