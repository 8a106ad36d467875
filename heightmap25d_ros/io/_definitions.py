# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Message types that ROS does not bring, learnt from the definitions in a bag."""

from __future__ import annotations

import re
from collections.abc import Iterable

from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.typesys import get_types_from_idl, get_types_from_msg
from rosbags.typesys.store import Typestore

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io._topics import type_of

_IDL_HEADERS = re.compile(r"^=+$|^IDL: .*$", re.MULTILINE)


def learn(store: Typestore, message_type: str, connections: Iterable[Connection]) -> None:
    """Register a type of a topic's connections, and those that it consists of, if not known.

    Raises
    ------
    InputError
        If the bag does not define it, or in a way that cannot be read.
    """
    if message_type in store.fielddefs:
        return
    defined = [
        of
        for of in connections
        if type_of(of) == message_type and of.msgdef.format is not MessageDefinitionFormat.NONE
    ]
    if not defined:
        topic = next(of.topic for of in connections)
        raise InputError(f"{topic}: type {message_type} is not known, nor defined in the bag")
    topic, definition = defined[0].topic, defined[0].msgdef
    try:
        if definition.format is MessageDefinitionFormat.MSG:
            types = get_types_from_msg(definition.data, message_type)
        else:
            types = get_types_from_idl(_IDL_HEADERS.sub("", definition.data))
        known = store.fielddefs
        store.register({name: of for name, of in types.items() if name not in known})
        store.get_msgdef(message_type)
    except Exception as error:  # whatever the parser of a damaged definition raises
        reason = " ".join(str(error).split())
        raise InputError(f"{topic}: type {message_type} cannot be read: {reason}") from None
