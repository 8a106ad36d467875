# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a deck ends, it may go on: what is known there is the ground below it.

On a map with several levels the ground below a deck of which a part has been seen is known already.
For one who is on the deck the rest of it is unknown all the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

_DECK = 5
"""Side of the smallest deck [cells]: what is narrower is part of a wall."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DeckEdges:
    """A slice as it is for one who is on its decks.

    Attributes
    ----------
    deck : (rows, columns) bool
        Their cells.
    beyond : (rows, columns) bool
        Cells beside them, in which the slice has the ground far below.
    rim : (rows, columns) bool
        Level cells of the decks, which are occupied only because of the drop.
    height : (rows, columns) float32 [m]
        As if the decks went on.
    """

    deck: NDArray[np.bool_]
    beyond: NDArray[np.bool_]
    rim: NDArray[np.bool_]
    height: NDArray[np.float32]


def deck_edges(
    layer: NDArray[np.int8],
    height: NDArray[np.float32],
    reachable: NDArray[np.bool_],
    *,
    depth: float,
    clear_height: float,
    max_step: float,
) -> DeckEdges | None:
    """The edges of the decks that the robot can come to; None where there are none.

    Parameters
    ----------
    layer : (rows, columns) int8
        Of a slice, see `terrain.slices.Slice`.
    height : (rows, columns) float32 [m]
    reachable : (rows, columns) bool
        Cells at which the robot's centre may be.
    depth : float [cells]
        So far beside a deck.
    clear_height : float [m]
        So far below a deck is another level.
    max_step : float [m]
        That the robot climbs.
    """
    deck = ndimage.binary_opening(layer > 0, np.ones((_DECK, _DECK)))
    is_there = deck & reachable
    if not is_there.any():
        return None
    away, nearest = ndimage.distance_transform_edt(~deck, return_indices=True)
    of_deck = height[tuple(nearest)]
    beyond = (away > 0) & (away <= depth) & (layer >= 0) & (of_deck - height >= clear_height)
    nearest = ndimage.distance_transform_edt(~is_there, return_distances=False, return_indices=True)
    rim = deck & (np.abs(height - height[tuple(nearest)]) <= max_step)
    return DeckEdges(deck=deck, beyond=beyond, rim=rim, height=np.where(beyond, of_deck, height))
