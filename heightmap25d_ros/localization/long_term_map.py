# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The long-term map as localization uses it: of each level what scans and short-term maps meet.

A map with several levels is a few slices with one surface per cell (`terrain.slices`). What the
robot sees depends on the level that it is on, and so the pose decides, by its z, which slice it is
held to. Each hypothesis has a z of its own, and with it its level.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, Geometry, HeightMap
from heightmap25d_ros.localization.landmarks import Landmarks, landmarks_of
from heightmap25d_ros.localization.layers import NAMES, LayerMap
from heightmap25d_ros.localization.surface import Surface, surface_of
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.terrain.slices import Slice, SurfaceStack
from heightmap25d_ros.terrain.steps import UNOBSERVED

_NEAR = 0.3  # [m] around a pose in which its surface is looked for
_Z_WEIGHT = 3.0  # of a metre of height beside one of distance, for that
_AS_NEAR = 0.3  # [m] by which slices may differ in that, and hold the same surface
_SAME_HEIGHT = 0.3  # [m] of the mean of returns from a surface's top
_LEAST_RETURNS = 2  # of a cell, for landmarks
_SURROUNDINGS = 5  # [cells] side, whose lowest surface is the ground beside what stands


class MapLevel(NamedTuple):
    """What a robot on one level is held to."""

    surface: Surface
    landmarks: Landmarks | None


class OneLevelMaps(NamedTuple):
    """The levels of a map, each with one surface per cell.

    Attributes
    ----------
    maps : list of (HeightMap, LayerMap or None)
        All of the same cells.
    away_from_seam : (levels, rows, columns) float32 [m] or None
        How far each cell is from where its level is not followed farther; None for a single level.
    """

    maps: list[tuple[HeightMap, LayerMap | None]]
    away_from_seam: NDArray[np.float32] | None

    @classmethod
    def of(cls, height_map: HeightMap, layers: LayerMap | None, params: Params) -> OneLevelMaps:
        """Of a height map, and of its localization layers where there are any."""
        slices: list[Slice] = []
        if len(height_map.upper):
            stack = SurfaceStack(height_map, params.levels, params.traversability)
            slices = stack.slices(stack.footprint_cells)
        if len(slices) < 2:
            return cls([(height_map, layers)], None)
        max_step = int(params.traversability.max_step / HEIGHT_RESOLUTION + 1e-6)
        return cls(
            [
                (s.height_map, None if layers is None else _layers_of(s, stack, layers))
                for s in slices
            ],
            np.stack([_away_from_seam(s, stack, max_step) for s in slices]),
        )


class LongTermMap:
    """The levels of a long-term map.

    Parameters
    ----------
    levels : sequence of MapLevel
        One at least, all of the same cells; with or without landmarks all of them.
    away_from_seam : (levels, rows, columns) float32 [m], optional
        How far each cell is from where its level is not followed farther; needed for several.

    Attributes
    ----------
    levels : tuple of MapLevel

    Examples
    --------
    >>> flat = LongTermMap.of(HeightMap.from_metres(np.zeros((8, 8))), None, Params())
    >>> len(flat.levels)
    1
    >>> flat.ground_z(0.5, 0.5, 0.3)
    0.0
    """

    def __init__(
        self, levels: Sequence[MapLevel], away_from_seam: NDArray[np.float32] | None = None
    ) -> None:
        self.levels = tuple(levels)
        self._away_from_seam = away_from_seam

    @classmethod
    def of(cls, height_map: HeightMap, layers: LayerMap | None, params: Params) -> LongTermMap:
        """Of a height map, and of its localization layers where there are any.

        Raises
        ------
        InputError
            If the memory is not available.
        """
        return cls.of_levels(OneLevelMaps.of(height_map, layers, params), params)

    @classmethod
    def of_levels(cls, levels: OneLevelMaps, params: Params) -> LongTermMap:
        """Of the levels of a map."""
        edge_step = params.registration.edge_step
        return cls(
            [
                MapLevel(
                    surface_of(height_map, edge_step),
                    None if layers is None else landmarks_of(height_map, layers),
                )
                for height_map, layers in levels.maps
            ],
            levels.away_from_seam,
        )

    @property
    def has_landmarks(self) -> bool:
        """Whether scans can be tracked."""
        return self.levels[0].landmarks is not None

    def at(self, T_map_base: se3.Matrix) -> MapLevel:
        """The level that a robot at a pose (4, 4) is on."""
        return self.levels[self.number_at(T_map_base)]

    def number_at(self, T_map_base: se3.Matrix) -> int:
        """Which level a robot at a pose (4, 4) is on; of several the one that reaches farther.

        Where the map knows nothing around the pose, any.
        """
        if len(self.levels) == 1:
            return 0
        x, y, z = T_map_base[:3, 3]
        cost = self._costs(float(x), float(y), float(z))
        is_candidate = cost <= cost.min() + _AS_NEAR
        assert self._away_from_seam is not None
        rows, columns = self._window(float(x), float(y), 0.0)
        away = self._away_from_seam[:, rows, columns].reshape(len(self.levels), -1)
        reach = away.max(axis=1, initial=-1.0)
        return int(np.where(is_candidate, reach, -np.inf).argmax())

    def ground_z(self, x: float, y: float, z: float) -> float:
        """Height [m] of the known surface that is nearest to a place; its z where none is near."""
        found = []
        for level in self.levels:
            around = level.surface.heights[self._window(x, y, _NEAR)]
            if not np.isnan(around).all():
                found.append(float(np.nanmedian(around)))
        return min(found, key=lambda height: abs(height - z), default=z)

    def _costs(self, x: float, y: float, z: float) -> NDArray[np.float64]:
        """(levels,) [m]: how far the nearest surface of each is from a place."""
        window = self._window(x, y, _NEAR)
        heights = np.stack([level.surface.heights[window] for level in self.levels])
        surface = self.levels[0].surface
        ys, xs = (
            (np.arange(part.start, part.stop) + 0.5) * surface.resolution + corner - at
            for part, corner, at in zip(window, surface.origin[::-1], (y, x), strict=True)
        )
        away = np.hypot(ys[:, None], xs) + _Z_WEIGHT * np.abs(heights - z)
        near = np.where(np.isnan(away), np.inf, away).reshape(len(self.levels), -1)
        return np.asarray(np.minimum(near.min(axis=1, initial=np.inf), 1e6), np.float64)

    def _window(self, x: float, y: float, reach: float) -> tuple[slice, slice]:
        """The cells around a place, as far as the map goes."""
        surface = self.levels[0].surface
        rows, columns = surface.heights.shape
        geometry = Geometry(
            resolution=surface.resolution, origin=surface.origin, shape=(rows, columns)
        )
        (low_y, low_x), (high_y, high_x) = geometry.cell_at(
            [(x - reach, y - reach), (x + reach, y + reach)]
        ).tolist()
        (first_y, last_y), (first_x, last_x) = (
            np.clip((low, high + 1), 0, count)
            for low, high, count in ((low_y, high_y, rows), (low_x, high_x, columns))
        )
        return slice(int(first_y), int(last_y)), slice(int(first_x), int(last_x))


def _layers_of(found: Slice, stack: SurfaceStack, layers: LayerMap) -> LayerMap:
    """The layers of a slice: in each cell those whose ground is nearest to that of the slice.

    Where another level alone is known there is nothing. Returns from a deck are averaged by
    themselves as soon as much of the deck is known. Where none are, its top counts as returns from
    anywhere in the cell, and those from what stands on it are among the lowest level's: where these
    are all on one line, the line is that of both.
    """
    levels = layers, *layers.above
    top = found.height_map.metres.astype(np.float32)
    ground = np.stack([
        np.where(level.ground_count > 0, level.ground_height, np.inf) for level in levels
    ])  # fmt: skip
    is_upper = found.layer > 0
    ground[0][is_upper] = np.inf
    lowest = ndimage.minimum_filter(np.where(np.isnan(top), np.inf, top), _SURROUNDINGS)
    with np.errstate(invalid="ignore"):
        to_top, to_lowest = np.abs(ground - top), np.abs(ground - lowest)
    off = np.where(to_top <= _SAME_HEIGHT, to_top - 1.0, to_lowest)
    which = np.where(np.isnan(off), np.inf, off).argmin(axis=0)
    is_own = ~is_upper | np.isfinite(ground).any(axis=0)
    is_none = (found.layer < 0) & (stack.top != UNOBSERVED).any(axis=0)
    arrays = {}
    for name in NAMES:
        of_levels = np.stack([getattr(level, name) for level in levels])
        chosen = np.take_along_axis(of_levels, which[None], axis=0)[0]
        arrays[name] = np.where(is_own & ~is_none, chosen, np.float32(0.0))
    is_top = ~is_own & ~is_none
    arrays["ground_count"][is_top] = _LEAST_RETURNS
    arrays["ground_height"][is_top] = top[is_top]
    anywhere = np.float32(_LEAST_RETURNS * layers.geometry.resolution**2 / 12)
    has_others = layers.elevated_count > 0
    for axis in "xy":
        elevated, spread = f"elevated_{axis}", f"spread_{axis}{axis}"
        at = np.where(has_others, getattr(layers, elevated), np.float32(0.0))
        arrays[elevated][is_top] = arrays[f"ground_{axis}"][is_top] = at[is_top]
        arrays[spread][is_top] = np.where(has_others, getattr(layers, spread), anywhere)[is_top]
    for name in ("elevated_count", "spread_xy"):
        arrays[name][is_top] = np.where(has_others, getattr(layers, name), np.float32(0.0))[is_top]
    return LayerMap(geometry=layers.geometry, above=(), **arrays)


def _away_from_seam(found: Slice, stack: SurfaceStack, max_step: int) -> NDArray[np.float32]:
    """(rows, columns) [m]: distance from where a surface goes on, and the slice does not with it.

    -1 where the slice has no surface.
    """
    index = np.maximum(found.layer, 0)[None].astype(np.int64)
    is_known = found.layer >= 0
    top = np.where(is_known, np.take_along_axis(stack.top, index, axis=0)[0], UNOBSERVED)
    is_seam = np.zeros(top.shape, bool)
    for axis in (0, 1):
        for step in (1, -1):
            beside = np.roll(stack.top, step, axis=1 + axis)
            is_followed = np.abs(np.roll(top, step, axis=axis) - top) <= max_step
            goes_on = (np.abs(beside - top) <= max_step).any(axis=0)
            is_seam |= is_known & goes_on & ~is_followed
    if not is_seam.any():
        return np.where(is_known, np.inf, -1.0).astype(np.float32)
    away = ndimage.distance_transform_edt(~is_seam) * stack.geometry.resolution
    return np.where(is_known, away, -1.0).astype(np.float32)
