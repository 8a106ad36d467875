# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps that were merged: where they overlap, what stands in each, and where they differ."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from heightmap25d_ros.grid.height_map import Area
from heightmap25d_ros.slam.map_merge import Merged
from heightmap25d_ros.viz import map_figures, palette

_ONE, _SEVERAL, _COMMON = "#c8c8c8", "#ffffff", "#1b5e20"
_WALLS = "#1f77b4", "#ff7f0e", "#c020d0", "#8c564b", "#17becf", "#bcbd22"


def overlap(path: Path, merged: Merged, names: Sequence[str]) -> None:
    """Draw the known cells by the number of maps that know them, and what stands in each map.

    Parameters
    ----------
    path : Path
    merged : Merged
    names : sequence of str
        Of the maps.
    """
    shown = map_figures.observed_part(merged.height_map)
    geometry = shown.geometry
    iy, ix = (int(n) for n in merged.height_map.geometry.cell_at(geometry.cell_center((0, 0))))
    part = Area(iy, ix, *geometry.shape).slices(Area(0, 0, *merged.height_map.geometry.shape))
    figure, axes = map_figures.map_axes(geometry)
    axes.set_facecolor(palette.UNKNOWN)
    known_by = merged.known_by[part]
    layers = [
        (known_by == 1, _ONE, "known by one map"),
        (known_by > 1, _SEVERAL, "known by several maps"),
        (merged.differs[part], palette.OCCUPIED, "heights differ"),
    ]
    walls = [of_map[part] for of_map in merged.walls]
    for number, (name, of_map) in enumerate(zip(names, walls, strict=True)):
        layers.append((of_map, _WALLS[number % len(_WALLS)], f"stands in {name}"))
    layers.append((np.sum(walls, axis=0) > 1, _COMMON, "stands in several maps"))
    for cells, colour, _ in layers:
        map_figures.draw_cells(axes, geometry, cells, colour)
    entries = [palette.cell_entry(colour, label) for _, colour, label in layers]
    palette.legend_above(axes, [*entries, palette.unknown_entry()])
    map_figures.save(figure, path)
