# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An `Explanation` into the answer of a service, and into a text for RViz."""

from __future__ import annotations

import math
from typing import Any

from heightmap25d_ros.io import encode
from heightmap25d_ros.terrain.explanation import Explanation

_TEXT_HEIGHT = 0.12  # [m] of a line
_TEXT_ABOVE = 0.6  # [m] over the cell


def fill_response(message: Any, found: Explanation, frame_id: str) -> None:
    """Fill a response of heightmap25d_msgs/Explain; what is not known is 0."""
    message.message = found.sentence
    message.frame_id = frame_id
    _fill_point(message.position, found.position, _or_zero(found.height))
    _fill_point(message.because_of, found.because_of or found.position, 0.0)
    message.occupancy, message.cost = found.occupancy, found.cost
    message.rule = found.rule.value
    message.probability = found.probability
    message.value, message.limit = _or_zero(found.value), _or_zero(found.limit)


def fill_text(message: Any, found: Explanation, stamp: int, frame_id: str) -> None:
    """Fill a visualization_msgs/Marker of text, which stands over the cell."""
    encode.fill_header(message.header, stamp, frame_id)
    _fill_point(message.pose.position, found.position, _or_zero(found.height) + _TEXT_ABOVE)
    message.pose.orientation.w = 1.0
    message.scale.z = _TEXT_HEIGHT
    message.color.r = message.color.g = message.color.b = message.color.a = 1.0
    message.text = found.sentence.replace("; ", ";\n").replace(": ", ":\n", 1)


def _fill_point(message: Any, position: tuple[float, float], z: float) -> None:
    message.x, message.y, message.z = *position, z


def _or_zero(value: float) -> float:
    return value if math.isfinite(value) else 0.0
