# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a path starts and ends, and what planning answers: a path, or the reason for none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import Geometry
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.search import CostToGo


@dataclass(frozen=True, slots=True)
class Pose2D:
    """A place on the map, with or without a heading.

    Attributes
    ----------
    x, y : float [m], map
    yaw : float [rad], optional
        None: any.

    Examples
    --------
    >>> Pose2D(4.0, 0.0, yaw=math.pi / 2)
    Pose2D(x=4.0, y=0.0, yaw=1.5707963267948966)
    """

    x: float
    y: float
    yaw: float | None = None


def as_pose(name: str, place: Pose2D | Sequence[float]) -> Pose2D:
    """A place that was given under some name: a `Pose2D`, or (x, y) or (x, y, yaw).

    Raises
    ------
    ValueError
        If it is neither.
    """
    if isinstance(place, Pose2D):
        return place
    numbers = [float(number) for number in place]
    if len(numbers) not in (2, 3) or not all(math.isfinite(number) for number in numbers):
        raise ValueError(f"{name}: {place} is not x, y or x, y, yaw")
    return Pose2D(*numbers)


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
