# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The last metres of a drive, refined together while it goes on.

Where there are few walls, localization on the own map confirms its own errors, above all those of
the heading. So keyframes of the last metres are refined together (`bundle`), of which neither poses
nor surface are taken for known, and the submaps that were made there move with them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy import linalg

from heightmap25d_ros import se3
from heightmap25d_ros.localization.sliced_search import SlicedSearch
from heightmap25d_ros.params.sections import ScanFilterParams
from heightmap25d_ros.slam.bundle import NARROW, Keyframe, Stretch
from heightmap25d_ros.slam.submaps import Submap

_DISTANCE, _RETURNS = 0.24, 200  # [m] from one keyframe to the next; of each at most
_RECENT, _OLDER, _LEAST = 80, 120, 6  # keyframes: all of the last ones, every second of older ones
_FIRST = 0.12  # [m] tolerance from a patch
_STEPS = 4  # with the last one, at most


class Moves(NamedTuple):
    """What has moved.

    Attributes
    ----------
    motions : dict of int to (4, 4) float64
        Of submaps, by their number: a shift, and a turn by a yaw.
    newest : (4, 4) float64
        Likewise, of the robot.
    heading_bias : float [rad/m]
        Turn of the heading to be added to what the odometry tells.
    """

    motions: dict[int, se3.Matrix]
    newest: se3.Matrix
    heading_bias: float


class LiveRefinement:
    """Keeps keyframes of the last metres, and refines them together when it is asked to.

    Parameters
    ----------
    params : ScanFilterParams
    """

    def __init__(self, params: ScanFilterParams) -> None:
        self._params = params
        self._keyframes: list[Keyframe] = []
        self._kept = -np.inf
        self._work: _Work | None = None
        self._later: list[Keyframe] = []  # that were kept since that was begun
        self._is_even = False

    def is_due(self, distance: float) -> bool:
        """Whether it takes a keyframe a distance [m] after the drive began."""
        return distance - self._kept >= _DISTANCE

    def keep(self, keyframe: Keyframe, distance: float) -> None:
        """Keep a keyframe, a distance [m] after the drive began."""
        some = np.s_[:: 1 + len(keyframe.returns) // _RETURNS]
        returns, origins = keyframe.returns[some].copy(), keyframe.origins[some].copy()
        kept = keyframe._replace(returns=returns, origins=origins)
        self._kept = distance
        if self._work is None:
            self._append(kept)
        else:
            self._later.append(kept)

    def _append(self, keyframe: Keyframe) -> None:
        self._keyframes.append(keyframe)
        if len(self._keyframes) > _RECENT:
            self._is_even = not self._is_even
            if self._is_even:
                del self._keyframes[-_RECENT - 1]
        del self._keyframes[: -_RECENT - _OLDER]

    def begin(self, submaps: Sequence[Submap]) -> None:
        """Refine what was kept, unless that is under way; the submaps are all of the drive."""
        if self._work is None and len(self._keyframes) >= _LEAST:
            self._work = _Work(self._keyframes, submaps, self._params)

    def cancel(self) -> None:
        """The submaps have been moved otherwise."""
        self._end(self._keyframes)

    def step(self, seconds: float) -> Moves | None:
        """Go on for about this time [s]; what has moved, when it is done."""
        if self._work is None or not self._work.step(seconds):
            return None
        keyframes, moves = self._work.result
        self._end(keyframes)
        return moves

    def _end(self, keyframes: list[Keyframe]) -> None:
        self._work, self._keyframes = None, keyframes
        later, self._later = self._later, []
        for keyframe in later:
            self._append(keyframe)


class _Work(SlicedSearch[tuple[list[Keyframe], Moves | None]]):
    """One refinement, in slices: the keyframes where they belong in their submaps, and the moves.

    The next refinement begins with these. If it began with poses as localization has found them,
    its first pose, which stays, would turn all others.
    """

    def __init__(
        self, keyframes: list[Keyframe], submaps: Sequence[Submap], params: ScanFilterParams
    ) -> None:
        self._keyframes = keyframes
        self._submap_of = np.array([keyframe.submap for keyframe in keyframes])
        self._T_map_submap = np.array([submaps[k].T_map_submap for k in self._submap_of])
        T_submap_odom = np.array([keyframe.T_submap_odom for keyframe in keyframes])
        self._stretch = Stretch(keyframes, self._T_map_submap @ T_submap_odom, params)
        super().__init__()

    def _run(self) -> Iterator[tuple[list[Keyframe], Moves | None] | None]:
        try:
            for _ in self._stretch.solve(_FIRST, NARROW, _STEPS):
                yield None
        except linalg.LinAlgError:
            yield self._keyframes, None
            return
        motions, T_map_odom = self._stretch.motions(), self._stretch.T_map_odom()
        of_submaps = self._of_submaps(motions)
        if not of_submaps:
            yield self._keyframes, None
            return
        stays = np.eye(4)
        moved = np.array([of_submaps.get(int(number), stays) for number in self._submap_of])
        T_submap_odom = se3.inverse(moved @ self._T_map_submap) @ T_map_odom
        keyframes = [
            keyframe._replace(T_submap_odom=T)
            for keyframe, T in zip(self._keyframes, T_submap_odom, strict=True)
        ]
        yield keyframes, Moves(of_submaps, motions[-1], self._stretch.heading_bias)

    def _of_submaps(self, motions: se3.Matrix) -> dict[int, se3.Matrix]:
        """Submaps move as their middle keyframes; the first of them holds the others."""
        numbers, counts = np.unique(self._submap_of, return_counts=True)
        return {
            int(number): motions[np.flatnonzero(self._submap_of == number)[(count - 1) // 2]]
            for number, count in zip(numbers[1:], counts[1:], strict=True)
        }
