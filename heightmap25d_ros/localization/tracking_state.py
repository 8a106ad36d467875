# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The state of localization, TRACKING, DEGRADED or LOST, with hysteresis."""

from __future__ import annotations

from enum import IntEnum

from heightmap25d_ros.localization.registration import Reason, Registration
from heightmap25d_ros.params.sections import LocalizationParams

_CONFIRMED = 0.4  # of the deviation that degrades, to which a given pose must be confirmed
CONTRADICTIONS = (Reason.LITTLE_OVERLAP, Reason.HIGH_RESIDUAL, Reason.FAR_FROM_PRIOR)


class State(IntEnum):
    """The codes of heightmap25d_msgs/LocalizationStatus."""

    TRACKING = 0
    DEGRADED = 1
    LOST = 2


class Health:
    """The state of localization, updated by registrations.

    Several accepted ones in a row are needed for TRACKING, and several contradictions in a row to
    leave it. A registration without information (flat or ambiguous surroundings) is no
    contradiction; the uncertainty of the pose grows meanwhile, which degrades the state as well.
    A pose that somebody gave may be off by more than was told: it is not TRACKING before the map
    has confirmed it in all directions. Only a new pose leads out of LOST.

    Parameters
    ----------
    params : LocalizationParams

    Attributes
    ----------
    state : State
    """

    def __init__(self, params: LocalizationParams) -> None:
        self._params = params
        self.begin()

    def begin(self, *, is_confirmed: bool = False) -> None:
        """Start with a new pose: a given one, or one that is confirmed already."""
        self.state = State.TRACKING if is_confirmed else State.DEGRADED
        self._accepted = self._contradicted = 0
        self._is_confirmed = is_confirmed

    def predict(self, deviation: float) -> None:
        """Update by the standard deviation [m] of the position after a motion by odometry."""
        if self.state is State.TRACKING and deviation > self._params.degraded_deviation:
            self.state = State.DEGRADED

    def update(self, registration: Registration, deviation: float) -> None:
        """Update by a registration and the standard deviation [m] of the position after it."""
        if self.state is State.LOST:
            return
        if registration.is_accepted:
            self._accepted, self._contradicted = self._accepted + 1, 0
        elif registration.reason in CONTRADICTIONS:
            self._accepted, self._contradicted = 0, self._contradicted + 1
        params = self._params
        self._is_confirmed |= deviation <= _CONFIRMED * params.degraded_deviation
        if self._contradicted >= params.lost_refusals:
            self.state = State.LOST
        elif (
            self._contradicted >= params.degraded_refusals or deviation > params.degraded_deviation
        ):
            self.state = State.DEGRADED
        elif self._accepted >= params.confirmations and self._is_confirmed:
            self.state = State.TRACKING
