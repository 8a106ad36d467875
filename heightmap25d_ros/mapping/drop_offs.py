# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drop-offs that are suspected in the shadow of an edge, before anybody has seen them.

A beam that passes over an edge and ends beyond it proves that the ground in between lies below it.
Where it is soon lower than the edge by ``max_step`` or more, there may be a drop-off; there must be
one where no ground fits below it that the robot can drive on, no slope of ``max_slope`` either.

A beam that ends nowhere proves nothing: the ground is missing, or swallows light as water does. It
tells of what may be a drop-off, where its neighbours do as well (`sensor_model.voids`).

The mark stands in place of the height of a cell that is unknown (`SUSPECTED`), so that it goes
wherever heights go, and is gone with the first return from the cell. It takes two beams: until the
second one the cell has the height 0, as any unknown one.
"""

from __future__ import annotations

import math

import numpy as np

from heightmap25d_ros.grid.height_grid import TILE, HeightGrid, TiledArray
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, SUSPECTED, stored_probability
from heightmap25d_ros.kernels import inlined_kernel, kernel
from heightmap25d_ros.mapping.changed_tiles import include
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import TraversabilityParams

_STRIDE = 0.25  # [cells] between the places of a beam that are looked at
_LONGEST_SHADOW = 6.0  # [m] between an edge and where a beam ends
_REACH = 2.0  # [m] beyond an edge that are judged by it
_SOON = 0.625  # [m] the same of what may be a drop-off: farther on it mostly is a gentle slope
_MARGIN = 1.0  # [cm] of noise that a drop exceeds its limit by
_LEAST_SLOPE = 0.1  # of beams that tell of what may be a drop-off
_BELOW = 1.0  # [m] that a beam without return is followed beyond the ground that it missed


class DropOffs:
    """Marks suspected drop-offs in the unknown cells of a grid.

    Parameters
    ----------
    grid : HeightGrid
    params : TraversabilityParams
        ``drop_offs`` says whether a drop-off must be there: whether a slope that the robot could
        drive down, and ground that returns nothing, are no drop-offs.
    probability_threshold : float
        Cells below it are unknown.
    """

    def __init__(
        self, grid: HeightGrid, params: TraversabilityParams, probability_threshold: float
    ) -> None:
        is_certain = params.drop_offs == "must"
        self._extension = 0.0 if is_certain else _BELOW
        resolution = grid.geometry.resolution
        steepest = math.tan(params.max_slope) if is_certain else 0.0
        told_once = TiledArray(grid.tile_top.shape, np.bool_)
        self._constants = (
            (*grid.geometry.origin, grid.geometry.ground_zero),
            resolution,
            *(array.cells for array in (grid.height, grid.probability, told_once)),
            grid.tile_changed,
            grid.changed,
            (
                params.max_step / HEIGHT_RESOLUTION + 1e-6,
                steepest * resolution / HEIGHT_RESOLUTION,
                max(steepest, _LEAST_SLOPE),
                stored_probability(probability_threshold),
                (_REACH if is_certain else _SOON) / resolution,
                _LONGEST_SHADOW / resolution,
            ),
        )

    def integrate(self, beams: Beams) -> None:
        """Mark what beams tell of that were integrated into the grid before."""
        is_void = beams.is_lone if beams.is_void is None else beams.is_void
        extension = 0.0 if beams.is_void is None else self._extension
        _integrate(
            beams.origins, beams.ends, beams.is_hit, beams.is_lone, is_void, extension,
            *self._constants,
        )  # fmt: skip


@kernel
def _integrate(  # noqa: PLR0913
    origins, ends, is_hit, is_lone, is_void, extension, corner, resolution,
    heights, probabilities, told_once, tile_changed, changed, limits,
):  # fmt: skip
    """Mark cells [tile y, tile x, y, x]; void beams are longer by an extension [m]."""
    least_slope = limits[2]
    rows, columns = heights.shape[0] * TILE, heights.shape[1] * TILE
    for i in range(len(ends)):
        if is_lone[i]:
            continue
        x, y = (origins[i, 0] - corner[0]) / resolution, (origins[i, 1] - corner[1]) / resolution
        end = _end(origins, ends, i, extension if is_void[i] else 0.0)
        along_x, along_y = end[0] - origins[i, 0], end[1] - origins[i, 1]
        length = np.hypot(along_x, along_y) / resolution  # [cells]
        fall = (origins[i, 2] - end[2]) / resolution
        if fall <= least_slope * length or length < 2.0:
            continue
        end_x, end_y = x + along_x / resolution, y + along_y / resolution
        if not (_is_inside(x, y, rows, columns) and _is_inside(end_x, end_y, rows, columns)):
            continue
        beam = (
            x, y, (origins[i, 2] - corner[2]) / HEIGHT_RESOLUTION,
            along_x / resolution / length, along_y / resolution / length,
            -fall * resolution / HEIGHT_RESOLUTION / length,
        )  # fmt: skip
        edge = _edge(beam, length - (1.0 if is_hit[i] else 0.0), heights, probabilities, limits)
        if edge <= 0.0 or not _is_ground(beam, edge, heights, probabilities, limits):
            continue
        proof = _proof(beam, edge, length, heights, limits)
        at = edge + _STRIDE
        while at <= proof:
            cell = _cell(beam, at)
            if probabilities[cell] >= limits[3] or heights[cell] == SUSPECTED:
                at += _STRIDE
                continue
            # What was told before the cell had a height counts no more.
            is_told = told_once[cell] and probabilities[cell] == 0
            heights[cell] = SUSPECTED if is_told else 0
            told_once[cell] = True
            probabilities[cell] = 0  # of a height that it had, and that was doubted
            if tile_changed[cell[0], cell[1]] == 0:
                tile_changed[cell[0], cell[1]] = 1
                include(cell[0], cell[1], changed)
            while at <= proof and _cell(beam, at) == cell:  # told of once by each beam
                at += _STRIDE


@inlined_kernel
def _end(origins, ends, i, extension):
    """Where a beam ends that is longer by a horizontal distance [m]."""
    x, y, z = ends[i]
    along_x, along_y, along_z = x - origins[i, 0], y - origins[i, 1], z - origins[i, 2]
    length = np.hypot(along_x, along_y)
    share = extension / max(length, 1e-9) if length > 0.0 else 0.0
    return x + share * along_x, y + share * along_y, z + share * along_z


@inlined_kernel
def _is_inside(x, y, rows, columns):
    return 0.0 <= x < columns and 0.0 <= y < rows


@inlined_kernel
def _cell(beam, at):
    """Index of the cell over which a beam is at a distance [cells] from its origin."""
    ix, iy = int(beam[0] + at * beam[3]), int(beam[1] + at * beam[4])
    return iy // TILE, ix // TILE, iy % TILE, ix % TILE


@inlined_kernel
def _edge(beam, length, heights, probabilities, limits):
    """Distance [cells] of the known ground before the shadow in which a beam ends; 0: none."""
    at, first = length, max(length - limits[5], 0.0)
    while at > first:
        cell = _cell(beam, at)
        if probabilities[cell] >= limits[3]:
            is_over = heights[cell] <= beam[2] + at * beam[5]
            is_shadow = length - at >= 1.0
            return at if is_over and is_shadow else 0.0
        at -= _STRIDE
    return 0.0


@inlined_kernel
def _is_ground(beam, edge, heights, probabilities, limits):
    """Whether no step leads up to an edge from where the sensor is: it is no box, no wall."""
    before = np.float64(heights[_cell(beam, edge)])
    at = edge - _STRIDE
    while at >= 0.0:
        cell = _cell(beam, at)
        if probabilities[cell] >= limits[3]:
            if abs(heights[cell] - before) > limits[0]:
                return False
            before = np.float64(heights[cell])
        at -= _STRIDE
    return True


@inlined_kernel
def _proof(beam, edge, length, heights, limits):
    """Distance [cells] at which a beam is too far below an edge for any ground; 0: nowhere."""
    max_step, steepest, reach = limits[0], limits[1], limits[4]
    rim = np.float64(heights[_cell(beam, edge)])
    at = edge + _STRIDE
    while at <= min(length, edge + reach):
        drop = rim - (beam[2] + at * beam[5])
        if drop > max(max_step, steepest * (at - edge)) + _MARGIN:
            return at
        at += _STRIDE
    return 0.0
