# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cheapest paths over a grid of transitions: arrays in, costs and cells out.

A *transition* leads from a cell to one of its 8 neighbours and has a cost of its own, so that
uphill may cost more than downhill, and a blocked step does not close its cells. Costs are whole
numbers, `STRAIGHT` for a cell of flat ground, `DIAGONAL` for a diagonal one.

The search runs from the goal backwards, and its result is TRULLA's field (Murphy et al., 1999):
the cost to go, and so the best direction, at every cell. With a start it is A*, and ends there.

The queue is a ring of buckets, each a stack of cells with similar costs (A*: estimates). A bucket
spans less than any transition costs, so that without an estimate no cell can improve the path of
another one in its bucket, and their order does not matter (Dial, 1969; Denardo and Fox, 1979).
With an estimate it can; then a cell is expanded again, and the search ends when the bucket of the
start is empty.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import Cell
from heightmap25d_ros.kernels import inlined_kernel, kernel
from heightmap25d_ros.planning._intrinsics import lowest_bit, prefetch
from heightmap25d_ros.terrain.steps import NEIGHBOURS

STRAIGHT, DIAGONAL = 70, 99
"""Cost of a transition over one cell of flat ground: 99 / 70 is the root of 2 within 6e-5."""

LARGEST_COST = 7900
"""Highest cost of a transition: that of 113 cells of flat ground."""

CLOSED = 0
"""Marks a transition that cannot be taken, in place of its cost."""

UNREACHABLE = -1
"""Marks cells without a path to the goal, in place of their cost to go."""

LARGEST_SIDE = 32_000
"""Largest side of a grid [cells]: row and column of a cell are packed into 32 bits."""

_LIMIT = 2**31 - 2 * LARGEST_COST
"""Highest cost of a path: that of 3800 km of flat cells of 0.125 m."""

_WIDTH_BITS = 5
"""Width of a bucket, as a power of 2."""

_RING = 256
"""Number of buckets; together they span the cost of a transition and its change of an estimate."""

_CHUNK = 32
"""The stacks are linked chunks of this many entries; the first entry links the chunk below."""

_ENTRIES_PER_CELL = 9
"""A cell is queued at most once by each of its neighbours; one more for the links of chunks."""

_SLICE = 1_000_000
"""Cells that are expanded between two checks of the deadline."""

_AGAIN, _DONE = 0, 1

_at = np.uint64
"""Type of indices in the inner loop: numba tests signed ones for being negative."""


class SearchTimeoutError(Exception):
    """The search did not finish before its deadline."""


def to_cell(index: NDArray[np.float64] | NDArray[np.int64]) -> Cell:
    """Row and column as whole numbers."""
    return int(index[0]), int(index[1])


@dataclass(frozen=True, slots=True, eq=False)
class CostToGo:
    """The cost to go of each cell: the field around a goal.

    Attributes
    ----------
    incoming : (rows + 2, columns + 2, 8) uint16
        The costs of the transitions, as in `cost_to_go`.
    remaining : (rows + 2, columns + 2) int32
        The cost from each cell to the goal minus a constant, 0 where no path is known: so
        untouched memory means "unreachable".
    """

    incoming: NDArray[np.uint16]
    remaining: NDArray[np.int32]

    def __getitem__(self, cell: Cell) -> int:
        """Cost from a cell (row, column) to the goal, or `UNREACHABLE`."""
        value = int(self.remaining[cell[0] + 1, cell[1] + 1])
        return value + _LIMIT if value else UNREACHABLE

    def dense(self) -> NDArray[np.int32]:
        """(rows, columns) int32: cost to the goal, `UNREACHABLE` where no path is known."""
        inner = self.remaining[1:-1, 1:-1]
        return np.where(inner == 0, np.int32(UNREACHABLE), inner + np.int32(_LIMIT))

    def lower(self, costs: NDArray[np.float64], offset: float) -> None:
        """Replace costs [cells of flat ground] by those to the goal and beyond it, where lower.

        Parameters
        ----------
        costs : (rows, columns) float64
            Changed in place.
        offset : float [cells of flat ground]
            Cost from the goal on.
        """
        _lower(costs, self.remaining, offset)

    def direction(self, cell: Cell) -> int:
        """Index in `NEIGHBOURS` of the best step from a cell; -1 at the goal or without a path."""
        y, x = cell[0] + 1, cell[1] + 1
        return int(_direction(self.incoming, self.remaining, y, x))

    def cheapest_path(self, start: Cell) -> NDArray[np.int64]:
        """(N, 2) int64: the cells (row, column) of a cheapest path from a cell to the goal.

        Empty where no path is known.
        """
        if self[start] == UNREACHABLE:
            return np.empty((0, 2), np.int64)
        y, x = start[0] + 1, start[1] + 1
        return np.asarray(_cheapest_path(self.incoming, self.remaining, y, x) - 1)


def cost_to_go(
    incoming: NDArray[np.uint16],
    goal: Cell,
    *,
    start: Cell | None = None,
    deadline: float | None = None,
    links: NDArray[np.int32] | None = None,
) -> CostToGo:
    """The cost to go of all cells, or of those that A* needs for one start.

    Parameters
    ----------
    incoming : (rows + 2, columns + 2, 8) uint16
        ``incoming[y + 1, x + 1, k]``: cost of the transition into cell (y, x) from its neighbour
        ``NEIGHBOURS[k]``: `STRAIGHT` or, across, `DIAGONAL` at the least and `LARGEST_COST` at
        the most, or `CLOSED`. The border is closed.
    goal : (row, column)
    start : (row, column), optional
        Makes the search A*, which ends at this cell. The costs along its cheapest path are exact;
        those of other cells may be too high, or `UNREACHABLE`.
    deadline : float [s], optional
        Of `time.monotonic`.
    links : (rows + 2, columns + 2) int32, optional
        For each cell the flat index, with the border, of another one that is the same place and
        has the same cost to go; 0: none. Not together with a start.

    Raises
    ------
    SearchTimeoutError
        If the search does not finish before the deadline.

    Examples
    --------
    Along a row of four cells, of which the last one is closed:

    >>> incoming = np.zeros((3, 6, 8), np.uint16)
    >>> incoming[1, 1:3, 0] = incoming[1, 2:4, 4] = STRAIGHT
    >>> cost_to_go(incoming, (0, 0)).dense()
    array([[  0,  70, 140,  -1]], dtype=int32)
    >>> cost_to_go(incoming, (0, 0), start=(0, 2)).cheapest_path((0, 2)).tolist()
    [[0, 2], [0, 1], [0, 0]]
    """
    rows, columns = incoming.shape[:2]
    if max(rows, columns) > LARGEST_SIDE:
        raise ValueError(f"a grid of {rows} x {columns} cells is too large to be searched")
    remaining = np.zeros((rows, columns), np.int32)
    # The last entry of each bucket's stack, 0 where it is empty; and the entries: a cell (row and
    # column, 16 bits each) over its cost to go when it was queued.
    tops = np.zeros(_RING, np.int32)
    per_cell = _ENTRIES_PER_CELL + (links is not None)
    entries = np.empty(per_cell * rows * columns + _CHUNK * (_RING + 2), np.int64)
    is_guided = start is not None
    start_y, start_x = (start[0] + 1, start[1] + 1) if start is not None else (0, 0)
    y, x = goal[0] + 1, goal[1] + 1
    # Estimates are counted from the goal's own, so that the first bucket is bucket 0.
    offset = _LIMIT - (_estimate(y - start_y, x - start_x) if is_guided else 0)
    remaining[y, x] = -_LIMIT
    entries[_CHUNK : _CHUNK + 2] = 0, (y << 16 | x) << 32 | (-_LIMIT & 0xFFFFFFFF)
    tops[0] = _CHUNK + 1
    # The current bucket; the first of the released chunks, 0 where there is none; the first chunk
    # that was never used.
    state = np.array([0, 0, 2 * _CHUNK], np.int64)
    arrays = incoming.reshape(-1), remaining.reshape(-1), columns, tops, entries, state
    flat_links = None if links is None else links.reshape(-1)
    while _search(*arrays, flat_links, offset, start_y, start_x) == _AGAIN:
        if deadline is not None and time.monotonic() > deadline:
            raise SearchTimeoutError
    return CostToGo(incoming, remaining)


@inlined_kernel
def _estimate(dy, dx):
    """Lower bound of the cost of a path over this many rows and columns."""
    dy, dx = abs(dy), abs(dx)
    return STRAIGHT * max(dy, dx) + (DIAGONAL - STRAIGHT) * min(dy, dx)


# One long function: numba counts references to arrays that are passed on, which here takes three
# times as long as the search.
@kernel
def _search(  # noqa: C901, PLR0912, PLR0913, PLR0915
    incoming, remaining, columns, tops, entries, state, links, offset, start_y, start_x
):
    """Expand up to `_SLICE` cells; without an estimate if the start is in row 0, the border.

    Without links, numba leaves out the branches that test for them.
    """
    # Offsets of the neighbours in the flat arrays.
    hops = (
        1, columns + 1, columns, columns - 1, -1, -columns - 1, -columns, 1 - columns,
    )  # fmt: skip
    bucket, free, unused = state
    is_guided = start_y != 0
    start = start_y * columns + start_x
    for _ in range(_SLICE):
        # Pop an entry from the first bucket that is not empty.
        last = bucket + _RING
        while tops[_at(bucket & (_RING - 1))] == 0:
            bucket += 1
            if bucket == last:
                return _DONE
        slot = bucket & (_RING - 1)
        top = np.int64(tops[_at(slot)])
        entry = entries[_at(top)]
        top -= 1
        if top & (_CHUNK - 1) == 0:
            below = entries[_at(top)]
            entries[_at(top)] = free
            free, top = top, below
        tops[_at(slot)] = top
        packed, cost = entry >> 32, np.int64(np.int32(entry))
        y, x = packed >> 16, packed & 0xFFFF
        cell = y * columns + x
        if remaining[_at(cell)] != cost:  # a cheaper path has been found since
            continue
        if is_guided and remaining[start] != 0:
            if (remaining[start] + offset) >> _WIDTH_BITS < bucket:
                return _DONE
            if cost + _estimate(y - start_y, x - start_x) >= remaining[start]:
                continue
        cheaper = 0
        for k in range(8):
            step = np.int64(incoming[_at(8 * cell + k)])
            cheaper |= ((step != CLOSED) & (cost + step < remaining[_at(cell + hops[k])])) << k
        if links is not None:
            twin = np.int64(links[_at(cell)])
            cheaper |= ((twin != 0) & (cost < remaining[_at(twin)])) << 8
        while cheaper != 0:
            k = lowest_bit(cheaper)  # type: ignore[call-arg]
            cheaper &= cheaper - 1
            dy, dx = NEIGHBOURS[k & 7]
            hop = dy * columns + dx
            there, left = cell + hop, cost + np.int64(incoming[_at(8 * cell + k)])
            position = packed + (dy << 16) + dx
            if links is not None:  # noqa: SIM102 - numba leaves out tests of this alone only
                if k == 8:
                    there, left = np.int64(links[_at(cell)]), cost
                    position = there // columns << 16 | there % columns
            remaining[_at(there)] = left
            # It is expanded soon, and the data for that is far apart in memory.
            prefetch(incoming, 8 * there)
            prefetch(remaining, there + hop)
            priority = left + offset
            if is_guided:
                priority += _estimate(y + dy - start_y, x + dx - start_x)
            # Push it onto its bucket.
            slot = (priority >> _WIDTH_BITS) & (_RING - 1)
            top = np.int64(tops[_at(slot)])
            new = top + 1
            if (new & (_CHUNK - 1) == 0) | (top == 0):
                if free != 0:
                    chunk, free = free, entries[_at(free)]
                else:
                    chunk, unused = unused, unused + _CHUNK
                entries[_at(chunk)] = top
                new = chunk + 1
            entries[_at(new)] = position << 32 | (left & 0xFFFFFFFF)
            tops[_at(slot)] = new
    state[0], state[1], state[2] = bucket, free, unused
    return _AGAIN


@kernel
def _lower(costs, remaining, offset):
    for y in range(costs.shape[0]):
        for x in range(costs.shape[1]):
            if remaining[y + 1, x + 1] != 0:
                cost = offset + (remaining[y + 1, x + 1] + _LIMIT) / STRAIGHT
                costs[y, x] = min(costs[y, x], cost)


@kernel
def _direction(incoming, remaining, y, x):
    if remaining[y, x] == 0:
        return -1
    for k in range(8):
        dy, dx = NEIGHBOURS[k]
        cost = np.int64(incoming[y + dy, x + dx, k ^ 4])
        if cost != CLOSED and remaining[y, x] == remaining[y + dy, x + dx] + cost:
            return k
    return -1


@kernel
def _cheapest_path(incoming, remaining, y, x):
    cells = [(y, x)]
    while True:
        k = _direction(incoming, remaining, y, x)
        if k < 0:
            return np.array(cells)
        dy, dx = NEIGHBOURS[k]
        y, x = y + dy, x + dx
        cells.append((y, x))
