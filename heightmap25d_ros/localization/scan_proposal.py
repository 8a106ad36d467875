# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where scans do not tell the pose, or not surely, another way may: it proposes, they decide.

The registration of a short-term map looks farther than scans do. But what it takes for the
direction along a plain wall may be noise; so its pose is taken only where scans, held to the map at
that pose, prove it. The covariance grows by how far it is from the prior.

A short-term map is of no use where the odometry was wrong within the last metres. There the place
is looked for where the last returns alone fit (`scan_search`), as far around as the robot can be:
they are from a fraction of a second, and bent by nothing. So it is where returns fit poorly, though
they do not contradict the map: a pose that is off by a metre in a room has most walls near some
returns, and would be held there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.landmarks import ELEVATED, Landmarks
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.registration import (
    SIGMAS,
    Reason,
    Registration,
    register,
    to_registration_points,
)
from heightmap25d_ros.localization.scan_filter import ScanFilter, fit_of
from heightmap25d_ros.localization.scan_search import find_place
from heightmap25d_ros.localization.short_term import LocalCells
from heightmap25d_ros.localization.surface import Surface
from heightmap25d_ros.localization.tracking_state import CONTRADICTIONS
from heightmap25d_ros.params.sections import Params

COARSE = 0.12
"""Deviation of the position [m] from which on scans alone may be held to the wrong wall."""

CLEAR_FIT = 0.6
"""Of returns at a pose (`scan_filter.fit_of`), below which there may be a better one around."""

_BETTER = 1.3  # times the fit at the pose before
_LEAST_RADIUS, _LEAST_TURN = 2.5, 0.6  # [m], [rad] within which a better place is looked for
_SURER = 0.5  # deviation, over that before, to which scans must prove a pose that is proposed
_WRONG_WAY = 2.0  # of the way since scans agreed: the robot may have gone back in place of forth
_MOST_RADIUS = 5.0  # [m] within which the place is looked for
_DISPLACED = np.diag(np.square([0.3, 0.3, 0.1]))  # added to the prior where scans contradict it


class Proven(NamedTuple):
    """A pose that scans prove.

    Attributes
    ----------
    estimate : ScanFilter
        At that pose.
    registration : Registration
    points : RegistrationPoints
        That were registered.
    wrong : float [m]
        By how much more the odometry may be wrong when the same place is found once more.
    """

    estimate: ScanFilter
    registration: Registration
    points: RegistrationPoints
    wrong: float


@dataclass(frozen=True, slots=True)
class Proposal:
    """What short-term maps and returns are registered from.

    Attributes
    ----------
    estimate : ScanFilter
    found : Registration
        What scans told last.
    T_odom_base : (4, 4) float64
    returns : (N, 3) float64 [m], odom
        Of the last moment.
    doubted : float [m]
        The way by odometry since scans agreed with the map.
    """

    estimate: ScanFilter
    found: Registration
    T_odom_base: se3.Matrix
    returns: Array
    doubted: float

    def proven(
        self, seen: LocalCells | None, surface: Surface, landmarks: Landmarks, params: Params
    ) -> Proven | None:
        """The estimate at a pose where cells of a short-term map, or the last returns, match.

        None where there is no such pose, or the returns do not agree at it.
        """
        if seen is not None:
            points = to_registration_points(seen, self.estimate.T_map_odom, self.T_odom_base)
            found = register(points, surface, self._covariance, params.registration)
            if found.reason in (Reason.ACCEPTED, Reason.FAR_FROM_PRIOR):
                trial, proof = self._tried(found.offset, found.z, landmarks, params)
                if self._is_better(trial, proof):
                    return Proven(trial, replace(found, reason=Reason.ACCEPTED), points, 0.0)
        offset = self._place(landmarks) if fit_of(self.found) < CLEAR_FIT else None
        if offset is None:
            return None
        trial, proof = self._tried(offset, 0.0, landmarks, params)
        if not proof.is_accepted or fit_of(proof) < _BETTER * fit_of(self.found):
            return None
        points = returns_to_points(
            self.returns, self.estimate.T_map_odom, self.T_odom_base, landmarks
        )
        return Proven(trial, replace(proof, offset=offset), points, _WRONG_WAY * self.doubted)

    @property
    def _is_contradicted(self) -> bool:
        return self.found.reason in CONTRADICTIONS

    @property
    def _covariance(self) -> Array:
        """Of the pose (3, 3): larger where scans contradict it."""
        covariance = self.estimate.covariance
        return covariance + _DISPLACED if self._is_contradicted else covariance

    def _place(self, landmarks: Landmarks) -> Array | None:
        """Offset (3,) of the only place around where the last returns fit."""
        estimate, covariance = self.estimate, self._covariance
        position = (estimate.T_map_odom @ self.T_odom_base)[:3, 3]
        returns = se3.transform_points(estimate.T_map_odom, self.returns) - position
        deviation, turn = np.sqrt([np.linalg.eigvalsh(covariance[:2, :2])[-1], covariance[2, 2]])
        radius = SIGMAS * deviation + _WRONG_WAY * self.doubted
        return find_place(
            returns, position, landmarks, float(np.clip(radius, _LEAST_RADIUS, _MOST_RADIUS)),
            max(SIGMAS * turn, _LEAST_TURN),
        )  # fmt: skip

    def _tried(
        self, offset: Array, z: float, landmarks: Landmarks, params: Params
    ) -> tuple[ScanFilter, Registration]:
        """The estimate at another pose, and what scans say of it."""
        estimate = self.estimate
        x, y, yaw = (float(value) for value in offset)
        shift = se3.correction_about(estimate.T_map_odom @ self.T_odom_base, (x, y, z), yaw)
        covariance = self._covariance + np.outer(offset, offset)
        trial = ScanFilter(params, shift @ estimate.T_map_odom, covariance, estimate.errors)
        return trial, trial.prove(self.returns, self.T_odom_base, landmarks)

    def _is_better(self, trial: ScanFilter, proof: Registration) -> bool:
        """Whether scans prove a pose that a short-term map proposes."""
        is_surer = trial.deviation[0] <= _SURER * self.estimate.deviation[0]
        return proof.is_accepted and (self._is_contradicted or is_surer)


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
