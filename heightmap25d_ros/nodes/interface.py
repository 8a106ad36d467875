# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rows of the tables that a node's file begins with: topics, services and actions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.qos import QoSProfile


@dataclass(frozen=True, slots=True)
class Input:
    """A topic that is subscribed to while the node is active.

    Attributes
    ----------
    kind : a class of messages
    topic : str
    callback : callable
        Takes the message.
    profile : QoSProfile
    is_needed : bool
        Whether the node is of no use without it: the self-check complains where it is silent.
    """

    kind: Any
    topic: str
    callback: Callable[[Any], Any]
    profile: QoSProfile
    is_needed: bool = False


@dataclass(frozen=True, slots=True)
class Output:
    """A topic that is advertised while the node is configured, and published while it is active."""

    kind: Any
    topic: str
    profile: QoSProfile


@dataclass(frozen=True, slots=True)
class Service:
    """A service that answers while the node is configured; the callback as of rclpy."""

    kind: Any
    name: str
    callback: Callable[[Any, Any], Any]


@dataclass(frozen=True, slots=True)
class Action:
    """An action that takes goals while the node is active, and rejects them while it is not.

    Both callbacks run in the node's executor and return at once.

    Attributes
    ----------
    kind : a class of actions
    name : str
    accept : callable
        Takes the `rclpy.action.server.ServerGoalHandle` of a new goal.
    cancel : callable
        Takes that of a goal whose client wants it cancelled.
    """

    kind: Any
    name: str
    accept: Callable[[Any], None]
    cancel: Callable[[Any], None]
