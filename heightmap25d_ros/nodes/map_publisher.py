# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Publishes the newest map on its topics, each of them as cheaply as its subscribers allow."""

from __future__ import annotations

import math

from heightmap25d_ros.grid.height_map import Area
from heightmap25d_ros.nodes import qos
from heightmap25d_ros.nodes.interface import Output
from heightmap25d_ros.nodes.lifecycle import ManagedNode
from heightmap25d_ros.nodes.map_messages import (
    LAYERS,
    TOPICS,
    UPDATED_TOPICS,
    Content,
    layers_message,
    message_of,
    update_of,
)
from heightmap25d_ros.nodes.map_transform import AnchorTransform
from heightmap25d_ros.nodes.map_updates import REFRESHED, UpdatedTopic
from heightmap25d_ros.pipelines.mapping import Mapping


class MapPublisher:
    """Publishes to topics that somebody subscribes to, what they have not carried yet.

    Parameters
    ----------
    node : ManagedNode
    mapping : Mapping
    frame : str
        Of the map.
    anchor : AnchorTransform
    """

    def __init__(
        self, node: ManagedNode, mapping: Mapping, frame: str, anchor: AnchorTransform
    ) -> None:
        self._node = node
        self._mapping = mapping
        self._frame = frame
        self._anchor = anchor
        # Nav2 and RViz look beside the map's topic, wherever it was remapped to.
        names = {topic: node.resolve_topic_name(topic) for topic in UPDATED_TOPICS}
        self._updates = {topic: f"{name}_updates" for topic, name in names.items()}
        self._updated = {
            topic: UpdatedTopic(
                node,
                name,
                self._updates[topic],
                REFRESHED if topic == "height_grid" else math.inf,
            )
            for topic, name in names.items()
        }
        self._published: dict[str, int] = {}

    def outputs(self) -> list[Output]:
        """The maps, and the updates of some of them."""
        return [
            *(Output(kind, topic, qos.LATCHED) for topic, kind in TOPICS.items()),
            *(
                Output(UPDATED_TOPICS[topic], name, qos.UPDATES)
                for topic, name in self._updates.items()
            ),
        ]

    def begin_anew(self) -> None:
        """Publish the map, which is another one now, whole on each topic."""
        self._published.clear()
        for updated in self._updated.values():
            updated.forget()

    def publish(self, version: int) -> None:
        """Publish a state of the map, where its topic has not carried it.

        Parameters
        ----------
        version : int
            Differs from that of any other state.

        Raises
        ------
        InputError
            If the map is too large.
        """
        due = [topic for topic in TOPICS if self._is_due(topic, version)]
        whole = [topic for topic in due if not self._is_update_enough(topic)]
        if whole:
            content = Content(self._mapping, self._mapping.area())
            for topic in whole:
                self._publish_whole(topic, content)
        self._published.update(dict.fromkeys(due, version))

    def _publish_whole(self, topic: str, content: Content) -> None:
        stamp = self._mapping.stamp_ns
        if topic == LAYERS:
            layers = self._mapping.layers(content.geometry)
            if layers is not None:
                self._node.publish(LAYERS, layers_message(layers, stamp, self._frame))
            return
        loaded = self._updated[topic].whole_ns if topic in self._updated else stamp
        message = message_of(topic, content, stamp, self._frame, self._anchor, loaded)
        self._node.publish(topic, message)

    def _is_due(self, topic: str, version: int) -> bool:
        count = self._node.count_listeners(topic)
        is_old = self._published.get(topic) != version
        if topic in self._updated:
            is_old = is_old or self._updated[topic].is_due(count)
        return is_old and count > 0

    def _is_update_enough(self, topic: str) -> bool:
        """Publish what has changed, unless all of the map has to be."""
        if topic not in self._updated:
            return False
        changed, area = self._mapping.take_changed(), self._mapping.area()
        for updated in self._updated.values():
            updated.note(changed)
        part = self._updated[topic].next(area, self._mapping.grid.geometry.part(area))
        if part is None:
            return False
        if topic == "height_grid" and not part.rows * part.columns:
            part = Area(area.iy, area.ix, 1, 1)  # tells at least that the map is that of its stamp
        if part.rows and part.columns:
            self._publish_update(topic, part, area)
        return True

    def _publish_update(self, topic: str, part: Area, area: Area) -> None:
        content, stamp = Content(self._mapping, part), self._mapping.stamp_ns
        loaded = self._updated[topic].whole_ns
        message = update_of(topic, content, area, stamp, self._frame, loaded)
        self._node.publish(self._updates[topic], message)
