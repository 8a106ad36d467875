# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Very large arrays of zeros that take memory only where they were written."""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from heightmap25d_ros.errors import InputError


def lazy_zeros(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Zeros of which only pages that have been written take memory.

    Anonymous private pages are allocated when they are first written; ``MAP_NORESERVE``
    keeps the kernel from accounting for the rest. Huge pages are refused: a single cell would
    commit 2 MiB (and numpy asks for them on its own for large arrays).

    Raises
    ------
    InputError
        If the addresses cannot be reserved.
    """
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    if not size:
        return np.zeros(shape, dtype)
    map_noreserve = getattr(mmap, "MAP_NORESERVE", 0x4000)  # in Python's mmap since 3.13
    try:
        pages = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | map_noreserve)
    except OSError as error:
        raise InputError(
            f"parameter grid.extent: cannot reserve {size / 2**30:.1f} GiB of addresses ({error})"
        ) from None
    pages.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(pages, dtype=dtype).reshape(shape)
