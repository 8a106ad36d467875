# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of which one is right, tracked side by side until one is alone.

A search of the whole map finds every pose that is as good. Each of them follows the odometry and is
held against the map as the robot goes on; its weight falls with the misfit. One that the map
contradicts again and again is dropped, so is one of hardly any weight, and two that meet are one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.landmarks import Landmarks
from heightmap25d_ros.localization.pose_filter import PoseFilter
from heightmap25d_ros.localization.registration import Registration
from heightmap25d_ros.localization.scan_filter import ScanFilter
from heightmap25d_ros.localization.scan_update import FIT
from heightmap25d_ros.localization.tracking_state import CONTRADICTIONS

_LEAST_WEIGHT = 0.01  # over that of the best one
_REFUSALS = 3  # contradictions in a row
_SAME_PLACE, _SAME_YAW = 0.3, 0.1  # [m], [rad] between two that are one

Estimate = PoseFilter | ScanFilter


@dataclass(eq=False, slots=True)
class Hypothesis:
    """One pose, and what the map has said of it.

    Attributes
    ----------
    estimate : PoseFilter or ScanFilter
    contradicted : int
        Updates in a row that contradict the map.
    misfit : float [m]
        Sum of the mean distances from the map.
    """

    estimate: Estimate
    contradicted: int = 0
    misfit: float = 0.0

    def take(self, found: Registration) -> None:
        """Take an update in; what the map does not cover is as far off as can be."""
        self.misfit += found.overlap * found.residual + (1.0 - found.overlap) * FIT
        self.contradicted = self.contradicted + 1 if found.reason in CONTRADICTIONS else 0


class Hypotheses:
    """The poses that are left.

    Parameters
    ----------
    estimates : iterable of PoseFilter or ScanFilter
        One of them must be right.
    margin : float [m]
        Mean cost that noise explains: as much more of it makes a pose e times less likely.

    Examples
    --------
    >>> from heightmap25d_ros.params.sections import LocalizationParams
    >>> places = [
    ...     PoseFilter(LocalizationParams(), se3.from_xyz_rpy([x, 0, 0, 0, 0, 0]), np.eye(3))
    ...     for x in (0.0, 8.0)
    ... ]
    >>> len(Hypotheses(places, 0.01))
    2
    """

    def __init__(self, estimates: Iterable[Estimate], margin: float) -> None:
        self._left = [Hypothesis(estimate) for estimate in estimates]
        self._margin = margin

    def __len__(self) -> int:
        return len(self._left)

    @property
    def best(self) -> Hypothesis:
        """The one of the largest weight."""
        return min(self._left, key=lambda hypothesis: hypothesis.misfit)

    @property
    def weights(self) -> tuple[float, ...]:
        """Of all that are left, the largest first; their sum is 1."""
        misfits = np.sort([hypothesis.misfit for hypothesis in self._left])
        weights = np.exp((misfits[:1] - misfits) / self._margin)
        return tuple((weights / max(weights.sum(), 1.0)).tolist())

    def predict(self, T_odom_before: se3.Matrix, T_odom_base: se3.Matrix, distance: float) -> None:
        """The robot moved by odometry; poses (4, 4) of it before and after."""
        for hypothesis in self._left:
            hypothesis.estimate.predict(T_odom_before, T_odom_base, distance)

    def update(self, returns: Array, T_odom_base: se3.Matrix, landmarks: Landmarks) -> Registration:
        """Hold all against the map, and drop those that it speaks against.

        Parameters
        ----------
        returns : (N, 3) float64 [m, odom]
        T_odom_base : (4, 4) float64
        landmarks : Landmarks

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
            found[id(hypothesis)] = hypothesis.estimate.prove(returns, T_odom_base, landmarks)
            hypothesis.take(found[id(hypothesis)])
        best = self.best
        most = self.best.misfit - self._margin * np.log(_LEAST_WEIGHT)
        kept: list[Hypothesis] = []
        at: list[Array] = []
        for hypothesis in sorted(self._left, key=lambda hypothesis: hypothesis.misfit):
            if hypothesis.contradicted >= _REFUSALS or hypothesis.misfit > most:
                continue
            x, y, _, _, _, yaw = se3.to_xyz_rpy(hypothesis.estimate.T_map_odom @ T_odom_base)
            if not any(_is_same(np.array([x, y, yaw]), other) for other in at):
                kept.append(hypothesis)
                at.append(np.array([x, y, yaw]))
        self._left = kept
        return found[id(kept[0] if kept else best)]

    def clear(self) -> None:
        """None is right."""
        self._left = []


def _is_same(pose: Array, other: Array) -> bool:
    x, y, yaw = pose - other
    return bool(np.hypot(x, y) < _SAME_PLACE and abs(np.angle(np.exp(1j * yaw))) < _SAME_YAW)
