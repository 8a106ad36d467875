# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a map holds within windows of cells: lowest and highest height, edges, unknown cells.

The bounds of `branch_and_bound` read them. A window of level l covers the cells that a point can
touch while the robot is moved within 2^l cells, by bilinear interpolation: 2^l + 2 in each
direction. Windows begin at every cell (as in Hess et al., *Real-Time Loop Closure in 2D LIDAR
SLAM*, 2016); the window of a level is the union of four of the level before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION

LEVELS = 3
"""Number of levels; the windows of the last one are for moves of four cells."""

KNOWN, EDGE, NEAR_KNOWN, BEYOND = 1, 2, 4, 8
"""Flags: a known cell, an edge, an unknown cell near known ones, and one that is not, are there."""

NOTHING = 32000
"""Lowest height [cm] of a window without known cells; their highest one is its negative."""

ANYWHERE = NOTHING - 1000
"""Highest z [cm] of a robot whose z is unknown: a window without known cells is never so near."""

_PAD: int = 2 ** (LEVELS - 1) + 2  # [cells] of the widest window, before the first cell
_GROUND_GAP = 4.0  # [cells] to known ground, over which the robot can stand
_WHOLE = 0.01  # [cm] within which a height is one of whole centimetres, as maps store them
_BYTES = 60  # of a cell: six a level and the work while it is made


class Phases(NamedTuple):
    """Windows of the highest level; [py, px, y, x] is that which begins at cell 4 y + py, 4 x + px.

    Attributes
    ----------
    low, high : (4, 4, rows, columns) int16
    flags : (4, 4, rows, columns) uint8
    """

    low: NDArray[np.int16]
    high: NDArray[np.int16]
    flags: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class HeightPyramid:
    """Windows of a map, and the ground that the robot can stand on.

    Attributes
    ----------
    windows : (LEVELS, rows, columns, 3) int16
        Lowest and highest known height [cm] above ``base``, and flags, of the window that begins
        at a cell.
    ground : tuple of (rows_l, columns_l, 2) int16
        For each level lowest and highest ground [cm] above ``base`` within blocks of 2^l cells, of
        the map without a border: the nearest known cell that is no edge, at most four cells away.
        `NOTHING` where there is none.
    base : float [m], whole
    pad : int [cells]
        From the first cell of ``windows`` to that of the map.
    """

    windows: NDArray[np.int16]
    ground: tuple[NDArray[np.int16], ...]
    base: float
    pad: int

    @cached_property
    def phases(self) -> Phases:
        """The widest windows, in the order in which squares side by side read them; cached."""
        widest, side = self.windows[-1], 2 ** (LEVELS - 1)
        rows, columns = (-(-length // side) for length in widest.shape[:2])
        return Phases(*(
            np.ascontiguousarray(
                np.pad(
                    layer,
                    [(0, side * blocks - length)
                     for blocks, length in zip((rows, columns), layer.shape, strict=True)],
                    constant_values=outside,
                ).reshape(rows, side, columns, side).transpose(1, 3, 0, 2)
            )
            for layer, outside in (
                (widest[:, :, 0], NOTHING), (widest[:, :, 1], -NOTHING),
                (widest[:, :, 2].astype(np.uint8), BEYOND),
            )
        ))  # fmt: skip

    def ground_at(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Array:
        """Heights (N,) [m] of the ground of cells of the map; NaN where there is none."""
        low = self.ground[0][rows, columns, 0]
        return np.where(low == NOTHING, np.nan, self.base + HEIGHT_RESOLUTION * low)


def memory_of(shape: tuple[int, int]) -> int:
    """Memory [bytes] that the pyramid of a map of a shape, with its border, takes to be made."""
    rows, columns = shape
    return _BYTES * (rows + 2 * _PAD) * (columns + 2 * _PAD)


def pyramid_of(
    heights: NDArray[np.float32],
    is_edge: NDArray[np.bool_],
    counts: NDArray[np.bool_],
    border: int,
) -> HeightPyramid:
    """The pyramid of a map.

    Parameters
    ----------
    heights, is_edge, counts : (rows, columns)
        As `surface.Surface.bordered`: heights [m], edges, cells near known ones.
    border : int [cells]
        Of unknown cells around the map.
    """
    is_known = ~np.isnan(heights)
    base = float(np.rint(np.median(heights[is_known]))) if is_known.any() else 0.0
    centimetres = np.where(is_known, (heights - base) / HEIGHT_RESOLUTION, 0.0)
    low = np.where(is_known, np.floor(centimetres + _WHOLE), NOTHING).astype(np.int16)
    high = np.where(is_known, np.ceil(centimetres - _WHOLE), -NOTHING).astype(np.int16)
    flags = np.where(
        is_known, np.where(is_edge, KNOWN | EDGE, KNOWN), np.where(counts, NEAR_KNOWN, BEYOND)
    )
    layers = [
        (low, np.minimum, NOTHING),
        (high, np.maximum, -NOTHING),
        (flags.astype(np.int16), np.bitwise_or, BEYOND),
    ]
    shape = low.shape[0] + 2 * _PAD, low.shape[1] + 2 * _PAD
    windows = np.empty((LEVELS, *shape, 3), np.int16)
    for index, (layer, union, outside) in enumerate(layers):
        window = np.pad(layer, _PAD, constant_values=outside)
        for shift in (1, 1):  # 3 x 3 cells
            window = _grown(window, shift, union, outside)
        windows[0, :, :, index] = window
        for level in range(1, LEVELS):
            window = _grown(window, 2 ** (level - 1), union, outside)
            windows[level, :, :, index] = window
    inside = (slice(border, -border), slice(border, -border))
    ground = _ground(centimetres[inside], (is_known & ~is_edge)[inside])
    return HeightPyramid(windows, ground, base, border + _PAD)


def _grown(
    layer: NDArray[np.int16], shift: int, union: Callable[..., NDArray[np.int16]], outside: int
) -> NDArray[np.int16]:
    """The union of a layer with itself from a number of cells on, to the right and above."""
    right = np.full_like(layer, outside)
    right[:, :-shift] = layer[:, shift:]
    wide = union(layer, right)
    above = np.full_like(layer, outside)
    above[:-shift] = wide[shift:]
    return union(wide, above)


def _ground(
    centimetres: NDArray[np.float32], is_ground: NDArray[np.bool_]
) -> tuple[NDArray[np.int16], ...]:
    """`HeightPyramid.ground`."""
    height = np.full(centimetres.shape, NOTHING, np.int16)
    if is_ground.any():
        distance, nearest = ndimage.distance_transform_edt(~is_ground, return_indices=True)
        filled = np.rint(centimetres[tuple(nearest)])
        height = np.where(distance <= _GROUND_GAP, filled, NOTHING).astype(np.int16)
    levels = [np.stack([height, np.where(height == NOTHING, -NOTHING, height)], axis=2)]
    for _ in range(1, LEVELS):
        below = levels[-1]
        rows, columns = (-(-side // 2) for side in below.shape[:2])
        blocks = np.empty((2 * rows, 2 * columns, 2), np.int16)
        blocks[:, :] = NOTHING, -NOTHING
        blocks[: below.shape[0], : below.shape[1]] = below
        blocks = blocks.reshape(rows, 2, columns, 2, 2)
        lowest, highest = blocks[..., 0].min(axis=(1, 3)), blocks[..., 1].max(axis=(1, 3))
        levels.append(np.stack([lowest, highest], axis=2))
    return tuple(levels)
