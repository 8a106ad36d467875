# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is asked of an exploration, and what becomes of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from heightmap25d_ros.exploration.boundary import Boundary
from heightmap25d_ros.params.sections import Params


class State(IntEnum):
    """The codes of heightmap25d_msgs/ExplorationStatus."""

    IDLE = 0
    DRIVING = 1
    LOOKING = 2
    RETURNING = 3
    PAUSED = 4
    ENDED = 5


class End(IntEnum):
    """Why an exploration ended; the codes of heightmap25d_msgs/ExplorationStatus."""

    NONE = 0
    DONE = 1
    LIMIT = 2
    STUCK = 3
    LOST = 4
    STOPPED = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Task:
    """What is asked of an exploration.

    Attributes
    ----------
    boundary : Boundary
    min_gain : float [m^2]
    time_limit, distance_limit : float [s], [m]
        0: no limit.
    return_home : bool
    """

    boundary: Boundary
    min_gain: float
    time_limit: float
    distance_limit: float
    return_home: bool

    @classmethod
    def of(cls, params: Params) -> Task:
        """That of the parameters.

        Raises
        ------
        InputError
            If their boundary is no polygon.
        """
        own = params.exploration
        return cls(
            boundary=Boundary.of(own.boundary),
            min_gain=own.min_gain,
            time_limit=own.time_limit,
            distance_limit=own.distance_limit,
            return_home=own.return_home,
        )
