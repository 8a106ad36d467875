# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The data types of planning: poses to plan between, and the resulting plan.

A `Plan` is a value in any case: a path with its figures, or a status and the reason why there is
none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_map import Geometry
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.search import CostToGo


@dataclass(frozen=True, slots=True)
class Pose2D:
    """A start or a goal in the map.

    Attributes
    ----------
    x, y : float [m], map
    yaw : float [rad], optional
        None: along the path.
    z : float [m], map, optional
        Tells which level of a map with several is meant; elsewhere it is not used.

    Examples
    --------
    >>> Pose2D(4.0, 0.0, yaw=math.pi / 2)
    Pose2D(x=4.0, y=0.0, yaw=1.5707963267948966, z=None)
    """

    x: float
    y: float
    yaw: float | None = None
    z: float | None = None


def as_pose(name: str, place: Pose2D | Sequence[float]) -> Pose2D:
    """The pose that an argument names: a `Pose2D`, or (x, y) or (x, y, yaw).

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


def pose_2d(T: se3.Matrix) -> Pose2D:
    """A pose (4, 4) seen from above."""
    x, y, z = (float(coordinate) for coordinate in T[:3, 3])
    return Pose2D(x=x, y=y, yaw=math.atan2(T[1, 0], T[0, 0]), z=z)


def in_cells(pose: Pose2D, geometry: Geometry) -> tuple[float, float, float]:
    """Row, column and yaw [cells, rad] of a pose, fractional; a missing yaw is 0."""
    x, y = geometry.origin
    resolution = geometry.resolution
    return (pose.y - y) / resolution, (pose.x - x) / resolution, pose.yaw or 0.0


class Status(IntEnum):
    """The outcome of planning: the codes of nav2_msgs/ComputePathToPose, `NONE` for success."""

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
    """A path, or the reason why there is none.

    Attributes
    ----------
    status : Status
    reason : str
        Why there is no path, or why it does not end at the goal; else empty.
    seconds : float [s]
        Time that planning took.
    poses : (N, 4, 4) float64 [m], map
        The path on the surface; none without a path.
    length : float [m]
        Along the surface.
    climb : float [m]
        Sum of the ascents.
    steepest_slope : float [rad]
        Of the ground under the footprint along the path.
    least_clearance : float [m]
        From the path to the nearest obstacle; infinite beyond `collision.FARTHEST`.
    cost : float [m]
        In metres of flat open ground.
    graph : TransitionGraph or None
        The graph that was searched; a kept one becomes that of the next map.
    cost_to_go : CostToGo or None
        Its field around the goal.

    Examples
    --------
    >>> Plan(status=Status.TIMEOUT, reason="no path was found within 2 s").found
    False
    """

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


def joined(legs: Sequence[Plan]) -> Plan:
    """One plan of plans with paths, each of which begins where the one before ends.

    The place where two meet is there once.
    """
    first, *others = legs
    return replace(
        legs[-1],
        reason="; ".join(leg.reason for leg in legs if leg.reason),
        seconds=sum(leg.seconds for leg in legs),
        poses=np.concatenate([first.poses, *(leg.poses[1:] for leg in others)]),
        length=sum(leg.length for leg in legs),
        climb=sum(leg.climb for leg in legs),
        steepest_slope=max(leg.steepest_slope for leg in legs),
        least_clearance=min(leg.least_clearance for leg in legs),
        cost=sum(leg.cost for leg in legs),
    )
