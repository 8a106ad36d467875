# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The search in C (planner.c) behind the interface of `heightmap25d_ros.planner.cost_to_go`."""

from __future__ import annotations

import ctypes
import functools
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import Cell
from heightmap25d_ros.planning.search import DIAGONAL, LARGEST_COST, STRAIGHT, CostToGo

COMPILER = ("cc", "-O3", "-march=native", "-fPIC", "-shared")
SOURCE = Path(__file__).with_name("planner.c")

LIMIT = 2**31 - 2 * LARGEST_COST
RING, CHUNK, ENTRIES_PER_CELL = 256, 32, 9


@functools.cache
def _library() -> ctypes.CDLL:
    with tempfile.TemporaryDirectory() as directory:
        library = Path(directory) / "planner.so"
        subprocess.run([*COMPILER, str(SOURCE), "-o", str(library)], check=True)
        return ctypes.CDLL(str(library))


def cost_to_go(incoming: NDArray[np.uint16], goal: Cell, *, start: Cell | None = None) -> CostToGo:
    """As `planner.cost_to_go`, without a deadline."""
    rows, columns = incoming.shape[:2]
    remaining = np.zeros((rows, columns), np.int32)
    tops = np.zeros(RING, np.int32)
    entries = np.empty(ENTRIES_PER_CELL * rows * columns + CHUNK * (RING + 2), np.int64)
    start_y, start_x = (start[0] + 1, start[1] + 1) if start is not None else (0, 0)
    y, x = goal[0] + 1, goal[1] + 1
    away = sorted((abs(y - start_y), abs(x - start_x))) if start is not None else (0, 0)
    offset = LIMIT - STRAIGHT * away[1] - (DIAGONAL - STRAIGHT) * away[0]
    remaining[y, x] = -LIMIT
    entries[CHUNK : CHUNK + 2] = 0, (y << 16 | x) << 32 | (-LIMIT & 0xFFFFFFFF)
    tops[0] = CHUNK + 1
    _library().search(
        ctypes.c_void_p(incoming.ctypes.data),
        ctypes.c_void_p(remaining.ctypes.data),
        ctypes.c_int64(columns),
        ctypes.c_void_p(tops.ctypes.data),
        ctypes.c_void_p(entries.ctypes.data),
        *(ctypes.c_int64(value) for value in (offset, start_y, start_x)),
    )
    return CostToGo(incoming, remaining)
