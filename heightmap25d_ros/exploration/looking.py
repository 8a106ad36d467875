# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Turning on the spot, to see with sensors that do not see all around.

A laser that is pitched down meets flat ground along a line across the robot, at the *blind radius*
ahead. So a point at a distance and a bearing is seen twice while the robot turns: when it faces
``acos(blind / distance)`` to the left of the point, and to the right of it.
"""

from __future__ import annotations

import math

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.planning.plan import Pose2D

_LONGEST = 2.0
"""Of one turn [rad]: well below half a turn, so that its direction is certain."""

_MARGIN = 0.35
"""So much farther than to the last point it turns [rad]: headings are not reached exactly."""


def full_turn(yaw: float) -> list[float]:
    """Headings [rad] that make one turn to the left, beginning at a yaw.

    Examples
    --------
    >>> [round(heading, 2) for heading in full_turn(0.0)]
    [1.57, 3.14, -1.57, 0.0]
    """
    return _turns(yaw, 2.0 * math.pi)


def headings_to_see(points: Array, robot: Pose2D, blind_radius: float) -> list[float]:
    """Headings [rad] to turn to, one after the other, to see all points.

    The robot turns to one side as far as needed, or to both: first to where it is less.

    Parameters
    ----------
    points : (N, 2) float64 [m], map
        At least one.
    robot : Pose2D
    blind_radius : float [m]

    Examples
    --------
    A point far ahead to the left is on the line that the laser sees, when the robot has turned to
    face it but for nearly a right angle:

    >>> robot = Pose2D(0.0, 0.0, yaw=0.0)
    >>> [round(h, 2) for h in headings_to_see(np.array([[0.0, 2.0]]), robot, 1.0)]
    [0.87]
    """
    yaw = robot.yaw or 0.0
    x, y = (points - (robot.x, robot.y)).T
    bearing = np.arctan2(y, x) - yaw
    aside = np.arccos(np.clip(blind_radius / np.maximum(np.hypot(x, y), 1e-9), 0.0, 1.0))
    # Turns to the left and to the right after which each point has been on the line.
    left = np.minimum(*((bearing + side) % (2.0 * np.pi) for side in (-aside, aside)))
    right = np.minimum(*(-(bearing + side) % (2.0 * np.pi) for side in (-aside, aside)))
    ways = []
    order = np.argsort(left)
    left, right = left[order], np.maximum.accumulate(right[order][::-1])[::-1]
    # The first n points by a turn to the left, the others by one to the right.
    lefts, rights = np.append(0.0, left), np.append(right, 0.0)
    cost = lefts + rights + np.minimum(lefts, rights)
    best = int(cost.argmin())
    to_left, to_right = float(lefts[best]), float(rights[best])
    for angle in sorted((to_left, -to_right), key=abs):
        if angle:
            ways.append(math.copysign(min(abs(angle) + _MARGIN, 2.0 * math.pi), angle))
    if not ways:
        ways.append(_MARGIN)
    headings, at = [], yaw
    for angle in ways:
        target = yaw + angle
        headings += _turns(at, target - at)
        at = target
    return headings


def _turns(yaw: float, angle: float) -> list[float]:
    """Headings of a turn, none longer than `_LONGEST`."""
    count = max(1, math.ceil(abs(angle) / _LONGEST))
    return [math.remainder(yaw + angle * (n + 1) / count, 2.0 * math.pi) for n in range(count)]
