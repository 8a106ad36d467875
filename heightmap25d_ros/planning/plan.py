# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a path starts and ends, and what planning answers: a path, or the reason for none."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import Geometry
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.search import CostToGo


@dataclass(frozen=True, slots=True)
class Pose2D:
    """Where a path starts and ends, and what planning answers: a path, or the reason for none."""

    x: float
    y: float
    yaw: float | None = None


def in_cells(place: Pose2D, geometry: Geometry) -> tuple[float, float, float]:
    """Where a path starts and ends, and what planning answers: a path, or the reason for none."""
    x, y = geometry.origin
    resolution = geometry.resolution
    return (place.y - y) / resolution, (place.x - x) / resolution, place.yaw or 0.0


class Status(IntEnum):
    """Where a path starts and ends, and what planning answers: a path, or the reason for none."""

    NONE = 0
    UNKNOWN = 200
    TF_ERROR = 202
    START_OUTSIDE_MAP = 203
    GOAL_OUTSIDE_MAP = 204
    START_OCCUPIED = 205
    GOAL_OCCUPIED = 206
    TIMEOUT = 207
    NO_VALID_PATH = 208


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """Where a path starts and ends, and what planning answers: a path, or the reason for none."""

    status: Status
    reason: str
    seconds: float = 0.0
    poses: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 4, 4)))
    length: float = 0.0
    climb: float = 0.0
    steepest_slope: float = 0.0
    least_clearance: float = math.inf
    cost: float = 0.0
    graph: TransitionGraph | None = None
    cost_to_go: CostToGo | None = None

    @property
    def found(self) -> bool:
        """Whether there is a path."""
        return self.status is Status.NONE
