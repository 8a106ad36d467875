# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where scans do not tell the pose, or not surely, a short-term map may: it proposes, they decide.

The registration of a short-term map looks farther than scans do. But what it takes for the
direction along a plain wall may be noise; so its pose is taken only where scans, held to the map at
that pose, prove it. The covariance grows by how far it is from the prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.landmarks import ELEVATED, Landmarks
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.registration import (
    Reason,
    Registration,
    register,
    to_registration_points,
)
from heightmap25d_ros.localization.scan_filter import ScanFilter
from heightmap25d_ros.localization.short_term import LocalCells
from heightmap25d_ros.localization.surface import Surface
from heightmap25d_ros.localization.tracking_state import CONTRADICTIONS
from heightmap25d_ros.params.sections import Params

COARSE = 0.12
"""Deviation of the position [m] from which on scans alone may be held to the wrong wall."""

_SURER = 0.5  # deviation, over that before, to which scans must prove a pose that is proposed
_DISPLACED = np.diag(np.square([0.3, 0.3, 0.1]))  # added to the prior where scans contradict it

Proven = tuple[ScanFilter, Registration, RegistrationPoints]
"""The estimate at a proposed pose, its registration, and the points of that."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """What a short-term map is registered from.

    Attributes
    ----------
    estimate : ScanFilter
    found : Registration
        What scans told last.
    T_odom_base : (4, 4) float64
    seen : LocalCells
        Of the short-term map.
    """

    estimate: ScanFilter
    found: Registration
    T_odom_base: se3.Matrix
    seen: LocalCells

    def proven(
        self, returns: Array, surface: Surface, landmarks: Landmarks, params: Params
    ) -> Proven | None:
        """The estimate at the registered pose, the registration, and its points.

        None where the short-term map does not register, or returns (N, 3) [m, odom] do not agree.
        """
        estimate, contradicts = self.estimate, self.found.reason in CONTRADICTIONS
        covariance = estimate.covariance + _DISPLACED if contradicts else estimate.covariance
        points = to_registration_points(self.seen, estimate.T_map_odom, self.T_odom_base)
        found = register(points, surface, covariance, params.registration)
        if found.reason not in (Reason.ACCEPTED, Reason.FAR_FROM_PRIOR):
            return None
        x, y, yaw = found.offset
        shift = se3.correction_about(
            estimate.T_map_odom @ self.T_odom_base, (float(x), float(y), found.z), float(yaw)
        )
        trial = ScanFilter(
            params,
            shift @ estimate.T_map_odom,
            covariance + np.outer(found.offset, found.offset),
            estimate.errors,
        )
        if not trial.prove(returns, self.T_odom_base, landmarks).is_accepted:
            return None
        if not contradicts and trial.deviation[0] > _SURER * estimate.deviation[0]:
            return None
        return trial, replace(found, reason=Reason.ACCEPTED), points


def returns_to_points(
    returns: Array, T_map_odom: se3.Matrix, T_odom_base: se3.Matrix, landmarks: Landmarks
) -> RegistrationPoints:
    """Returns (N, 3) [m, odom] as a registration takes its points, about the robot."""
    x, y = (T_map_odom @ T_odom_base)[:2, 3]
    xyz = se3.transform_points(T_map_odom, returns)
    lowest = landmarks.lowest
    cells = np.floor((xyz[:, :2] - landmarks.origin) / landmarks.resolution).astype(int)
    rows, columns = (
        np.clip(index, 0, count - 1)
        for index, count in zip(cells.T[::-1], lowest.shape, strict=True)
    )
    is_edge = xyz[:, 2] > lowest[rows, columns] + ELEVATED
    pivot = float(x), float(y)
    return RegistrationPoints(xyz - (x, y, 0.0), is_edge, np.ones(len(xyz)), pivot)
