# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The surfaces above the lowest ones: a bridge over a road, the upper deck of a garage.

The dense grid holds the lowest surface of each cell, complete from the ground up. What hangs in
the air above it is rare, and kept beside it: `UpperLayers` in the growing map, `UpperSurfaces` in
a dense rectangle of it, in files and in messages.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heightmap25d_ros.grid.lazy_zeros import lazy_zeros

TOP, BOTTOM, CANDIDATE = 0, 1, 2
"""Heights of an upper surface in `UpperLayers.heights`."""

SAME_HEIGHT = 10
"""Up to which tops of neighbours are one surface [cm]."""

BELIEF, CANDIDATE_BELIEF = 0, 1
"""Probabilities of an upper surface in `UpperLayers.beliefs`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UpperSurfaces:
    """Surfaces above the lowest ones of a dense map, by row, column and top.

    Attributes
    ----------
    cell : (N, 2) int64
        (iy, ix).
    top, bottom : (N,) int16 [cm] above ground zero
        The bottom is the lowest reading of the surface; its underside, where that was seen.
    probability : (N,) uint16, 0 .. `PROBABILITY_SCALE` for 0 .. 1

    Examples
    --------
    A deck at 2.4 m over two cells:

    >>> deck = UpperSurfaces.of([(0, 0), (0, 1)], top=[240, 240], bottom=[210, 240])
    >>> len(deck)
    2
    >>> len(UpperSurfaces.of([]))
    0
    """

    cell: NDArray[np.int64]
    top: NDArray[np.int16]
    bottom: NDArray[np.int16]
    probability: NDArray[np.uint16]

    @classmethod
    def of(
        cls,
        cell: ArrayLike,
        top: ArrayLike = (),
        bottom: ArrayLike = (),
        probability: ArrayLike | None = None,
    ) -> UpperSurfaces:
        """Surfaces in any order; those without a probability are certain.

        Raises
        ------
        ValueError
            If the arrays do not go with one another, or a bottom is above its top.
        """
        cells = np.asarray(cell, np.int64).reshape(-1, 2)
        tops, bottoms = np.asarray(top, np.int16), np.asarray(bottom, np.int16)
        beliefs = (
            np.full(len(cells), 65535, np.uint16)
            if probability is None
            else np.asarray(probability, np.uint16)
        )
        if not tops.shape == bottoms.shape == beliefs.shape == (len(cells),):
            raise ValueError("upper surfaces: cell, top, bottom and probability differ in length")
        if (bottoms > tops).any():
            raise ValueError("upper surfaces: a bottom is above its top")
        order = np.lexsort((tops, cells[:, 1], cells[:, 0]))
        return cls(
            cell=cells[order], top=tops[order], bottom=bottoms[order], probability=beliefs[order]
        )

    def __len__(self) -> int:
        return len(self.top)

    @property
    def rank(self) -> NDArray[np.int64]:
        """(N,): number of surfaces in the list that are below one in its own cell."""
        is_first = np.ones(len(self), np.bool_)
        is_first[1:] = (np.diff(self.cell, axis=0) != 0).any(axis=1)
        index = np.arange(len(self))
        return index - np.maximum.accumulate(np.where(is_first, index, 0))

    def where(self, chosen: NDArray[np.bool_]) -> UpperSurfaces:
        """Some of the surfaces, in their order."""
        return UpperSurfaces(
            cell=self.cell[chosen],
            top=self.top[chosen],
            bottom=self.bottom[chosen],
            probability=self.probability[chosen],
        )

    def moved(self, rows: int, columns: int) -> UpperSurfaces:
        """The same surfaces, so many cells farther."""
        return replace(self, cell=self.cell + (rows, columns))

    def part(self, iy: int, ix: int, rows: int, columns: int) -> UpperSurfaces:
        """Those in a rectangle of cells, counted from its first row and column."""
        return self.where(self._inside(iy, ix, rows, columns)).moved(-iy, -ix)

    def outside(self, iy: int, ix: int, rows: int, columns: int) -> UpperSurfaces:
        """Those outside of a rectangle of cells."""
        return self.where(~self._inside(iy, ix, rows, columns))

    def at(
        self, index: NDArray[np.int64], columns: int, lift: NDArray[np.int32] | int
    ) -> UpperSurfaces:
        """Those of other cells (rows, columns), lifted [cm].

        Each cell has the surfaces of the one with a flat index in the rows of these; -1: none.
        """
        flat = self.cell[:, 0] * columns + self.cell[:, 1]
        begins, ends = (np.searchsorted(flat, index, side) for side in ("left", "right"))
        has_some = ends > begins
        count = (ends - begins)[has_some]
        chosen = np.repeat(begins[has_some], count)
        chosen += np.concatenate([np.arange(0), *(np.arange(n) for n in count)])
        lifts = np.repeat(np.broadcast_to(lift, index.shape)[has_some], count)
        return UpperSurfaces.of(
            np.repeat(np.argwhere(has_some), count, axis=0), self.top[chosen] + lifts,
            self.bottom[chosen] + lifts, self.probability[chosen],
        )  # fmt: skip

    def with_others(self, others: UpperSurfaces) -> UpperSurfaces:
        """These and those of other cells."""
        return UpperSurfaces.of(
            np.concatenate([self.cell, others.cell]),
            np.concatenate([self.top, others.top]),
            np.concatenate([self.bottom, others.bottom]),
            np.concatenate([self.probability, others.probability]),
        )

    def continued_by(self, others: UpperSurfaces) -> NDArray[np.bool_]:
        """(N,) of others: those with the same height as these in two of the cells around them."""
        if not len(self):
            return np.zeros(len(others), np.bool_)
        columns = 2 + int(max(self.cell[:, 1].max(initial=0), others.cell[:, 1].max(initial=0)))
        keys, wanted = self.cell @ (columns, 1), others.cell @ (columns, 1)
        depth = 1 + int(self.rank.max(initial=0))
        count = np.zeros(len(others), np.int64)
        steps = [y * columns + x for y in (-1, 0, 1) for x in (-1, 0, 1) if (y, x) != (0, 0)]
        for beside in steps:
            at = np.searchsorted(keys, wanted + beside)[:, None] + np.arange(depth)
            index = np.minimum(at, len(self) - 1)
            is_there = (at < len(self)) & (keys[index] == (wanted + beside)[:, None])
            off = np.abs(self.top[index].astype(np.int64) - others.top[:, None])
            count += (is_there & (off <= SAME_HEIGHT)).any(axis=1)
        return count >= 2

    def _inside(self, iy: int, ix: int, rows: int, columns: int) -> NDArray[np.bool_]:
        cell = self.cell - (iy, ix)
        return np.asarray(((cell >= 0) & (cell < (rows, columns))).all(axis=1))


NO_UPPER = UpperSurfaces.of([])
"""Nothing above the lowest surfaces."""


class UpperLayers:
    """The surfaces above the lowest one in the cells of a growing map, in layers.

    The layers of a cell are in no order: a surface takes the first free one. What is hidden below
    the lowest surface, until that proves to hang in the air, is in one more layer. Memory is
    committed by the page, as cells are written.

    Parameters
    ----------
    count : int
        Number of layers; 0: none, and nothing is hidden.
    shape : (tile rows, tile columns, rows, columns)

    Attributes
    ----------
    heights : (count, *shape, 3) int16 [cm]
        Top, bottom, and a candidate: a reading above the top that awaits confirmation.
    beliefs : (count, *shape, 2) uint16
        Probability of the surface, below the threshold where there is none; and of its candidate,
        0 where there is none.
    stored : ((count + 1, *shape, 3) int16, (count + 1, *shape, 2) uint16)
        The two in memory, followed by what is hidden, which has no bottom.
    tile_span : (tile rows, tile columns, 2) int32 [cm]
        Lowest bottom and highest top in each tile, plus a bias; 0, 0: no surface.
    """

    def __init__(self, count: int, shape: tuple[int, int, int, int]) -> None:
        layers = count + 1 if count else 0
        self.stored = (
            lazy_zeros((layers, *shape, 3), np.int16),
            lazy_zeros((layers, *shape, 2), np.uint16),
        )
        self.heights, self.beliefs = self.stored[0][:count], self.stored[1][:count]
        self.tile_span = lazy_zeros((*shape[:2], 2), np.int32)

    @property
    def count(self) -> int:
        """Number of layers."""
        return len(self.heights)
