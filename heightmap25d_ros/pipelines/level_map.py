# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map of several levels out of its two messages: the lowest surfaces, and those above."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.grid.levels import NO_UPPER, UpperSurfaces
from heightmap25d_ros.io import decode
from heightmap25d_ros.pipelines.drops import Drops


class LevelMap:
    """The newest of both messages.

    ``mapping`` publishes the upper surfaces first. They wait for the lowest ones of the same stamp,
    unless these have come already.

    Parameters
    ----------
    frame_id : str or None
        In which both must be; None: in any.
    dropped : Drops
        Counts what cannot be read.
    """

    def __init__(self, frame_id: str | None, dropped: Drops) -> None:
        self._frame_id, self._dropped = frame_id, dropped
        self._lowest: HeightMap | None = None
        self._upper: tuple[Geometry, UpperSurfaces] | None = None
        self._stamp_ns = -1  # of the lowest surfaces

    def take_lowest(self, message: Any) -> HeightMap | None:
        """Take a heightmap25d_msgs/HeightGrid; the map with it, None where it cannot be read."""
        found = self._dropped.decoded(
            "map", lambda m: (decode.height_map(m, self._frame_id), decode.stamp_ns(m.header)),
            message,
        )  # fmt: skip
        if found is None:
            return None
        self._lowest, self._stamp_ns = found
        return self._joined(self._lowest)

    def take_upper(self, message: Any) -> HeightMap | None:
        """Take a heightmap25d_msgs/UpperSurfaces; a map where it belongs to one that has come."""
        found = self._dropped.decoded(
            "upper surfaces",
            lambda m: (decode.upper_surfaces(m, self._frame_id), decode.stamp_ns(m.header)),
            message,
        )
        if found is None:
            return None
        self._upper, stamp_ns = found
        if self._lowest is None or stamp_ns != self._stamp_ns:
            return None
        return self._joined(self._lowest)

    def _joined(self, lowest: HeightMap) -> HeightMap:
        if self._upper is None:
            return lowest
        geometry, upper = self._upper
        if not np.isclose(geometry.resolution, lowest.geometry.resolution, rtol=1e-6):
            return replace(lowest, upper=NO_UPPER)
        offset = np.subtract(geometry.origin, lowest.geometry.origin) / geometry.resolution
        columns, rows = np.rint(offset).astype(int)
        moved = upper.moved(int(rows), int(columns)).part(0, 0, *lowest.geometry.shape)
        return replace(lowest, upper=moved)
