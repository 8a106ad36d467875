# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of which one is right, tracked side by side until one is alone.

A search of the whole map finds every pose that is as good. Each of them follows the odometry and is
held against the map as the robot goes on. One that fits worse than another by more than noise
explains is dropped, and two that meet are one.

- What the map does not know speaks for no place and against none: one is dropped if it fits worse
  even if all that is unknown there were as seen, and nothing that is unknown at the other were.
- Misfits are averaged over the last metre or so, not summed: where two places are alike, the map
  has the same small errors in every scan, and a sum would sooner or later decide for one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.long_term_map import LongTermMap
from heightmap25d_ros.localization.pose_filter import PoseFilter
from heightmap25d_ros.localization.registration import Registration
from heightmap25d_ros.localization.scan_filter import ScanFilter
from heightmap25d_ros.localization.scan_update import FIT

_NOISE = 0.0075  # [m] difference of misfits that noise, and where the map ends, explain
_SHARE = 0.25  # of a new misfit in the average
_LEAST_UPDATES = 4  # before one is dropped
_UNSEEN = 0.5  # of the largest distance: mean distance of returns at a wrong place
_SAME_PLACE, _SAME_YAW = 0.3, 0.1  # [m], [rad] between two that are one
_SAME_LEVEL = 0.5  # [m] of height between these: levels are farther apart

Estimate = PoseFilter | ScanFilter


@dataclass(eq=False, slots=True)
class Hypothesis:
    """One pose, and what the map has said of it.

    Attributes
    ----------
    estimate : PoseFilter or ScanFilter
    updates : int
    misfit : float [m]
        Mean distance from the map of all returns, averaged over the last updates: of those over
        nothing known as at a wrong place.
    least_misfit : float [m]
        The same, if these were as the map would have them.
    """

    estimate: Estimate
    updates: int = 0
    misfit: float = 0.0
    least_misfit: float = 0.0

    def take(self, found: Registration) -> None:
        """Take an update in."""
        self.updates += 1
        share = max(_SHARE, 1.0 / self.updates)
        least = found.known * found.residual
        self.least_misfit += share * (least - self.least_misfit)
        self.misfit += share * (least + (1.0 - found.known) * _UNSEEN * FIT - self.misfit)


class Hypotheses:
    """The poses that are left.

    Parameters
    ----------
    estimates : iterable of PoseFilter or ScanFilter
        One of them must be right.

    Examples
    --------
    >>> from heightmap25d_ros.params.sections import LocalizationParams
    >>> places = [
    ...     PoseFilter(LocalizationParams(), se3.from_xyz_rpy([x, 0, 0, 0, 0, 0]), np.eye(3))
    ...     for x in (0.0, 8.0)
    ... ]
    >>> len(Hypotheses(places))
    2
    """

    def __init__(self, estimates: Iterable[Estimate]) -> None:
        self._left = [Hypothesis(estimate) for estimate in estimates]

    def __len__(self) -> int:
        return len(self._left)

    @property
    def best(self) -> Hypothesis:
        """The one of the largest weight."""
        return min(self._left, key=lambda hypothesis: hypothesis.misfit)

    @property
    def weights(self) -> tuple[float, ...]:
        """Of all that are left, the largest first; their sum is 1.

        A misfit that is larger by as much as noise explains makes a pose e times less likely.
        """
        misfits = np.sort([hypothesis.misfit for hypothesis in self._left])
        weights = np.exp((misfits[:1] - misfits) / _NOISE)
        return tuple((weights / max(weights.sum(), 1.0)).tolist())

    def predict(self, T_odom_before: se3.Matrix, T_odom_base: se3.Matrix, distance: float) -> None:
        """The robot moved by odometry; poses (4, 4) of it before and after."""
        for hypothesis in self._left:
            hypothesis.estimate.predict(T_odom_before, T_odom_base, distance)

    def update(
        self, returns: Array, T_odom_base: se3.Matrix, long_term: LongTermMap
    ) -> Registration:
        """Hold each against the map's level that it is on; drop those that the map speaks against.

        Parameters
        ----------
        returns : (N, 3) float64 [m, odom]
        T_odom_base : (4, 4) float64
        long_term : LongTermMap
            With landmarks.

        Returns
        -------
        Registration
            Of the one that is the best now, or was the best if none is left.

        Raises
        ------
        TypeError
            If an estimate is no ScanFilter.
        """
        found = {}
        for hypothesis in self._left:
            if not isinstance(hypothesis.estimate, ScanFilter):
                raise TypeError("estimates: only a ScanFilter is updated by scans")
            landmarks = long_term.at(hypothesis.estimate.T_map_odom @ T_odom_base).landmarks
            assert landmarks is not None
            if not hypothesis.updates:
                hypothesis.estimate.begin_at_best(returns, T_odom_base, landmarks)
            found[id(hypothesis)] = hypothesis.estimate.prove(returns, T_odom_base, landmarks)
            hypothesis.take(found[id(hypothesis)])
        best = self.best
        most = best.misfit + _NOISE if best.updates >= _LEAST_UPDATES else np.inf
        kept: list[Hypothesis] = []
        at: list[Array] = []
        for hypothesis in sorted(self._left, key=lambda hypothesis: hypothesis.misfit):
            if hypothesis.least_misfit > most:
                continue
            x, y, z, _, _, yaw = se3.to_xyz_rpy(hypothesis.estimate.T_map_odom @ T_odom_base)
            if not any(_is_same(np.array([x, y, z, yaw]), other) for other in at):
                kept.append(hypothesis)
                at.append(np.array([x, y, z, yaw]))
        self._left = kept
        return found[id(kept[0] if kept else best)]

    def clear(self) -> None:
        """None is right."""
        self._left = []


def _is_same(pose: Array, other: Array) -> bool:
    x, y, z, yaw = pose - other
    is_turned = abs(np.angle(np.exp(1j * yaw))) >= _SAME_YAW
    return bool(np.hypot(x, y) < _SAME_PLACE and abs(z) < _SAME_LEVEL and not is_turned)
