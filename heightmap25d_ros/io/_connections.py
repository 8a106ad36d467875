# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Connections as rosbags makes them, of what a bag says where rosbags cannot read it."""

from __future__ import annotations

from typing import Any

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
    Qos,
)
from rosbags.rosbag2.metadata import parse_qos

NO_DEFINITION = MessageDefinition(MessageDefinitionFormat.NONE, "")

_FORMATS = {
    "ros2msg": MessageDefinitionFormat.MSG,
    "ros2idl": MessageDefinitionFormat.IDL,
    "omgidl": MessageDefinitionFormat.IDL,
}


def definition_of(encoding: str, text: str) -> MessageDefinition:
    """A message definition; empty where its encoding is not known."""
    return MessageDefinition(_FORMATS[encoding], text) if encoding in _FORMATS else NO_DEFINITION


def connection(
    key: int,
    topic: str,
    message_type: str,
    definition: MessageDefinition,
    *,
    encoding: str = "cdr",
    profiles: Any = "",
) -> Connection:
    """A connection without messages.

    Parameters
    ----------
    key : int
        Its number in the file.
    topic, message_type : str
    definition : MessageDefinition
    encoding : str
        Of the messages.
    profiles : str or list of dict
        The QoS profiles as the file has them; those that are damaged are left out.
    """
    extension = ConnectionExtRosbag2(encoding, _profiles(profiles))
    return Connection(key, topic, message_type, definition, "", 0, extension, None)


def _profiles(recorded: Any) -> list[Qos]:
    try:
        return parse_qos(recorded)
    except Exception:  # whatever the reader of damaged text raises
        return []
