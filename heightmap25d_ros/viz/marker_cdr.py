# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Many triangles in a visualization_msgs/Marker, serialized as CDR.

A Point and a ColorRGBA object for each corner take seconds for a map of ten thousand cells. In CDR
they are plain arrays of numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_ENCAPSULATION = 4  # bytes before the message; alignment is relative to the message
_COUNT = 4  # bytes of the length of a sequence or a string


def with_faces(
    marker: Any, serialized: bytes, corners: NDArray[np.float64], colours: NDArray[np.float64]
) -> bytes:
    """A serialized marker with each face as two triangles of one colour.

    Parameters
    ----------
    marker : visualization_msgs.msg.Marker
        Of type TRIANGLE_LIST, without points, colours and texture coordinates.
    serialized : bytes
        The same in CDR.
    corners : (N, 4, 3) float64 [m]
        Of rectangles, in the marker's frame.
    colours : (N, 3) float64, 0 .. 1
        Red, green, blue.
    """
    at = _points_at(marker)
    points = corners[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype("<f8")
    opaque = np.ones((2 * len(colours), 4), "<f4")
    opaque[:, :3] = np.repeat(colours, 2, axis=0)
    before = serialized[: _ENCAPSULATION + at]
    rest = serialized[_ENCAPSULATION + at + 2 * _COUNT :]  # behind the colours
    to_align = b"\0" * (_aligned(at + _COUNT, 8) - at - _COUNT)
    return b"".join([
        before, len(points).to_bytes(_COUNT, "little"), to_align, points.tobytes(),
        len(opaque).to_bytes(_COUNT, "little"), opaque.tobytes(), rest,
    ])  # fmt: skip


def _points_at(marker: Any) -> int:
    """Offset [bytes] of the number of points in a serialized marker."""
    stamp, numbers = 8, 12  # seconds and nanoseconds; id, type, action
    pose_scale, colour, lifetime, frame_locked = 10 * 8, 4 * 4, 8, 1
    at = stamp
    for text in (marker.header.frame_id, marker.ns):
        at = _aligned(at, 4) + _COUNT + len(text.encode()) + 1  # ends with a zero
    at = _aligned(_aligned(at, 4) + numbers, 8) + pose_scale + colour + lifetime + frame_locked
    return _aligned(at, 4)


def _aligned(position: int, size: int) -> int:
    return -(-position // size) * size
