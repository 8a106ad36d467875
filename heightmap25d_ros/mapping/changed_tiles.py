# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bounds of observed or changed tiles, as kernels extend them."""

from __future__ import annotations

from heightmap25d_ros.kernels import inlined_kernel


@inlined_kernel
def include(ty, tx, bounds):
    """Extend bounds, as of `HeightGrid.observed`, by a tile."""
    bounds[0], bounds[1] = min(bounds[0], ty), min(bounds[1], tx)
    bounds[2], bounds[3] = max(bounds[2], ty), max(bounds[3], tx)
    bounds[4] += 1
