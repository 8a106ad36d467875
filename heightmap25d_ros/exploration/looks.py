# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Looks in vain: how often each cell was looked for and not seen.

Scanners look ahead and down: a look in vain for ground that is higher than the sensor, as the upper
part of a ramp is from its foot, tells little.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.exploration import sight
from heightmap25d_ros.exploration.survey import LEVEL, NEAR_LOOK, Survey
from heightmap25d_ros.grid.height_map import Geometry

RISE = 0.4
"""So much higher than the ground before it unknown ground may be [m]."""

_BESIDE = 2.0
"""So far from what is wanted there is known ground [m]."""


class Looks:
    """Looks in vain, for the cells of a map that grows."""

    def __init__(self) -> None:
        self._count = np.zeros((0, 0), np.int16)
        self._height = np.zeros((0, 0), np.float32)  # [m] of the cells then
        self._is_from_below = np.zeros((0, 0), np.bool_)  # all of the looks
        self._is_from_afar = np.zeros((0, 0), np.bool_)  # likewise
        self._geometry: Geometry | None = None

    def forget(self) -> None:
        """The map was begun anew."""
        self._geometry = None

    def note(self, survey: Survey) -> None:
        """The robot has turned around where it is: what should have been seen was looked for."""
        cell = survey.cell_of(survey.robot)
        if not survey.geometry.contains(cell):
            return
        for one in survey.around(survey.robot):
            height = one.scenery.height
            before = self.of(survey.geometry, height if survey.others else None)
            missed = np.argwhere(sight.seen_from(one.scenery, cell))
            if not len(missed):
                continue
            at = tuple(missed.T)
            away = np.hypot(*(missed - cell).T) * survey.geometry.resolution
            is_first = before[at] == 0
            self._count[at] = before[at] + np.where(away < NEAR_LOOK, 2, 1).astype(np.int16)
            self._height[at] = height[at]
            eye = height[cell] + one.scenery.sensor_height
            is_near = one.scenery.reach * survey.geometry.resolution <= NEAR_LOOK
            is_excused = (_ground_before(one, missed) > eye - RISE) & (not is_near)
            self._is_from_below[at] = is_excused & (is_first | self._is_from_below[at])
            self._is_from_afar[at] = (away >= NEAR_LOOK) & (is_first | self._is_from_afar[at])

    def from_below(self, geometry: Geometry) -> NDArray[np.bool_]:
        """(rows, columns): what was looked for in vain only from below.

        And only from afar: it is looked for from near once more.
        """
        self.of(geometry)
        return self._is_from_below

    def from_afar(self, geometry: Geometry) -> NDArray[np.bool_]:
        """(rows, columns): what was looked for in vain only from afar."""
        self.of(geometry)
        return self._is_from_afar

    def of(
        self, geometry: Geometry, height: NDArray[np.float32] | None = None
    ) -> NDArray[np.int16]:
        """(rows, columns): how often each cell was looked for in vain.

        Parameters
        ----------
        geometry : Geometry
            Of the cells.
        height : (rows, columns) float32 [m], optional
            Looks at other heights than these do not count.
        """
        if self._geometry != geometry:
            self._count, self._height, self._is_from_below, self._is_from_afar = (
                _moved(kept, self._geometry, geometry)
                for kept in (self._count, self._height, self._is_from_below, self._is_from_afar)
            )
            self._geometry = replace(geometry)
        if height is None:
            return self._count
        return np.where(np.abs(self._height - height) < LEVEL, self._count, np.int16(0))


def _ground_before(survey: Survey, cells: NDArray[np.int64]) -> NDArray[np.float32]:
    """(N,) [m]: the height of the known ground that is nearest to unknown cells (N, 2)."""
    margin = math.ceil(_BESIDE / survey.geometry.resolution)
    first = np.maximum(cells.min(axis=0) - margin, 0)
    y, x = (slice(n, end + margin + 1) for n, end in zip(first, cells.max(axis=0), strict=True))
    is_ground = (survey.scenery.known & ~survey.occupied)[y, x]
    nearest = ndimage.distance_transform_edt(
        ~is_ground, return_distances=False, return_indices=True
    )
    return np.asarray(survey.scenery.height[y, x][tuple(nearest)][tuple((cells - first).T)])


def _moved(kept: NDArray[Any], before: Geometry | None, geometry: Geometry) -> NDArray[Any]:
    """An array of the cells of one geometry for those of another one; zeros elsewhere."""
    result = np.zeros(geometry.shape, kept.dtype)
    if before is not None and before.resolution == geometry.resolution:
        corner = np.array(before.origin) + 0.5 * before.resolution
        iy, ix = (int(n) for n in geometry.cell_at(corner))
        rows, columns = before.shape
        y = slice(max(iy, 0), max(min(iy + rows, geometry.shape[0]), 0))
        x = slice(max(ix, 0), max(min(ix + columns, geometry.shape[1]), 0))
        result[y, x] = kept[y.start - iy : y.stop - iy, x.start - ix : x.stop - ix]
    return result
