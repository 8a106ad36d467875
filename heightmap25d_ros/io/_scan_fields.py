# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of the fields of a sensor_msgs/LaserScan against one another.

A scan that contradicts itself has no beams whose direction or time is known. Each refusal names
the field and the numbers that contradict.
"""

from __future__ import annotations

import math
from typing import Any

from heightmap25d_ros.errors import InputError

ANGLE_COUNT_TOLERANCE = 2
"""How many beams more or fewer than the angles say: drivers disagree about the last one."""

SWEEP_LIMIT = 60.0
"""A scan that takes longer than this from first to last beam is nonsense [s]."""

_FINITE = (
    "angle_min", "angle_max", "angle_increment", "time_increment", "range_min", "range_max",
)  # fmt: skip
_ROUNDING = 1e-5
"""Of angles, which are float32 in the message [rad]."""


def check_fields(message: Any, count: int) -> None:
    """Refuse a scan with a number of ranges whose fields contradict one another.

    Raises
    ------
    InputError
        Which begins with the field.
    """
    for name in _FINITE:
        if not math.isfinite(getattr(message, name)):
            raise InputError(f"{name}: {getattr(message, name)} is not finite")
    if not count:
        raise InputError("ranges: empty")
    _check_angles(message, count)
    if not message.range_min <= message.range_max:
        raise InputError(
            f"range_min: {message.range_min:g} is above range_max {message.range_max:g}"
        )
    if abs(message.time_increment) * (count - 1) > SWEEP_LIMIT:
        raise InputError(f"time_increment: {message.time_increment:g} s between beams")


def _check_angles(message: Any, count: int) -> None:
    first, last = float(message.angle_min), float(message.angle_max)
    increment, span = float(message.angle_increment), last - first
    between = f"angle_min {first:g} to angle_max {last:g} rad"
    if count > 1 and not increment:
        raise InputError(f"angle_increment: zero with {count} ranges")
    if abs(span) > 2 * math.pi + abs(increment) + _ROUNDING:
        raise InputError(
            f"angle_max: {between} spans {abs(span):g} rad, more than a turn; are these degrees?"
        )
    steps, tolerance = count - 1, ANGLE_COUNT_TOLERANCE * abs(increment)
    if abs(increment) * steps > 2 * math.pi + tolerance + _ROUNDING:
        raise InputError(
            f"angle_increment: {count} ranges by {increment:g} rad span "
            f"{abs(increment) * steps:g} rad, more than a turn; is it in degrees?"
        )
    if abs(span - increment * steps) <= tolerance:
        return
    if count > 1 and span * increment < 0.0:
        raise InputError(f"angle_increment: {increment:g} rad leads away from {between}")
    needed = f"{span / increment + 1:.0f}" if increment else "more"
    raise InputError(f"ranges: {count}, but {between} by {increment:g} rad needs {needed} beams")
