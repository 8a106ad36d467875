# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map out of its messages: the lowest surfaces, what has changed of them, and those above."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.grid.levels import NO_UPPER, UpperSurfaces
from heightmap25d_ros.grid.map_changes import with_part
from heightmap25d_ros.io import decode
from heightmap25d_ros.pipelines.drops import Drops

_MOST_EARLY = 4_000_000
"""Cells of updates that wait for their map."""


@dataclass(frozen=True, slots=True, eq=False)
class _Lowest:
    """The content of a HeightGrid, and what tells to which whole map it belongs."""

    height_map: HeightMap
    stamp_ns: int
    loaded: tuple[int, int]


class LevelMap:
    """The newest map of several messages.

    ``mapping`` publishes the upper surfaces first. They wait for the lowest ones of the same stamp,
    unless these have come already. A whole map is large, so that updates of it may come before it:
    they wait for it as well.

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
        self._loaded = (-1, 0)  # the map_load_time of all of them
        self._early: list[_Lowest] = []  # updates of a map that has not come yet

    def take_lowest(self, message: Any) -> HeightMap | None:
        """Take a heightmap25d_msgs/HeightGrid; the map with it, None where it cannot be read."""
        found = self._dropped.decoded("map", self._decoded, message)
        if found is None:
            return None
        self._lowest, self._stamp_ns = found.height_map, found.stamp_ns
        self._loaded = found.loaded
        early, self._early = self._early, []
        for update in early:
            if update.loaded == self._loaded:
                self._lowest = self._updated(self._lowest, update)
        return self._joined(self._lowest)

    def take_update(self, message: Any) -> HeightMap | None:
        """Take a heightmap25d_msgs/HeightGrid with what has changed of the map; the map with it.

        None where it cannot be read, or all of the map is still to come.
        """
        found = self._dropped.decoded("map update", self._decoded, message)
        if found is None:
            return None
        if found.loaded > self._loaded:
            self._wait(found)
        if self._lowest is None or found.loaded != self._loaded:
            return None
        before, self._lowest = self._lowest, self._updated(self._lowest, found)
        return None if self._lowest is before else self._joined(self._lowest)

    def _wait(self, update: _Lowest) -> None:
        """Keep an update until its map comes, in place of those of other maps."""
        same = [early for early in self._early if early.loaded == update.loaded]
        self._early = [*same, update]
        while sum(early.height_map.height.size for early in self._early) > _MOST_EARLY:
            del self._early[0]

    def _decoded(self, message: Any) -> _Lowest:
        height_map = decode.height_map(message, self._frame_id)
        loaded = message.info.map_load_time
        return _Lowest(
            height_map=height_map,
            stamp_ns=decode.stamp_ns(message.header),
            loaded=(int(loaded.sec), int(loaded.nanosec)),
        )

    def _updated(self, lowest: HeightMap, update: _Lowest) -> HeightMap:
        """The lowest surfaces with an update; as they were where it is no part of them."""
        try:
            updated = with_part(lowest, update.height_map)
        except ValueError as error:
            self._dropped.record("map update: bad info", str(error))
            return lowest
        self._stamp_ns = update.stamp_ns
        return updated

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
