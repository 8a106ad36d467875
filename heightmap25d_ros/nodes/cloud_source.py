# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The subscriptions to point clouds, of messages that ROS brings or a driver."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.nodes import qos
from heightmap25d_ros.nodes.interface import Input
from heightmap25d_ros.params import sources
from heightmap25d_ros.params.sections import Params


def cloud_inputs(params: Params, take: Callable[[str, Any], None]) -> list[Input]:
    """The topics of clouds, each in its type.

    Parameters
    ----------
    params : Params
    take : callable
        Takes a topic and a message of it.

    Raises
    ------
    InputError
        If the package of a type is not installed.
    """
    return [
        Input(_class(params, topic), topic, partial(take, topic), qos.CLOUDS, is_needed=True)
        for topic in params.intake.cloud_topics
    ]


def _class(params: Params, topic: str) -> Any:
    package, _, name = sources.message_type(params, topic).partition("/msg/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except ImportError:
        source = sources.source_name(topic)
        raise InputError(
            f"parameter sensor.{source}.message_type: package {package} is not installed"
        ) from None
