# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Search for the robot's pose on all levels of a map, one after the other.

A place that several slices hold is found several times, and counts once; one that is as good on
another level makes the pose ambiguous, as another place on the same level does.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from heightmap25d_ros.localization.global_search import (
    Candidate,
    GlobalSearch,
    SearchResult,
    as_good_score,
    cautious_score,
)
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.registration import Reason
from heightmap25d_ros.localization.surface import Surface
from heightmap25d_ros.params.sections import RegistrationParams

_SAME_PLACE, _SAME_YAW = 0.3, 0.1  # [m], [rad] between two candidates that are one
_SAME_LEVEL = 0.5  # [m] of height between these: levels are farther apart
_CUT_OFF = (Reason.UNFINISHED, Reason.TOO_LARGE)


class LevelSearch:
    """A `GlobalSearch` on each surface of a map.

    Parameters
    ----------
    points : RegistrationPoints
    surfaces : sequence of Surface
        One at least.
    params : RegistrationParams
    """

    def __init__(
        self, points: RegistrationPoints, surfaces: Sequence[Surface], params: RegistrationParams
    ) -> None:
        self._searches = [GlobalSearch(points, surface, params) for surface in surfaces]
        self._params = params
        self._done = 0

    def step(self, seconds: float) -> bool:
        """Go on for about this time [s]; whether the search is done."""
        end = time.monotonic() + seconds
        while self._done < len(self._searches):
            if not self._searches[self._done].step(end - time.monotonic()):
                return False
            self._done += 1
        return True

    @property
    def result(self) -> SearchResult:
        """What was found.

        Raises
        ------
        ValueError
            Before `step` has returned true.
        """
        return joined([search.result for search in self._searches], self._params)


def joined(results: Sequence[SearchResult], params: RegistrationParams) -> SearchResult:
    """What searches on several levels found: the best pose, and all that are as good."""
    if len(results) == 1:
        return results[0]
    nodes = sum(result.nodes for result in results)
    for result in results:
        if result.reason in _CUT_OFF:
            return replace(result, nodes=nodes)
    found = [result for result in results if result.candidates]
    if not found:
        return replace(max(results, key=lambda result: result.overlap), nodes=nodes)
    best = min(found, key=lambda result: cautious_score(result.candidates[0], params))
    limit = as_good_score(best.candidates[0], params)
    as_good: list[Candidate] = []
    for candidate in (*best.candidates, *(c for result in found for c in result.candidates)):
        is_new = not any(_is_same(candidate, other) for other in as_good)
        if is_new and (candidate.score <= limit or not as_good):
            as_good.append(candidate)
    is_one_of_many = len(as_good) > 1 and best.reason is Reason.ACCEPTED
    reason = Reason.AMBIGUOUS if is_one_of_many else best.reason
    return replace(
        best,
        reason=reason,
        candidates=tuple(as_good),
        has_found_all=all(result.has_found_all for result in found),
        is_complete=all(result.is_complete for result in found),
        nodes=nodes,
    )


def _is_same(one: Candidate, other: Candidate) -> bool:
    x, y, yaw = one.offset - other.offset
    is_turned = abs(np.angle(np.exp(1j * yaw))) >= _SAME_YAW
    is_near = np.hypot(x, y) < _SAME_PLACE and abs(one.z - other.z) < _SAME_LEVEL
    return bool(is_near and not is_turned)
