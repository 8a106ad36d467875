# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What of old submaps newer ones have made needless, so that memory grows with the area alone.

Cartographer drops submaps that lie under enough newer ones (its overlapping submaps trimmer). Here
the first submap of a place stays as well: it holds the frame, to which later drives come back.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array

_SIDES = np.array([1.0, 1.0, 2.0])  # [m] of the squares in which a submap is kept or not, by level


def squares_of(places: Array) -> NDArray[np.int64]:
    """The squares (K, 3), each once, of places x, y, z (N, 3) [m] of a submap.

    The third number is that of the level, since what is above a place does not make it needless.
    """
    if not len(places):
        return np.empty((0, 3), np.int64)
    index = _square_of(places)
    low = index.min(axis=0)
    is_seen = np.zeros(index.max(axis=0) - low + 1, bool)
    is_seen[tuple((index - low).T)] = True
    return np.asarray(np.argwhere(is_seen) + low)


def is_in(places: Array, squares: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which of places x, y, z (N, 3) [m] are in some of the squares (K, 3)."""
    if not len(places) or not len(squares):
        return np.zeros(len(places), bool)
    index = _square_of(places)
    low = np.minimum(index.min(axis=0), squares.min(axis=0))
    is_square = np.zeros(np.maximum(index.max(axis=0), squares.max(axis=0)) - low + 1, bool)
    is_square[tuple((squares - low).T)] = True
    return np.asarray(is_square[tuple((index - low).T)])


def needless(
    squares: Sequence[NDArray[np.int64]], T_map_submap: Sequence[se3.Matrix], newest: int
) -> list[NDArray[np.bool_]]:
    """Which squares of submaps are neither of the first nor of the newest ones of their place.

    Parameters
    ----------
    squares : sequence of (K, 3) int64
        Of each submap, from the oldest to the newest, in its own frame.
    T_map_submap : sequence of (4, 4) float64
    newest : int
        How many of the newest ones of a place are kept.

    Returns
    -------
    list of (K,) bool

    Examples
    --------
    >>> there = [np.array([[0, 0, 0], [number, 7, 0]]) for number in range(13)]
    >>> dropped = needless(there, [np.eye(4)] * 13, newest=10)
    >>> [number for number in range(13) if dropped[number][0]]
    [1, 2]
    >>> any(dropped[number][1] for number in range(13))
    False
    """
    centres = [
        ((own + (0.5, 0.5, 0.0)) * _SIDES) @ T[:3, :3].T + T[:3, 3]
        for own, T in zip(squares, T_map_submap, strict=True)
    ]
    ends = np.cumsum([len(own) for own in squares])
    place = _square_of(np.concatenate(centres))
    submap = np.repeat(np.arange(len(squares)), np.diff(ends, prepend=0))
    order = np.lexsort((submap, *place.T))
    is_new_place = (np.diff(place[order], axis=0, prepend=place[order[:1]] - 1) != 0).any(axis=1)
    begins = np.flatnonzero(is_new_place)
    counts = np.diff(begins, append=len(order))
    rank = np.arange(len(order)) - np.repeat(begins, counts)
    is_needless = np.empty(len(order), bool)
    is_needless[order] = (rank > 0) & (rank < np.repeat(counts, counts) - newest)
    return np.split(is_needless, ends[:-1])


def _square_of(places: Array) -> NDArray[np.int64]:
    # A level begins half its height below zero: where the robot starts is not at a seam.
    return np.asarray(np.floor(places / _SIDES + (0.0, 0.0, 0.5)), np.int64)
