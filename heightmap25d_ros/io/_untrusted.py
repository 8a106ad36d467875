# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading bytes that come from outside: whatever is wrong with them is bad input."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from heightmap25d_ros.errors import InputError, printable

_LONGEST = 200  # characters of what an exception says, which may quote the bytes


@contextmanager
def as_input_error(what: str) -> Iterator[None]:
    """Reading bytes that come from outside: whatever is wrong with them is bad input."""
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{what}: {error.strerror or error}") from None
    except Exception as error:  # zipfile and numpy raise a dozen types on damaged bytes
        reason = printable(" ".join(str(error).split()) or type(error).__name__, _LONGEST)
        raise InputError(f"{what}: is damaged, or another kind of file: {reason}") from None


def require_only(archive: zipfile.ZipFile, path: Path, names: Iterable[str]) -> None:
    """An archive of arrays holds no others: one whose name is damaged must not seem to be absent.

    Raises
    ------
    InputError
        That names one which is none of these.
    """
    known = {f"{name}.npy" for name in names}
    for entry in archive.namelist():
        if entry not in known:
            found = printable(repr(entry.removesuffix(".npy")), _LONGEST)
            raise InputError(f"{path}: {found} is no array of this format_version")
