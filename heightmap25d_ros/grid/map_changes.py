# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a map differs from the one before, and a map with a part of it replaced."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import (
    SUSPECTED,
    Area,
    Cell,
    Geometry,
    HeightMap,
    stored_probability,
)
from heightmap25d_ros.kernels import inlined_kernel, kernel

_UNKNOWN = SUSPECTED + 1  # nor is this the height of a known cell


def changed_blocks(
    before: HeightMap, after: HeightMap, corner: Cell = (0, 0), side: int = 32
) -> NDArray[np.bool_]:
    """Squares of cells in which a map says otherwise than one that was a part of it.

    What a map says of a cell is its height, that a drop-off is suspected there, or nothing.

    Parameters
    ----------
    before, after : HeightMap
    corner : (iy, ix)
        The cell of the later map at which the earlier one begins, which it contains.
    side : int [cells]
        Of the squares.

    Returns
    -------
    (ceil(rows / side), ceil(columns / side)) bool
        Of the later map. Cells beyond the earlier one have changed.

    Examples
    --------
    >>> flat = HeightMap.from_metres(np.zeros((4, 6)))
    >>> raised = HeightMap.from_metres(np.eye(4, 6, 3))
    >>> changed_blocks(flat, raised, side=2)
    array([[False,  True,  True],
           [False, False,  True]])
    """
    rows, columns = after.geometry.shape
    changed = np.zeros((-(-rows // side), -(-columns // side)), np.bool_)
    least = (stored_probability(one.probability_threshold) for one in (before, after))
    _mark(
        (before.height, before.probability), (after.height, after.probability), tuple(least),
        corner, side, changed,
    )  # fmt: skip
    return changed


def part_in(inner: Geometry, outer: Geometry) -> Area | None:
    """The cells of a geometry among those of another one; None where they are no part of them."""
    if (inner.resolution, inner.ground_zero) != (outer.resolution, outer.ground_zero):
        return None
    iy, ix = (int(n) for n in outer.cell_at(np.add(inner.origin, 0.5 * inner.resolution)))
    inside = Area(iy, ix, *inner.shape)
    return inside if inside.within(Area(0, 0, *outer.shape)) == inside else None


def with_part(height_map: HeightMap, part: HeightMap) -> HeightMap:
    """Copy of a map in which another one has taken the place of its lowest surfaces there.

    Raises
    ------
    ValueError
        If it is no part of the map.
    """
    inside = part_in(part.geometry, height_map.geometry)
    if inside is None or part.probability_threshold != height_map.probability_threshold:
        raise ValueError("is no part of the map")
    here = inside.slices(Area(0, 0, *height_map.geometry.shape))
    height, probability = height_map.height.copy(), height_map.probability.copy()
    height[here], probability[here] = part.height, part.probability
    return replace(height_map, height=height, probability=probability, is_level=part.is_level)


@kernel
def _mark(before, after, least, corner, side, changed):
    for y in range(len(after[0])):
        for x in range(after[0].shape[1]):
            iy, ix = y - corner[0], x - corner[1]
            inside = 0 <= iy < len(before[0]) and 0 <= ix < before[0].shape[1]
            if not inside or _said(before, iy, ix, least[0]) != _said(after, y, x, least[1]):
                changed[y // side, x // side] = True


@inlined_kernel
def _said(cells, y, x, least):
    height, probability = cells
    if probability[y, x] >= least:
        return np.int32(height[y, x])
    return np.int32(SUSPECTED if height[y, x] == SUSPECTED else _UNKNOWN)
