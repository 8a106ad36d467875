# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether all of a map goes out, or only what has changed."""

from __future__ import annotations

import math
import time
from typing import Any

from heightmap25d_ros.grid.height_map import Area, Geometry

SETTLING = 3.0
"""How long after a whole map updates repeat all that has changed since [s].

Nav2's static layer keeps a whole map until its costmap is updated the next time, and then forgets
the updates that came meanwhile.
"""

REFRESHED = 60.0
"""A whole map goes out after so long where updates have [s]: whoever has lost one gets it again."""

_NOTHING = Area(0, 0, 0, 0)


class UpdatedTopic:
    """Decides what goes out of a map: all of it, or the rectangle that has changed.

    All of it goes out first, when the map has grown, and when somebody new subscribes, since the
    latched message is older than the updates. It goes out every time while a node subscribes that
    does not subscribe to the updates as well.

    Parameters
    ----------
    node : rclpy.node.Node
    topic, updates : str
        Full names of the topics of the map and of its updates.
    refreshed : float [s]
        So long after a whole map the next change brings a whole one.

    Attributes
    ----------
    whole_ns : int [ns]
        When all of the map went out last, by the clock of the machine.
    """

    def __init__(self, node: Any, topic: str, updates: str, refreshed: float = math.inf) -> None:
        self._node = node
        self._topics = topic, updates
        self._refreshed = refreshed
        self.whole_ns = 0
        self.forget()

    def forget(self) -> None:
        """Let all of the next map go out."""
        self._whole: Geometry | None = None
        self._whole_since = 0.0
        self._served: set[bytes] = set()
        self._changed = _NOTHING

    def note(self, changed: Area) -> None:
        """Cells of the grid have changed."""
        self._changed = self._changed.hull(changed)

    def is_due(self, subscribers: int) -> bool:
        """Whether something goes out although the map is the same: for how many subscribers.

        To somebody new, or once more what has changed since the newest whole map.
        """
        return subscribers != len(self._served) or (self._changed.rows > 0 and self._is_settled)

    @property
    def _is_settled(self) -> bool:
        return time.monotonic() - self._whole_since > SETTLING

    def next(self, area: Area, geometry: Geometry) -> Area | None:
        """What goes out now of a map; None: all of it.

        Parameters
        ----------
        area : Area
            Of the grid: the cells of the map.
        geometry : Geometry
            Their place.
        """
        subscribers, updated = map(self._node.get_subscriptions_info_by_topic, self._topics)
        names, following = (
            {(s.node_namespace, s.node_name) for s in infos} for infos in (subscribers, updated)
        )
        served, self._served = self._served, {bytes(s.endpoint_gid) for s in subscribers}
        is_fresh = time.monotonic() - self._whole_since < self._refreshed
        if geometry == self._whole and self._served <= served and names <= following and is_fresh:
            changed = self._changed.within(area)
            if self._is_settled:
                self._changed = _NOTHING
            return changed
        self._whole, self._whole_since, self._changed = geometry, time.monotonic(), _NOTHING
        self.whole_ns = time.time_ns()
        return None
