# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One level of a map with several: a height map with one surface in each cell.

A *slice* is what a robot meets that drives from one place without passing over or under where it
has been. It is followed along the surface: from cell to cell it takes the highest surface below
which the robot would not fit, so that a wall stays a wall, a deck overhead is left out, and beside
the edge of a deck is the ground below. Where it comes over or under itself, the surface that is
nearer along the way counts; at this *seam* the slice shows a drop that is none.

All that knows one surface per cell works on a slice as it is: obstacles, planes, gaps, paths. Of
a map with several levels it takes a few slices to hold all surfaces. They overlap widely, since
each one extends along the ground until it meets itself, and where two hold the same surface of a
cell, a path may go from one to the other. A map of one level is its own slice.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.arrays import cells_of_mask
from heightmap25d_ros.grid.height_map import (
    HEIGHT_RESOLUTION,
    SUSPECTED,
    Cell,
    Geometry,
    HeightMap,
)
from heightmap25d_ros.grid.levels import NO_UPPER, SAME_HEIGHT, UpperSurfaces
from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.params.sections import LevelsParams, TraversabilityParams
from heightmap25d_ros.terrain.gap_filling import closed
from heightmap25d_ros.terrain.steps import NEIGHBOURS, UNOBSERVED

MOST_SLICES = 12
"""Of a map: a spiral needs one for each turn."""

_GAP = 0.25  # [m] of unknown ground that a surface is followed across
_SEARCH = 1.0  # [m] around a pose in which a known surface is looked for
_Z_WEIGHT = 3.0  # of a metre of height, when the surface nearest to a pose is looked for

_NONE = -1
_COVERED, _LEFT, _QUEUED = 0, 1, 2  # of a surface: whether a slice holds it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Slice:
    """One surface of each cell.

    Attributes
    ----------
    height_map : HeightMap
        Without anything above.
    layer : (rows, columns) int8
        Which surface of a `SurfaceStack` it is; -1: unknown.
    """

    height_map: HeightMap
    layer: NDArray[np.int8]


class SurfaceStack:
    """The surfaces of a map, layer by layer, with the clear height of the robot between them.

    Surfaces with less between them are one: what the robot does not fit under is solid.

    Parameters
    ----------
    height_map : HeightMap
    levels : LevelsParams, optional
    terrain : TraversabilityParams, optional
        ``max_step`` is how much a surface that is followed may rise or fall from cell to cell.

    Attributes
    ----------
    top : (layers, rows, columns) int32 [cm]
        Layer 0 holds the lowest surfaces; `UNOBSERVED` where there is none.

    Examples
    --------
    A bridge over the middle one of three cells, and the way below it:

    >>> from heightmap25d_ros.grid.levels import UpperSurfaces
    >>> road = HeightMap.from_metres([[0.0, 0.0, 0.0]])
    >>> bridge = UpperSurfaces.of([(0, 1)], top=[240], bottom=[210])
    >>> stack = SurfaceStack(replace(road, upper=bridge))
    >>> stack.followed((0, 0, 0)).height_map.height
    array([[0, 0, 0]], dtype=int16)
    >>> stack.highest().height_map.height
    array([[  0, 240,   0]], dtype=int16)
    """

    def __init__(
        self,
        height_map: HeightMap,
        levels: LevelsParams | None = None,
        terrain: TraversabilityParams | None = None,
    ) -> None:
        levels, terrain = levels or LevelsParams(), terrain or TraversabilityParams()
        self._height_map, self._terrain = height_map, terrain
        self._clear = round(levels.clear_height / HEIGHT_RESOLUTION)
        self._max_step = int(terrain.max_step / HEIGHT_RESOLUTION + 1e-6)
        self._reach = 1 + int(_GAP / height_map.geometry.resolution + 1e-6)
        upper = height_map.upper
        count = 1 + (int(upper.rank.max()) + 1 if len(upper) else 0)
        shape = (count, *height_map.geometry.shape)
        self.top = np.full(shape, UNOBSERVED, np.int32)
        self._bottom = np.full(shape, UNOBSERVED, np.int32)
        self._probability = np.zeros(shape, np.uint16)
        known = height_map.known
        self.top[0][known] = height_map.height[known]
        self._bottom[0] = -UNOBSERVED
        self._probability[0] = height_map.probability
        at = 1 + upper.rank, *upper.cell.T
        self.top[at], self._bottom[at] = upper.top, upper.bottom
        self._probability[at] = upper.probability
        for below in reversed(range(count - 1)):
            self._merge(below)
        if count > 1:
            self._hang()

    def _merge(self, below: int) -> None:
        """Unite surfaces of a layer with those above that are too near to them."""
        gap = self._bottom[below + 1] - self.top[below]
        y, x = np.nonzero((gap < self._clear) & (self.top[below] != UNOBSERVED))
        for array in (self.top, self._probability):
            array[below:-1, y, x] = array[below + 1 :, y, x]
        self._bottom[below + 1 : -1, y, x] = self._bottom[below + 2 :, y, x]
        self.top[-1, y, x] = self._bottom[-1, y, x] = UNOBSERVED
        self._probability[-1, y, x] = 0

    def _hang(self) -> None:
        """Take the lowest surface for a deck where it fills a narrow hole in one.

        The ground below was not seen there, as in a cell between two lines of a scan: it is unknown
        and no wall, if what is known of it around is level.
        """
        is_deck = (self.top[1:] != UNOBSERVED).any(axis=0)
        is_hole = closed(is_deck, self._reach) & ~is_deck & (self.top[0] != UNOBSERVED)
        holes = cells_of_mask(is_hole)
        hangs = _hanging(self.top, holes, self._reach - 1, self._max_step, self._clear)
        y, x = holes[hangs].T
        for array in (self.top, self._probability):
            array[1, y, x] = array[0, y, x]
        self._bottom[1, y, x] = self.top[0, y, x]
        self.top[0, y, x] = UNOBSERVED
        self._probability[0, y, x] = 0

    @property
    def footprint_cells(self) -> int:
        """Number of cells of the robot's disc: on less it cannot stand."""
        radius = self._terrain.robot_radius / self.geometry.resolution
        return max(1, int(math.pi * radius**2))

    @property
    def geometry(self) -> Geometry:
        """The map's."""
        return self._height_map.geometry

    def layers(self) -> Iterator[HeightMap]:
        """The layers as maps of one level, from below."""
        for number, top in enumerate(self.top):
            layer = np.where(top == UNOBSERVED, _NONE, number).astype(np.int8)
            yield self._slice(layer).height_map

    def lowest(self) -> Slice:
        """The lowest surface of each cell."""
        return self._slice(np.where(self.top[0] == UNOBSERVED, _NONE, 0).astype(np.int8))

    def highest(self) -> Slice:
        """The highest surface of each cell."""
        layer = np.full(self.top.shape[1:], _NONE, np.int8)
        for number, top in enumerate(self.top):
            layer[top != UNOBSERVED] = number
        return self._slice(layer)

    def surface_at(self, x: float, y: float, z: float | None) -> tuple[int, int, int] | None:
        """(layer, iy, ix) of the surface that a pose is on or next to; None: none is near.

        A surface of its own cell that is as far above or below it as another level counts as one
        of the cells around: that of the pose may be unknown here.

        Parameters
        ----------
        x, y : float [m], map
        z : float [m], map
            None: the lowest surface counts.
        """
        iy, ix = (int(index) for index in self.geometry.cell_at((x, y)))
        widest = int(_SEARCH / self.geometry.resolution)
        for reach in (0, widest):
            first_y, first_x = max(iy - reach, 0), max(ix - reach, 0)
            rows = np.s_[first_y : max(iy + reach + 1, 0)]
            columns = np.s_[first_x : max(ix + reach + 1, 0)]
            tops = self.top[:, rows, columns]
            if (tops != UNOBSERVED).any():
                middle = iy - first_y, ix - first_x
                layer, row, column = _nearest(tops, middle, self.geometry, z)
                found = layer, row + first_y, column + first_x
                if reach == widest or z is None or self.is_on_level(found, z):
                    return found
        return None

    def is_on_level(self, surface: tuple[int, int, int], z: float) -> bool:
        """Whether a surface (layer, iy, ix) is less than the clear height from a z [m], map."""
        return abs(self.z_of(surface) - z) < self._clear * HEIGHT_RESOLUTION

    def z_of(self, surface: tuple[int, int, int]) -> float:
        """Height [m], map, of a surface (layer, iy, ix)."""
        return float(self.top[surface]) * HEIGHT_RESOLUTION + self.geometry.ground_zero

    def layers_at(self, cell: Cell) -> list[int]:
        """The layers that have a surface in a cell, from below."""
        return [int(i) for i in np.flatnonzero(self.top[:, cell[0], cell[1]] != UNOBSERVED)]

    def followed(self, start: tuple[int, int, int]) -> Slice:
        """The slice that is followed from a surface (layer, iy, ix)."""
        return self._slice(self._completed(self._walk(start)))

    def slices(self, least_cells: int) -> list[Slice]:
        """Slices that together hold all surfaces that matter.

        Parameters
        ----------
        least_cells : int
            Patches of fewer cells get no slice for themselves: the robot does not fit on them.
        """
        found: list[Slice] = []
        state = np.where(self.top == UNOBSERVED, _COVERED, _LEFT).astype(np.uint8)
        while len(found) < MOST_SLICES:
            seed = _seed(self.top, self._bottom, state, self._max_step, self._clear, least_cells)
            if seed[0] == _NONE:
                break
            walked = self._walk(seed)
            found.append(self._slice(self._completed(walked)))
            for layer in (walked, found[-1].layer):
                y, x = np.nonzero(layer != _NONE)
                state[layer[y, x], y, x] = _COVERED
        return found or [self.lowest()]

    def _walk(self, start: tuple[int, int, int]) -> NDArray[np.int8]:
        layer = np.full(self.top.shape[1:], _NONE, np.int8)
        _walk(self.top, self._bottom, start, self._max_step, self._clear, self._reach, layer)
        return layer

    def _completed(self, layer: NDArray[np.int8]) -> NDArray[np.int8]:
        """With what the walk does not reach, as seen from the nearest surface that it does."""
        y, x = ndimage.distance_transform_edt(
            layer == _NONE, return_distances=False, return_indices=True
        )
        z = self.top[layer[y, x], y, x]
        result = layer.copy()
        for number, (top, bottom) in enumerate(zip(self.top, self._bottom, strict=True)):
            is_met = (top != UNOBSERVED) & (bottom < z + self._clear)
            result[(layer == _NONE) & is_met] = number
        return self._without_holes(result)

    def _without_holes(self, layer: NDArray[np.int8]) -> NDArray[np.int8]:
        """Without what is seen through narrow holes of a level: the level is unknown there.

        Through a hole in a deck that is what lies a clear height or more below it, and through one
        in the lowest surfaces what hangs as far above them.
        """
        result = layer.copy()
        for around, own in ((layer > 0, layer == 0), (layer == 0, layer > 0)):
            cells = cells_of_mask(closed(around, self._reach) & own)
            others = _of_other_level(self.top, layer, cells, self._reach - 1, self._clear)
            result[tuple(cells[others].T)] = _NONE
        return result

    def _slice(self, layer: NDArray[np.int8]) -> Slice:
        y, x = np.indices(layer.shape)
        chosen = np.maximum(layer, 0), y, x
        is_known = layer != _NONE
        unknown = np.where(self._height_map.suspected, SUSPECTED, 0)
        height_map = replace(
            self._height_map,
            height=np.where(is_known, self.top[chosen], unknown).astype(np.int16),
            probability=np.where(is_known, self._probability[chosen], np.uint16(0)),
            upper=NO_UPPER,
        )
        return Slice(height_map=height_map, layer=layer)


class LevelFollower:
    """Which surface the robot is on, followed as it drives.

    The z of a pose may be off by more than levels are apart. Its changes are not: from pose to
    pose the robot is on the surface that is nearest to the one before, raised by what z has
    changed.

    Attributes
    ----------
    offset : float [m]
        Of the surface from the z of the last pose.
    """

    def __init__(self) -> None:
        self.offset = 0.0

    def surface(self, stack: SurfaceStack, x: float, y: float, z: float) -> (
        tuple[int, int, int] | None
    ):  # fmt: skip
        """(layer, iy, ix) of the surface below the robot [m], map; None: none is near."""
        found = stack.surface_at(x, y, z + self.offset)
        if found is not None:
            self.offset = stack.z_of(found) - z
        return found


def _nearest(
    tops: NDArray[np.int32], cell: Cell, geometry: Geometry, z: float | None
) -> tuple[int, int, int]:
    """(layer, row, column) of the surface nearest to a cell and a z [m], map."""
    dy, dx = np.indices(tops.shape[1:])
    away = np.hypot(dy - cell[0], dx - cell[1]) * geometry.resolution
    heights = tops * HEIGHT_RESOLUTION + geometry.ground_zero
    off = np.abs(heights - z) if z is not None else np.indices(tops.shape)[0]
    cost = np.where(tops != UNOBSERVED, away + _Z_WEIGHT * off, np.inf)
    layer, row, column = np.unravel_index(cost.argmin(), cost.shape)
    return int(layer), int(row), int(column)


@kernel
def _hanging(top, cells, reach, max_step, clear):
    """Whether the lowest surfaces of some cells (N, 2) have the height of a deck around them.

    All other surfaces below the deck within the reach have to be level.
    """
    layers, rows, columns = top.shape
    result = np.zeros(len(cells), np.bool_)
    for i in range(len(cells)):
        y, x = cells[i]
        z = top[0, y, x]
        is_beside, low, high = False, UNOBSERVED, -UNOBSERVED
        for iy in range(max(y - reach, 0), min(y + reach + 1, rows)):
            for ix in range(max(x - reach, 0), min(x + reach + 1, columns)):
                for layer in range(layers):
                    near = top[layer, iy, ix]
                    if near != UNOBSERVED and near <= z - clear:
                        low, high = min(low, near), max(high, near)
                    elif layer and abs(near - z) <= SAME_HEIGHT:
                        is_beside = True
        result[i] = is_beside and low <= high <= low + max_step
    return result


@kernel
def _of_other_level(top, layer, cells, reach, clear):
    """Whether some cells (N, 2) of a slice have nothing of the level around them.

    That is of the nearest cell on the other side of the lowest layer; a deck is above what is seen
    through it, and hangs above what it is seen through.
    """
    layers, rows, columns = top.shape
    result = np.zeros(len(cells), np.bool_)
    for i in range(len(cells)):
        y, x = cells[i]
        is_deck = layer[y, x] > 0
        least, z = rows + columns, UNOBSERVED
        for iy in range(max(y - reach, 0), min(y + reach + 1, rows)):
            for ix in range(max(x - reach, 0), min(x + reach + 1, columns)):
                away = abs(iy - y) + abs(ix - x)
                is_other = layer[iy, ix] != _NONE and (layer[iy, ix] > 0) != is_deck
                if is_other and away < least:
                    least, z = away, top[layer[iy, ix], iy, ix]
        above = z - top[layer[y, x], y, x]
        result[i] = z != UNOBSERVED and (-above if is_deck else above) >= clear
        for number in range(layers):
            if abs(top[number, y, x] - z) < clear:
                result[i] = False
    return result


@kernel
def _met(top, bottom, y, x, z, clear):
    """The highest surface of a cell below which a robot at height z does not fit; -1: none."""
    for layer in range(len(top) - 1, -1, -1):
        if top[layer, y, x] != UNOBSERVED and bottom[layer, y, x] < z + clear:
            return layer
    return _NONE


@kernel
def _walk(top, bottom, start, max_step, clear, reach, chosen):
    """Follow the surface from a start, breadth first, and across gaps.

    A gap is what is unknown on this level: nothing is known there or, on an upper one, only what
    is below.
    """
    rows, columns = chosen.shape
    queue = np.empty((rows * columns, 2), np.int32)
    queue[0, 0], queue[0, 1] = start[1], start[2]
    chosen[start[1], start[2]] = start[0]
    done, count = 0, 1
    while done < count:
        y, x = queue[done, 0], queue[done, 1]
        done += 1
        z = top[chosen[y, x], y, x]
        for k in range(8):
            dy, dx = NEIGHBOURS[k]
            for n in range(1, reach + 1):
                iy, ix = y + n * dy, x + n * dx
                if not (0 <= iy < rows and 0 <= ix < columns) or chosen[iy, ix] != _NONE:
                    break
                layer = _met(top, bottom, iy, ix, z, clear)
                is_below = chosen[y, x] > 0 and z - top[layer, iy, ix] >= clear
                if layer == _NONE or is_below:
                    continue
                if abs(top[layer, iy, ix] - z) <= n * max_step:
                    chosen[iy, ix] = layer
                    queue[count, 0], queue[count, 1] = iy, ix
                    count += 1
                break


@kernel
def _seed(top, bottom, state, max_step, clear, least_cells):
    """A surface of the first patch of `_LEFT` ones that has enough cells.

    One that adjoins a surface that is not left, where there is one: from there a slice overlaps
    those that there are. The smaller patches before it are taken out.
    """
    layers, rows, columns = top.shape
    queue = np.empty(((state == _LEFT).sum(), 3), np.int32)
    for layer in range(layers):
        for y in range(rows):
            for x in range(columns):
                if state[layer, y, x] != _LEFT:
                    continue
                queue[0, 0], queue[0, 1], queue[0, 2] = layer, y, x
                count, best = _flood(top, bottom, state, max_step, clear, queue)
                is_enough = count >= least_cells
                for i in range(count):
                    after = _LEFT if is_enough else _COVERED
                    state[queue[i, 0], queue[i, 1], queue[i, 2]] = after
                if is_enough:
                    return queue[best, 0], queue[best, 1], queue[best, 2]
    return np.int32(_NONE), np.int32(0), np.int32(0)


@kernel
def _flood(top, bottom, state, max_step, clear, queue):
    """Queue the `_LEFT` surfaces that are connected with the first; their number, and one of them.

    One that adjoins a covered surface, where there is one.
    """
    state[queue[0, 0], queue[0, 1], queue[0, 2]] = _QUEUED
    done, count, best = 0, 1, 0
    while done < count:
        layer, y, x = queue[done, 0], queue[done, 1], queue[done, 2]
        z = top[layer, y, x]
        for k in range(8):
            iy, ix = y + NEIGHBOURS[k][0], x + NEIGHBOURS[k][1]
            if not (0 <= iy < top.shape[1] and 0 <= ix < top.shape[2]):
                continue
            there = _met(top, bottom, iy, ix, z, clear)
            if there == _NONE or abs(top[there, iy, ix] - z) > max_step:
                continue
            if state[there, iy, ix] == _LEFT:
                state[there, iy, ix] = _QUEUED
                queue[count, 0], queue[count, 1], queue[count, 2] = there, iy, ix
                count += 1
            elif state[there, iy, ix] == _COVERED:
                best = done
        done += 1
    return count, best


def compile_kernels() -> None:
    """Compile, or load from numba's cache, what maps with several levels need."""
    around = [(iy, ix) for iy in range(9) for ix in range(9) if (iy, ix) != (4, 4)]
    deck = UpperSurfaces.of(around, top=[240] * len(around), bottom=[210] * len(around))
    ground = HeightMap.from_metres(np.zeros((9, 9)))
    SurfaceStack(replace(ground, upper=deck)).slices(least_cells=1)
