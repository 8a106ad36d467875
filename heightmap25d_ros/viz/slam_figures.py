# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map without known poses: the drive, how well it is known, and the loops that were closed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.viz import map_figures, palette

_SIGMAS = 3.0
_ELLIPSES = 24  # along the drive
_LOOP: dict[str, Any] = {"color": "tab:red", "linewidth": 1.6, "marker": "o", "markersize": 5}
_COVARIANCE: dict[str, Any] = {"facecolor": "none", "edgecolor": "black", "linewidth": 0.9}


def drive(
    path: Path,
    shown: HeightMap,
    positions: Array,
    covariances: Array,
    loops: Sequence[tuple[Array, Array]],
) -> None:
    """Draw a drive over its map.

    Parameters
    ----------
    path : Path
    shown : HeightMap
    positions : (N, 3) float64 [m]
    covariances : (N, 3, 3) float64
        Of x, y, yaw, seen from the first pose.
    loops : sequence of ((2,), (2,)) float64 [m]
        Where the submaps begin that were joined.
    """
    figure, axes = map_figures.heights_from_above(shown)
    axes.plot(positions[:, 0], positions[:, 1], **palette.CORRECTED_LINE | {"label": "drive"})
    for chosen in np.unique(np.linspace(0, len(positions) - 1, _ELLIPSES).astype(int)):
        sizes, directions = np.linalg.eigh(covariances[chosen][:2, :2])
        sides = 2.0 * _SIGMAS * np.sqrt(np.maximum(sizes, 0.0))
        angle = float(np.degrees(np.arctan2(directions[1, 1], directions[0, 1])))
        place = float(positions[chosen, 0]), float(positions[chosen, 1])
        axes.add_patch(Ellipse(place, float(sides[1]), float(sides[0]), angle=angle, **_COVARIANCE))
    for first, second in loops:
        axes.plot(*zip(first, second, strict=True), **_LOOP, label="_loop")
    entries = [
        palette.unknown_entry(), axes.lines[0],
        Line2D([], [], color="black", linewidth=0.9, label="three standard deviations"),
        Line2D([], [], label=f"{len(loops)} loops closed", **_LOOP),
    ]  # fmt: skip
    palette.legend_above(axes, entries)
    map_figures.save(figure, path)
