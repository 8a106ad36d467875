# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages with fields that no sound driver fills in: of any type, by its definition."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from bag_writer import STORE
from repository import ROOT
from rosbags.serde import SerdeError
from rosbags.typesys import get_types_from_msg

FLOATS = (
    np.nan, np.inf, -np.inf, 0.0, -0.0, 1.0, -1.0, 1e-310, 1e-30, 1e-9, 1e-3, 1e3, 1e6, 1e9, 1e18,
    3.4e38, 1.7e308, -1e-9, -1e6, -1.7e308, np.pi, 2 * np.pi, 100 * np.pi,
)  # fmt: skip
"""What floats become, as far as their type holds it."""

INTEGERS = (0, 1, 2, -1, 127, 128, 255, 32767, 10**6, 10**9, 2**31 - 1, -(2**31), 2**32 - 1, 2**63)

TEXTS = (
    "", "/", "map", "odom", "base_link", "laser", "/map", "a" * 100, "a" * 101, "a" * 100_000, "\n",
    "\0", "map\0", "../..", "%s%n", "\u202emap", "\U0010ffff", "'; DROP TABLE messages; --", " ",
)  # fmt: skip

MANY, FEW = 5000, 50
"""Elements of an array of numbers that is too long, and of one of messages."""

_BASE, _NAME, _ARRAY = 1, 2, 3  # rosbags' kinds of fields; 4 is a sequence


def learn_messages() -> None:
    """Teach rosbags the messages of heightmap25d_msgs."""
    for path in sorted((ROOT / "heightmap25d_msgs" / "msg").glob("*.msg")):
        name = f"heightmap25d_msgs/msg/{path.stem}"
        if name not in STORE.types:
            STORE.register(get_types_from_msg(path.read_text(), name))


def default(name: str) -> Any:
    """A message of a type in which all is zero or empty."""
    values = {field: _zero(kind) for field, kind in STORE.fielddefs[name][1]}
    return STORE.types[name](**values)


def mutated(random: np.random.Generator, message: Any) -> Any:
    """A copy of a message in which one to a few fields, or its bytes, are changed.

    A copy whose bytes make no message any more has changed fields instead, as DDS lets none
    through.
    """
    if random.random() < 0.25:
        from_bytes = _with_other_bytes(random, message)
        if from_bytes is not None:
            return from_bytes
    message = copy.deepcopy(message)
    for _ in range(random.geometric(0.6)):
        _change(random, message)
    return message


def _with_other_bytes(random: np.random.Generator, message: Any) -> Any | None:
    name = message.__msgtype__
    data = np.frombuffer(STORE.serialize_cdr(message, name), np.uint8).copy()
    places = random.integers(4, len(data), random.geometric(0.3))  # the first four are DDS's own
    data[places] = random.integers(0, 256, len(places))
    try:
        return STORE.deserialize_cdr(data.tobytes(), name)
    except (SerdeError, UnicodeDecodeError, MemoryError, ValueError, IndexError):
        return None


def _change(random: np.random.Generator, message: Any) -> None:
    """Change one field, at any depth; each field of a message is as likely as the others."""
    fields = STORE.fielddefs[message.__msgtype__][1]
    if not fields:
        return
    name, (kind, argument) = fields[random.integers(len(fields))]
    value = getattr(message, name)
    if kind == _NAME:
        _change(random, value)
    elif kind == _BASE:
        setattr(message, name, _scalar(random, argument[0]))
    else:
        element = argument[0]
        setattr(message, name, _elements(random, value, element, is_fixed=kind == _ARRAY))


def _scalar(random: np.random.Generator, base: str) -> Any:
    if base == "string":
        return TEXTS[random.integers(len(TEXTS))]
    if base == "bool":
        return bool(random.integers(2))
    if base.startswith("float"):
        with np.errstate(over="ignore"):
            return float(np.dtype(base).type(random.choice(FLOATS)))
    limits = np.iinfo(base)
    return int(np.clip(INTEGERS[random.integers(len(INTEGERS))], limits.min, limits.max))


def _elements(random: np.random.Generator, value: Any, element: Any, *, is_fixed: bool) -> Any:
    """Other elements of an array, and other ones more or less where its length is free."""
    kind, argument = element
    length = len(value) if is_fixed else _length(random, len(value))
    if kind == _NAME:
        kept = [value[i % len(value)] for i in range(min(length, FEW))] if len(value) else []
        for index in range(min(random.geometric(0.5), len(kept))):
            kept[index] = copy.deepcopy(kept[index])
            _change(random, kept[index])
        return kept
    if argument[0] in ("string", "bool"):
        return value
    array = np.resize(np.asarray(value, argument[0]), length)
    places = slice(None) if random.random() < 0.3 else random.random(length) < random.random()
    array[places] = _scalar(random, argument[0])
    return array


def _length(random: np.random.Generator, length: int) -> int:
    return int(random.choice([length, length, 0, 1, max(length - 1, 0), length + 1, MANY]))


def _zero(kind: Any) -> Any:
    node, argument = kind
    if node == _NAME:
        return default(argument)
    if node == _BASE:
        return "" if argument[0] == "string" else np.zeros((), argument[0]).item()
    (inner, inner_argument), length = argument
    if inner == _NAME:
        return [default(inner_argument) for _ in range(length)]
    return np.zeros(length, inner_argument[0])
