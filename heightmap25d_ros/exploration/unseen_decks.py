# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frontiers of a level where another one is known: ground may go on above or below what is known.

Where ground ends high above what is known beside it, that may be the ground below a deck not seen
yet: beyond the head of a ramp, if the lower level was seen first, and beyond the part of a bridge
that was seen. And what is known high above ground, and is driven on, may be a deck under which that
ground goes on, if the upper level was seen first. For one who is on the level that ends there it is
unknown all the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.exploration import frontiers

_DECK = 5
"""Side of the smallest deck [cells]: what is narrower is part of a wall."""

_RIM = 8
"""So far from what the robot touches of it ground may end [cells]: the robot keeps off drops."""

_FACE = 2
"""Cells so near to what is far below, or above, may be of the edge's face [cells]."""

_SQUARE = np.ones((3, 3), np.bool_)

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Edges:
    """A slice as it is for one who is on ground that ends at another level.

    Attributes
    ----------
    beyond : (rows, columns) bool
        Known cells of the other level, beside that ground.
    ground : (rows, columns) bool
        Beside them, with what the robot does not touch because of the edge.
    """

    beyond: Mask
    ground: Mask


def decks(layer: NDArray[np.int8]) -> Mask:
    """(rows, columns): the cells of a slice, by their layers, that have ground below them."""
    return np.asarray(ndimage.binary_opening(layer > 0, np.ones((_DECK, _DECK))))


def edges(
    ground: Mask,
    others: Mask,
    height: NDArray[np.float32],
    *,
    depth: float,
    clear_height: float,
    max_step: float,
) -> Edges | None:
    """Where ground that the robot touches ends above another level; None: nowhere.

    With all heights negated: where it ends below one.

    Parameters
    ----------
    ground : (rows, columns) bool
        As of `frontiers.touched`.
    others : (rows, columns) bool
        Known cells that may be of another level.
    height : (rows, columns) float32 [m]
    depth : float [cells]
        So far beyond the edge.
    clear_height : float [m]
        So far below the ground another level may be.
    max_step : float [m]
        That the robot climbs.

    Examples
    --------
    The head of a ramp, of which the last cell is occupied because of the drop:

    >>> height = np.array([[2.0, 2.1, 2.2, 0.0, 0.0, 0.0]], np.float32)
    >>> ground = np.array([[True, True, False, False, False, False]])
    >>> found = edges(ground, ground | True, height, depth=2, clear_height=0.7, max_step=0.11)
    >>> found.beyond
    array([[False, False, False,  True,  True,  True]])
    >>> found.ground
    array([[ True,  True,  True, False, False, False]])
    """
    is_low = others & (height <= height[ground].max(initial=-np.inf) - clear_height)
    if not is_low.any():
        return None
    lowest = ndimage.minimum_filter(np.where(is_low, height, np.float32(np.inf)), 2 * _RIM + 1)
    edge = ground & (height - lowest >= clear_height)
    if not edge.any():
        return None
    away, nearest = ndimage.distance_transform_edt(~edge, return_indices=True)
    fall = height[tuple(nearest)] - height
    is_far_below = others & (away <= _RIM + depth) & (fall >= clear_height)
    farthest = ndimage.maximum_filter(np.where(is_far_below, fall, -np.inf), 2 * _FACE + 1)
    face = (away <= _RIM) & (fall > max_step) & (fall <= farthest + max_step)  # and no parapet
    beyond = ndimage.binary_dilation(is_far_below, _SQUARE, iterations=_FACE, mask=face)
    rim = (away <= _RIM) & (np.abs(fall) <= max_step)
    return Edges(
        beyond=is_far_below | beyond,
        ground=frontiers.touched(rim, np.zeros_like(rim), edge, _RIM),
    )
