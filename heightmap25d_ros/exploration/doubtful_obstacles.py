# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Obstacles that are worth another look: low ones, of which too little has been seen.

From afar, with roll and pitch that err by a fraction of a degree, flat ground looks rough: a few
returns make steps that are none, and they close ramps and corridors. For an exploration such cells
are unknown. Nearby, or after looks in vain, they are what they seem to be.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, HeightMap, stored_probability
from heightmap25d_ros.kernels import kernel

BELIEVED = 0.9
"""Probability from which on a height is believed."""

LOW = 3.0
"""Of ``max_step``: so high above the ground beside it an obstacle may be noise."""

Mask = NDArray[np.bool_]


def doubtful(occupied: Mask, height_map: HeightMap, max_step: float) -> Mask:
    """(rows, columns): the occupied cells that may be noise.

    Parameters
    ----------
    occupied : (rows, columns) bool
    height_map : HeightMap
    max_step : float [m]
        That the robot climbs.

    Examples
    --------
    A low step of which little was seen, and a wall:

    >>> from dataclasses import replace
    >>> seen = HeightMap.from_metres(np.array([[0.0, 0.0, 0.15, 0.0, 0.0, 2.0]]))
    >>> probability = seen.probability - np.array([0, 0, 30000, 0, 0, 30000], np.uint16)
    >>> seen = replace(seen, probability=probability)
    >>> doubtful(seen.metres > 0.1, seen, max_step=0.1)
    array([[False, False,  True, False, False, False]])
    """
    cells = np.argwhere(occupied & height_map.known)
    result = np.zeros_like(occupied)
    highest = round(LOW * max_step / HEIGHT_RESOLUTION)
    _mark(
        cells, height_map.known, height_map.height, height_map.probability,
        stored_probability(BELIEVED), highest, result,
    )  # fmt: skip
    return result


@kernel
def _mark(cells, known, height, probability, believed, highest, result):
    rows, columns = known.shape
    for n in range(len(cells)):
        y, x = cells[n]
        lowest, is_sure = height[y, x], True
        for iy in range(max(y - 1, 0), min(y + 2, rows)):
            for ix in range(max(x - 1, 0), min(x + 2, columns)):
                if known[iy, ix]:
                    lowest = min(lowest, height[iy, ix])
                    is_sure &= probability[iy, ix] >= believed
        result[y, x] = not is_sure and np.int64(height[y, x]) - lowest <= highest
