# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps whose places in one another are known (`map_registration`) become one map.

Where several maps know a cell and agree, their evidence adds up: probabilities by Bayes' rule, and
the height of the ground is the mean, weighted by its returns; of what stands there the highest one
counts, as in equation (3) of the paper. Where they differ, what stands in one of them stands: the
higher one counts, if it is believed as much, and if it is more than the edge of what the map before
has in the cell beside. Heights of a turned map are those of the cell that lies there, so that no
holes open; walls and ground of the localization layers are put where their returns were.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros import memory, se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import (
    HEIGHT_LIMIT,
    HEIGHT_RESOLUTION,
    PROBABILITY_SCALE,
    SUSPECTED,
    Area,
    Geometry,
    HeightMap,
)
from heightmap25d_ros.grid.levels import UpperSurfaces
from heightmap25d_ros.localization.layers import LayerMap
from heightmap25d_ros.params.sections import MapperParams, Params
from heightmap25d_ros.slam.map_registration import (
    MapRegistration,
    Outcome,
    RegisteredMap,
    register_maps,
)
from heightmap25d_ros.slam.submaps import SubmapCells, cells_of, joined_layers

_MOST_TOLD = 4  # places of an ambiguous map
_TOUCHING = 1e-6  # [cells] by which maps on the same cells may be off
_BYTES_OF_CELL = 160  # layers and heights of the merged map, and what is between


@dataclass(frozen=True, eq=False, kw_only=True)
class Merged:
    """One map made of several.

    Attributes
    ----------
    height_map : HeightMap
        With the cells of the first one, continued.
    layers : LayerMap or None
        None if one of the maps has none.
    known_by : (rows, columns) uint8
        How many maps know a cell.
    differs : (rows, columns) bool
        Where their heights are more than ``mapper.height_tolerance`` apart.
    walls : tuple of (rows, columns) bool
        What stands in each map, as localization knows it.
    """

    height_map: HeightMap
    layers: LayerMap | None
    known_by: NDArray[np.uint8]
    differs: NDArray[np.bool_]
    walls: tuple[NDArray[np.bool_], ...]


class _Evidence:
    """The cells of a map, seen from the first cell of the merged one, see `RigidCells`."""

    def __init__(self, source: HeightMap, layers: LayerMap, T_map_source: se3.Matrix) -> None:
        self.T_map_submap = _from_corner(T_map_source, source.geometry)
        self.level = source.geometry.ground_zero
        self._cells = cells_of(source, layers)

    def cells(self) -> SubmapCells:
        """The cells."""
        return self._cells


def register_all(
    maps: Sequence[RegisteredMap], names: Sequence[str], params: Params
) -> list[MapRegistration]:
    """Where each map lies in the first one; one that fits nowhere waits for what others show.

    Parameters
    ----------
    maps : sequence of RegisteredMap
    names : sequence of str
        Of the maps, for the error.
    params : Params

    Raises
    ------
    InputError
        If one of them fits nowhere, or in several places.
    """
    found = {0: MapRegistration(outcome=Outcome.REGISTERED, T_fixed_moving=np.eye(4))}
    whole = maps[0]
    while len(found) < len(maps):
        refused: dict[int, MapRegistration] = {}
        for number in (n for n in range(len(maps)) if n not in found):
            result = register_maps(whole, maps[number], params)
            if result.outcome is Outcome.REGISTERED:
                found[number] = result
                placed = sorted(found)
                poses = [found[n].T_fixed_moving for n in placed]
                merged = merge_maps([maps[n] for n in placed], poses, params)
                whole = RegisteredMap(merged.height_map, merged.layers, params)
                break
            refused[number] = result
        else:
            number, result = next(iter(refused.items()))
            others = ", ".join(names[n] for n in sorted(found))
            raise InputError(f"{names[number]}: not merged with {others}: {_told(result)}")
    return [found[number] for number in range(len(maps))]


def _told(refused: MapRegistration) -> str:
    """Why a map was not registered."""
    if refused.outcome is Outcome.NO_PLACE:
        return f"{refused.outcome.value}, overlap with walls or steps is needed"
    places = [se3.to_xyz_rpy(T) for T in (refused.T_fixed_moving, *refused.rivals)]
    told = "; ".join(
        f"x {p[0]:.1f} m, y {p[1]:.1f} m, yaw {p[5]:.2f} rad" for p in places[:_MOST_TOLD]
    )
    return f"{refused.outcome.value}: {told}{'; ...' if len(places) > _MOST_TOLD else ''}"


def merge_maps(
    maps: Sequence[RegisteredMap], poses: Sequence[se3.Matrix], params: Params
) -> Merged:
    """Merge maps of one resolution, at poses (4, 4) in the first one.

    Raises
    ------
    InputError
        If the memory is not available.
    """
    geometry = _hull([m.height_map.geometry for m in maps], poses)
    memory.require(geometry.shape[0] * geometry.shape[1] * _BYTES_OF_CELL, "the merged map")
    whole: HeightMap | None = None
    weight = np.zeros(geometry.shape)
    walls = []
    known_by = np.zeros(geometry.shape, np.uint8)
    differs = np.zeros(geometry.shape, bool)
    for source, pose in zip(maps, poses, strict=True):
        placed, index = _placed(source.height_map, pose, geometry)
        returns = np.where(index >= 0, source.ground_returns.ravel()[index], 0.0)
        stands = np.where(index >= 0, source.surface.is_edge.ravel()[index], False)
        known_by += placed.known
        walls.append(np.where(index >= 0, source.landmarks.is_wall.ravel()[index], False))
        if whole is None:
            whole = placed
        else:
            whole, apart = _combined(whole, placed, (weight, returns, stands), params.mapper)
            differs |= apart
        weight += np.where(stands, 0.0, returns)
    assert whole is not None
    has_layers = all(source.layers is not None for source in maps)
    return Merged(
        height_map=whole, known_by=known_by, differs=differs, walls=tuple(walls),
        layers=_layers(maps, poses, geometry) if has_layers else None,
    )  # fmt: skip


def _layers(
    maps: Sequence[RegisteredMap], poses: Sequence[se3.Matrix], geometry: Geometry
) -> LayerMap:
    """The layers of all maps, those above decks by themselves."""
    to_corner = se3.inverse(_from_corner(np.eye(4), geometry))
    found: list[LayerMap] = []
    while True:
        evidence = [
            _Evidence(m.height_map, of_level, to_corner @ pose)
            for m, pose in zip(maps, poses, strict=True)
            for of_level in _levels_of(m)[len(found) : len(found) + 1]
        ]
        if not evidence:
            return replace(found[0], above=tuple(found[1:]))
        found.append(joined_layers(evidence, geometry))


def _levels_of(source: RegisteredMap) -> tuple[LayerMap, ...]:
    return () if source.layers is None else (source.layers, *source.layers.above)


def _from_corner(T: se3.Matrix, geometry: Geometry) -> se3.Matrix:
    """A pose (4, 4) of a map as that of its first corner."""
    return np.asarray(T @ se3.from_xyz_rpy([*geometry.origin, 0.0, 0.0, 0.0, 0.0]))


def _hull(geometries: Sequence[Geometry], poses: Sequence[se3.Matrix]) -> Geometry:
    """The cells of the first map, continued to where all of them lie."""
    first = geometries[0]
    area = Area(0, 0, *first.shape)
    for geometry, pose in zip(geometries[1:], poses[1:], strict=True):
        rows, columns = geometry.shape
        corners = geometry.cell_corner([(0, 0), (0, columns), (rows, 0), (rows, columns)])
        cells = (corners @ pose[:2, :2].T + pose[:2, 3] - first.origin) / first.resolution
        low = np.floor(cells.min(axis=0) + _TOUCHING)[::-1]
        high = np.ceil(cells.max(axis=0) - _TOUCHING)[::-1]
        area = area.hull(Area(*(int(n) for n in low), *(int(n) for n in high - low)))
    return first.part(area)


def _placed(
    source: HeightMap, T_map_source: se3.Matrix, geometry: Geometry
) -> tuple[HeightMap, NDArray[np.int64]]:
    """A map in other cells, each that of the source under its centre, and the flat index of it.

    The index (rows, columns) is -1 where there is none.
    """
    T_source_map = se3.inverse(T_map_source)
    centres = geometry.cell_center(np.moveaxis(np.indices(geometry.shape), 0, -1))
    cell = source.geometry.cell_at(centres @ T_source_map[:2, :2].T + T_source_map[:2, 3])
    columns = source.geometry.shape[1]
    inside = source.geometry.contains(cell)
    index = np.where(inside, cell[..., 0] * columns + cell[..., 1], -1)
    lift = source.geometry.ground_zero + float(T_map_source[2, 3]) - geometry.ground_zero
    lifted = source.height.ravel()[index] + round(lift / HEIGHT_RESOLUTION)
    fits = inside & (np.abs(lifted) <= HEIGHT_LIMIT)
    is_suspected = inside & source.suspected.ravel()[index]
    height = np.where(fits, lifted, 0).astype(np.int16)
    height[is_suspected] = SUSPECTED
    probability = np.where(fits, source.probability.ravel()[index], 0).astype(np.uint16)
    return HeightMap(
        geometry=geometry, height=height, probability=probability,
        probability_threshold=source.probability_threshold,
        upper=source.upper.at(index, columns, round(lift / HEIGHT_RESOLUTION)),
        is_level=source.is_level,
    ), index  # fmt: skip


def _combined(
    first: HeightMap,
    second: HeightMap,
    evidence: tuple[Array, Array, NDArray[np.bool_]],
    params: MapperParams,
) -> tuple[HeightMap, NDArray[np.bool_]]:
    """Two maps of the same cells as one, and where (rows, columns) they differ.

    Parameters
    ----------
    first, second : HeightMap
    evidence : (rows, columns) each
        Returns of the ground in the first map, in the second one, and whether something stands in
        a cell of the second one.
    params : MapperParams
    """
    before, returns, stands = evidence
    both = first.known & second.known
    difference = second.height.astype(np.int32) - first.height
    tolerance = round(params.height_tolerance / HEIGHT_RESOLUTION)
    agrees = both & (np.abs(difference) <= tolerance)
    share = np.where(before + returns > 0, returns / np.maximum(before + returns, 1e-9), 0.5)
    mean = first.height + np.rint(share * difference)
    highest = np.maximum(first.height, second.height)
    height = np.where(stands | (before <= 0.0), highest, mean)
    odds = _log_odds(first.probability) + _log_odds(second.probability)
    limits = params.probability_min, params.probability_max
    joint = np.clip(1.0 / (1.0 + np.exp(-odds)), *limits) * PROBABILITY_SCALE
    is_second = second.probability > first.probability
    # What stands in the cell beside, to which its edge was rounded, is already there.
    known_heights = np.where(first.known, first.height, np.int16(-HEIGHT_LIMIT))
    around = ndimage.maximum_filter(known_heights, 3, mode="nearest")
    is_new = second.height > around.astype(np.int32) + tolerance
    is_second = np.where(both, is_new & (second.probability >= first.probability), is_second)
    height = np.where(agrees, height, np.where(is_second, second.height, first.height))
    probability = np.where(agrees, joint, np.maximum(first.probability, second.probability))
    merged = replace(
        first, height=height.astype(np.int16), probability=np.rint(probability).astype(np.uint16),
        upper=_with_upper(first, second), is_level=first.is_level and second.is_level,
    )  # fmt: skip
    suspected = (first.suspected | second.suspected) & ~merged.known
    merged.height[suspected] = SUSPECTED
    merged.probability[suspected] = 0
    return merged, both & ~agrees


def _with_upper(first: HeightMap, second: HeightMap) -> UpperSurfaces:
    """Surfaces of the first map, and those of the second one where it has none."""
    has_some = np.zeros(first.geometry.shape, bool)
    has_some[tuple(first.upper.cell.T)] = True
    return first.upper.with_others(second.upper.where(~has_some[tuple(second.upper.cell.T)]))


def _log_odds(stored: NDArray[np.uint16]) -> Array:
    """Of stored probabilities, kept off 0 and 1."""
    believed = np.clip(stored / PROBABILITY_SCALE, 1e-3, 1.0 - 1e-3)
    return np.asarray(np.log(believed / (1.0 - believed)))
