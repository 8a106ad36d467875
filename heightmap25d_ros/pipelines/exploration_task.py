# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is asked of an exploration, and what becomes of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import decode
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.boundary import Boundary


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


def requested(message: Any, params: Params) -> Task:
    """The task of a goal of heightmap25d_msgs/Explore; what it leaves open is as of the parameters.

    Raises
    ------
    InputError
        If the boundary is no polygon in the map, or a number is negative or not finite.
    """
    own = Task.of(params)
    numbers = {}
    for name in ("min_gain", "time_limit", "distance_limit"):
        given = float(getattr(message, name))
        if not 0.0 <= given < math.inf:
            raise InputError(f"{name}: {given:g} is not a number from 0 on")
        numbers[name] = given or getattr(own, name)
    corners = decode.polygon(message.boundary, params.mapping.map_frame)
    return Task(
        boundary=Boundary.of(corners) if len(corners) else own.boundary,
        return_home=bool(message.return_home) or own.return_home,
        **numbers,
    )
