# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Narrow unknown gaps in a map are filled with ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.grid.height_map import HEIGHT_LIMIT, PROBABILITY_SCALE, HeightMap
from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.terrain.steps import NEIGHBOURS, cropped


def fill_gaps(height_map: HeightMap, max_gap: float) -> HeightMap:
    """A map whose narrow unknown gaps are filled with ground.

    A gap gets the lowest height around it, on both sides: so a gap beside a wall becomes ground
    and the wall does not grow, and at a drop-off or a kerb the edge remains a blocked transition.

    Parameters
    ----------
    height_map : HeightMap
    max_gap : float [m]
    """
    width = int(max_gap / height_map.geometry.resolution + 1e-6)
    if not width:
        return height_map
    gap = closed(height_map.known, width + 1) & ~height_map.known
    iy, ix = np.nonzero(gap)
    filled = height_map.height.copy()
    filled[iy, ix] = _gap_heights(height_map.height, height_map.known, iy, ix, width)
    return replace(
        height_map,
        height=filled,
        probability=np.where(gap, np.uint16(PROBABILITY_SCALE), height_map.probability),
    )


def closed(cells: NDArray[np.bool_], side: int) -> NDArray[np.bool_]:
    """Cells and the gaps between them into which a square of a side [cells] does not fit."""
    # A morphological closing; the origins of an even square are mirrored in its two halves.
    mirrored = -((side - 1) % 2)
    dilated = ndimage.maximum_filter(np.pad(cells, side), side)
    return np.asarray(cropped(ndimage.minimum_filter(dilated, side, origin=mirrored), side))


@kernel
def _gap_heights(height, known, rows, columns, width):
    """The lowest known height [cm] around each gap cell, within half the width of the gap."""
    result = np.empty(len(rows), np.int16)
    for i in range(len(rows)):
        y, x = rows[i], columns[i]
        reach = _half_width(known, y, x, width)
        lowest = np.int16(HEIGHT_LIMIT)
        for iy in range(max(y - reach, 0), min(y + reach + 1, height.shape[0])):
            for ix in range(max(x - reach, 0), min(x + reach + 1, height.shape[1])):
                if known[iy, ix]:
                    lowest = min(lowest, height[iy, ix])
        result[i] = lowest
    return result


@kernel
def _half_width(known, y, x, width):
    """Distance [cells] from a gap cell within which known cells lie on two opposite sides."""
    least = width
    for k in range(4):
        dy, dx = NEIGHBOURS[k]
        farther = 0
        for side in (1, -1):
            distance = width
            for n in range(1, width):
                iy, ix = y + side * n * dy, x + side * n * dx
                inside = 0 <= iy < known.shape[0] and 0 <= ix < known.shape[1]
                if inside and known[iy, ix]:
                    distance = n
                    break
            farther = max(farther, distance)
        least = min(least, farther)
    return least
