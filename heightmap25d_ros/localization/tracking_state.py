# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How sure the localization is: TRACKING, DEGRADED, LOST, with hysteresis."""

from __future__ import annotations

from enum import IntEnum

from heightmap25d_ros.localization.registration import Reason, Registration
from heightmap25d_ros.params.sections import LocalizationParams

CONTRADICTIONS = (Reason.LITTLE_OVERLAP, Reason.HIGH_RESIDUAL, Reason.FAR_FROM_PRIOR)


class State(IntEnum):
    """As in heightmap25d_msgs/LocalizationStatus."""

    TRACKING = 0
    DEGRADED = 1
    LOST = 2


class Health:
    """The state that registrations lead to.

    Several in a row are needed to come to TRACKING, and several contradictions in a row to leave
    it. What says nothing (a flat place, a place that looks like another) is no contradiction; the
    pose grows uncertain meanwhile, and that degrades the state as well. Out of LOST only a new
    pose leads.

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
        """A new pose: from outside, or from the whole map and confirmed already."""
        self.state = State.TRACKING if is_confirmed else State.DEGRADED
        self._accepted = self._contradicted = 0

    def update(self, registration: Registration, deviation: float) -> None:
        """Take a registration in, and the standard deviation [m] of the position after it."""
        if self.state is State.LOST:
            return
        if registration.is_accepted:
            self._accepted, self._contradicted = self._accepted + 1, 0
        elif registration.reason in CONTRADICTIONS:
            self._accepted, self._contradicted = 0, self._contradicted + 1
        params = self._params
        if self._contradicted >= params.lost_refusals:
            self.state = State.LOST
        elif (
            self._contradicted >= params.degraded_refusals or deviation > params.degraded_deviation
        ):
            self.state = State.DEGRADED
        elif self._accepted >= params.confirmations:
            self.state = State.TRACKING
