# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files that a disk, a network or a stranger has changed."""

from __future__ import annotations

import io
import re
import zipfile

import numpy as np

BLOCK = 512
"""Bytes that a disk loses at once."""

SCALARS = (
    "", "~", "nan", ".nan", ".inf", "-.inf", "0", "-1", "1e400", "-1e400", "1.5", "1" + "0" * 390,
    "2024-13-45", "0o17", "0x7fffffffffffffff", "true", "yes", "[]", "{}", "[1, 2, 3]", "[[[[]]]]",
    "{a: b}", "'x'", '"\\x00"', "\t", "&a 1", "*a", "&a [*a]", "!!python/object:os.system x",
    "!!binary aGk=", "!!set {a}", "- 1", "x" * 10_000, "a: b: c", "|", ">", "? ", "%", "@", "`",
)  # fmt: skip
"""What a value of a YAML file becomes."""

NASTY = (
    np.nan, np.inf, -np.inf, 0, -1, 1e-9, 1e18, -1e18, 2**31, 2**63 - 1, "", "map\n", "\0",
    "a" * 2000, "\U0010ffff", b"map", True, None,
)  # fmt: skip
"""What a field of a map file becomes."""


def damaged(random: np.random.Generator, data: bytes) -> bytes:
    """Bytes that were flipped, lost, cut off, repeated or moved."""
    if not data:
        return data
    kind = random.integers(6)
    content = np.frombuffer(data, np.uint8).copy()
    at = int(random.integers(len(data)))
    if kind == 0:
        places = random.integers(len(data), size=random.geometric(0.2))
        content[places] = random.integers(0, 256, len(places))
    elif kind == 1:
        return data[:at]
    elif kind == 2:
        content[at : at + BLOCK] = 0
    elif kind == 3:
        other = int(random.integers(len(data)))
        block = content[other : other + BLOCK].copy()
        content[at : at + len(block)] = block[: len(content[at : at + len(block)])]
    elif kind == 4:
        return data[:at] + data[at + int(random.integers(1, BLOCK)) :]
    else:
        return data[:at] + random.bytes(int(random.integers(1, BLOCK))) + data[at:]
    return content.tobytes()


def damaged_yaml(random: np.random.Generator, text: str) -> str:
    """A YAML file with other values, lines, indentations or characters."""
    lines = text.splitlines()
    for _ in range(random.geometric(0.4)):
        at = int(random.integers(len(lines)))
        kind = random.integers(6)
        if kind == 0:
            value = SCALARS[random.integers(len(SCALARS))]
            lines[at] = re.sub(r":.*$", lambda _: f": {value}", lines[at])  # noqa: B023
        elif kind == 1:
            lines.insert(at, lines[int(random.integers(len(lines)))])
        elif kind == 2:
            lines[at] = " " * int(random.integers(1, 9)) + lines[at].lstrip()
        elif kind == 3:
            character = "\0\x7f\u2028\ufeff\U0001f600{}[]&*!|>'\"%@`,:#-?\t"[random.integers(24)]
            place = int(random.integers(len(lines[at]) + 1))
            lines[at] = lines[at][:place] + character + lines[at][place:]
        elif kind == 4 and len(lines) > 1:
            del lines[at]
        else:
            lines[at] = lines[at].replace(":", random.choice([": ", "", ":\n  "]))
        lines = lines or [""]
    return "\n".join(lines)


def damaged_arrays(random: np.random.Generator, data: bytes) -> bytes:
    """An .npz whose checksums are right, and one of whose arrays is another one, or missing."""
    with np.load(io.BytesIO(data)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    name = list(arrays)[random.integers(len(arrays))]
    kind = random.integers(6)
    value = arrays[name]
    if kind == 0:
        del arrays[name]
    elif kind == 1:
        arrays[name] = np.array(NASTY[random.integers(len(NASTY))])
    elif kind == 2:
        types = ("int8", "uint64", "float16", "complex64", "U5", "S3", "M8[s]", "O", "bool")
        arrays[name] = np.zeros(value.shape, types[random.integers(len(types))])
    elif kind == 3:
        arrays[name] = np.resize(value, random.integers(0, 70, random.integers(0, 4)))
    elif kind == 4 and value.dtype.kind in "iuf" and value.size:
        array = value.copy()
        limits = np.iinfo(array.dtype) if array.dtype.kind in "iu" else np.finfo(array.dtype)
        array.flat[random.integers(array.size)] = random.choice([limits.min, limits.max])
        arrays[name] = array
    else:
        arrays[f"../{name}"] = value
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive_out:
        for member, array in arrays.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, np.asanyarray(array), allow_pickle=True)
            archive_out.writestr(f"{member}.npy", content.getvalue())
    return buffer.getvalue()
