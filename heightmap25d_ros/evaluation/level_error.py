# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Error of a map with several levels against the true levels of its world.

A true level holds one height per cell, as a robot on that level has it around itself. Of the map,
the surface of a cell that is nearest to it counts. What hangs the clear height or more above it is
not of that level: a robot on it passes below.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.evaluation.map_error import (
    LARGE_ERROR,
    Detection,
    detection,
    on_cells_of,
    open_detection,
)
from heightmap25d_ros.evaluation.truth import LevelTruth
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, Geometry, HeightMap
from heightmap25d_ros.params.sections import LevelsParams, TraversabilityParams
from heightmap25d_ros.terrain.slices import SurfaceStack
from heightmap25d_ros.terrain.traversability import blocked_transitions


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelError:
    """The figures of one level.

    Attributes
    ----------
    cells : int
        Cells with another level, in which a noise-free laser measured the top of this one: it is
        within `LARGE_ERROR` of the highest reading. Where that is of the side of a wall below a
        deck, nobody has seen a top.
    tops_right : float or None
        Share of them in which a surface of the map is within `LARGE_ERROR` of it.
    blocked_transitions, open_transitions : Detection
        Over the whole level, on the map's surfaces nearest to it. Open ones without tolerance.
    """

    cells: int
    tops_right: float | None
    blocked_transitions: Detection
    open_transitions: Detection


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelErrors:
    """The figures of a map with two levels.

    Attributes
    ----------
    lower, upper : LevelError
    cells : int
        Cells in which the tops of both levels were measured.
    both_tops_right : float or None
        Share of them in which the map holds both within `LARGE_ERROR`.
    """

    lower: LevelError
    upper: LevelError
    cells: int
    both_tops_right: float | None

    def as_dict(self) -> dict[str, Any]:
        """The figures by name, nested; shares rounded to four digits."""
        return {name: _rounded(value) for name, value in asdict(self).items()}


def evaluate_levels(
    height_map: HeightMap, levels: LevelsParams, terrain: TraversabilityParams, truth: LevelTruth
) -> LevelErrors:
    """Compare a map with the true levels of its world.

    Raises
    ------
    InputError
        If the cells of the map do not coincide with those of the truth.
    """
    stack = SurfaceStack(height_map, levels, terrain)
    nearest = [_nearest(stack, truth.geometry, top, levels.clear_height) for top in truth.top]
    is_double = truth.top[0] != truth.top[1]
    seen = (np.abs(truth.seen - truth.top) <= LARGE_ERROR) & is_double
    right = [
        known & (np.abs(height * HEIGHT_RESOLUTION + height_map.geometry.ground_zero - top)
                 <= LARGE_ERROR)
        for (height, known), top in zip(nearest, truth.seen, strict=True)
    ]  # fmt: skip
    max_step_cm = int(terrain.max_step / HEIGHT_RESOLUTION + 1e-6)
    errors = []
    for number, (height, known) in enumerate(nearest):
        mask, top = blocked_transitions(height, known, max_step_cm), truth.top[number]
        errors.append(
            LevelError(
                cells=int(seen[number].sum()),
                tops_right=_share(right[number], seen[number]),
                blocked_transitions=detection(mask, top, known, terrain.max_step),
                open_transitions=open_detection(mask, top, known, terrain.max_step),
            )
        )
    both = seen[0] & seen[1]
    return LevelErrors(
        lower=errors[0],
        upper=errors[1],
        cells=int(both.sum()),
        both_tops_right=_share(right[0] & right[1], both),
    )


def _nearest(
    stack: SurfaceStack, geometry: Geometry, tops: NDArray[np.float64], clear_height: float
) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
    """Heights [cm] of the map's surfaces nearest to true tops, and where there are any."""
    best = np.zeros(tops.shape, np.int16)
    least = np.full(tops.shape, np.inf)
    for number, layer in enumerate(stack.layers()):
        height, known = on_cells_of(geometry, layer)
        above = height * HEIGHT_RESOLUTION + layer.geometry.ground_zero - tops
        is_overhead = (above >= clear_height) & (number > 0)
        off = np.where(known & ~is_overhead, np.nan_to_num(np.abs(above), nan=1e6), np.inf)
        best[off < least] = height[off < least]
        least = np.minimum(least, off)
    return best, np.isfinite(least)


def _share(part: NDArray[np.bool_], whole: NDArray[np.bool_]) -> float | None:
    return float((part & whole).sum() / whole.sum()) if whole.any() else None


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _rounded(entry) for name, entry in value.items()}
    return round(value, 4) if isinstance(value, float) else value
