# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of any size to plan over."""

from __future__ import annotations

import numpy as np

from heightmap25d_ros.grid.height_map import Geometry, HeightMap


def rolling_terrain(side: int) -> HeightMap:
    """Hills and walls with noise of 1 cm, one cell in twenty unknown."""
    rng = np.random.default_rng(25)
    y, x = np.indices((side, side), np.float32)
    height = 60.0 * np.sin(x / 70.0) * np.cos(y / 90.0) + rng.normal(0.0, 1.0, x.shape)
    height += 200.0 * ((x % 160 < 2) & (y % 100 < 70))
    return HeightMap(
        geometry=Geometry(resolution=0.125, origin=(0.0, 0.0), shape=(side, side)),
        height=height.astype(np.int16),
        probability=np.where(rng.random(x.shape) < 0.95, 60000, 1500).astype(np.uint16),
        probability_threshold=0.5,
    )
