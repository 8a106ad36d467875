# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a node gets the map from."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from heightmap25d_msgs.msg import HeightGrid, UpperSurfaces
from heightmap25d_ros.nodes import qos
from heightmap25d_ros.nodes.interface import Input

Take = Callable[[Any], Any]


def map_inputs(
    node: Any, take_map: Take, take_update: Take, take_upper: Take, *, is_needed: bool = True
) -> list[Input]:
    """The topics of the map, as `LevelMap` takes them.

    Who subscribes to all of them is sent what has changed, and a whole map now and then.

    Parameters
    ----------
    node : rclpy.node.Node
    take_map, take_update, take_upper : callable
        Take all of the lowest surfaces, what has changed of them, and the surfaces above them.
    is_needed : bool
        See `Input`.
    """
    # The updates are beside the map, wherever it was remapped to.
    updates = f"{node.resolve_topic_name('height_grid')}_updates"
    return [
        Input(UpperSurfaces, "upper_surfaces", take_upper, qos.LATCHED),
        Input(HeightGrid, "height_grid", take_map, qos.LATCHED, is_needed=is_needed),
        Input(HeightGrid, updates, take_update, qos.UPDATES),
    ]
