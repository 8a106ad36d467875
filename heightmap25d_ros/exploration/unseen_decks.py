# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where ground ends high above what is known beside it, it may go on: as a deck not seen yet.

What is known there may be the ground below that deck: beyond the head of a ramp, if the lower level
was seen first, and beyond the part of a bridge that was seen. For one who is on the upper level it
is unknown all the same.
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

_FACE = 3
"""Cells so near to what is far below may be of the edge's face [cells]."""

_SQUARE = np.ones((3, 3), np.bool_)

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Edges:
    """A slice as it is for one who is on the ground above its drops.

    Attributes
    ----------
    beyond : (rows, columns) bool
        Known cells beside that ground, far below it.
    ground : (rows, columns) bool
        Beside them, with what the robot does not touch because of the drop.
    """

    beyond: Mask
    ground: Mask


def decks(layer: NDArray[np.int8]) -> Mask:
    """(rows, columns): the cells of a slice, by their layers, that have ground below them."""
    return np.asarray(ndimage.binary_opening(layer > 0, np.ones((_DECK, _DECK))))


def edges(
    ground: Mask,
    known: Mask,
    height: NDArray[np.float32],
    *,
    depth: float,
    clear_height: float,
    max_step: float,
) -> Edges | None:
    """Where ground that the robot touches ends above known cells; None: nowhere.

    Parameters
    ----------
    ground : (rows, columns) bool
        As of `frontiers.touched`.
    known : (rows, columns) bool
    height : (rows, columns) float32 [m]
    depth : float [cells]
        So far beyond the edge.
    clear_height : float [m]
        So far below it another level may be.
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
    is_low = known & (height <= height[known].max(initial=-np.inf) - clear_height)
    if not is_low.any():
        return None
    lowest = ndimage.minimum_filter(np.where(is_low, height, np.float32(np.inf)), 2 * _RIM + 1)
    upper = ground & (height - lowest >= clear_height)
    if not upper.any():
        return None
    away, nearest = ndimage.distance_transform_edt(~upper, return_indices=True)
    fall = height[tuple(nearest)] - height
    beside = known & (away <= _RIM + depth)
    is_far_below, is_near = beside & (fall >= clear_height), beside & (away <= _RIM)
    face = is_near & (fall > max_step)
    beyond = ndimage.binary_dilation(is_far_below, _SQUARE, iterations=_FACE, mask=face)
    rim = is_near & (np.abs(fall) <= max_step)
    return Edges(
        beyond=is_far_below | beyond,
        ground=frontiers.touched(rim, np.zeros_like(rim), upper, _RIM),
    )
