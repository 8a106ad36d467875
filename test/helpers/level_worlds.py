# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small exact maps with several levels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.grid.levels import UpperSurfaces

BRIDGE = ((5.0, 7.0), (4.0, 6.0))
"""x and y [m] of the level part of the bridge; a ramp on either side leads up along x."""


def overpass(deck: float = 2.0, thickness: float = 0.3, resolution: float = 0.125) -> HeightMap:
    """Ground of 12 m x 10 m, and a bridge along x over a road along y.

    The ramps, from x = 1 m and from x = 11 m on, are complete from the ground up.
    """
    shape = round(10.0 / resolution), round(12.0 / resolution)
    x = (np.arange(shape[1]) + 0.5) * resolution
    y = (np.arange(shape[0]) + 0.5) * resolution
    profile = bridge_height(x, deck)
    (x0, x1), (y0, y1) = BRIDGE
    on_bridge = (y > y0) & (y < y1)
    is_over = (x > x0) & (x < x1)
    ground = np.zeros(shape)
    ground[on_bridge] = np.where(is_over, 0.0, profile)
    cells = np.argwhere(on_bridge[:, None] & is_over)
    top = round(100 * deck)
    upper = UpperSurfaces.of(cells, [top] * len(cells), [top - round(100 * thickness)] * len(cells))
    return replace(HeightMap.from_metres(ground, resolution=resolution), upper=upper)


def bridge_height(x: np.ndarray, deck: float = 2.0) -> np.ndarray:
    """z [m] of the bridge and its ramps at x."""
    return np.interp(x, [0.0, 1.0, 5.0, 7.0, 11.0, 12.0], [0.0, 0.0, deck, deck, 0.0, 0.0])
