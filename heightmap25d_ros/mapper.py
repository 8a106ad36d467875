# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper on one screen: beams into cells.

A beam clears the cells that it passes over (`_clear`) and raises, confirms or leaves alone the
cell that it ends in (`_hit`), by eq. (1) to (4) of Fong et al. (2003). Inside the kernels x and
y are counted in cells from the grid's corner, z in centimetres, and a beam is
``origin + t * (end - origin)`` with t from 0 to 1.

The kernels take plain arrays, many of them: a tuple of arrays would be reference-counted at every
call, which costs twenty times as much as the work. They stay in one file, since numba's cache
does not see changes of what a kernel calls in another one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from heightmap25d_ros.grid import (
    HEIGHT_LIMIT,
    HEIGHT_RESOLUTION,
    PROBABILITY_SCALE,
    TILE,
    TOP_BIAS,
    HeightGrid,
    stored_probability,
)
from heightmap25d_ros.params import MapperParams, SensorParams
from heightmap25d_ros.sensor import Beams

_OBSERVED = 1  # a tile_top: observed, though none of its cells has a height now
_TILE_CELLS = TILE * TILE
_TOUCH = 1e-9  # t, and [cells]: what a beam passes for less than this it only touches
_LEVEL = 1e-9  # [cm] a beam that falls less than this is taken to fall so much
_GOLDEN = 2654435761  # spreads the cells over a hash set (Knuth's multiplicative hashing)
_PROBES = 16  # slots of the set that are tried
_NEVER = 1e12  # t per cell of a beam that does not leave it
_kernel = njit(cache=True, error_model="numpy")
_inlined = njit(cache=True, error_model="numpy", forceinline=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Integrated:
    """What became of the beams of a scan.

    Attributes
    ----------
    hits : int
        Returns that were merged into a cell.
    clipped : int
        Of these, the ones beyond +-327 m, stored as +-327 m.
    outside : int
        Returns beyond the extent of the grid, lost.
    """

    hits: int
    clipped: int
    outside: int


class Mapper:
    """Merges beams into a grid.

    Parameters
    ----------
    grid : HeightGrid
    sensor : SensorParams
    params : MapperParams
    """

    def __init__(self, grid: HeightGrid, sensor: SensorParams, params: MapperParams) -> None:
        self.grid = grid
        self.params = params
        candidate = params.update_rule == "candidate"
        self._hit = _Likelihoods(sensor.hit_given_object, sensor.hit_given_empty, sensor.max_range)
        self._miss = _Likelihoods(
            sensor.miss_given_object, sensor.miss_given_empty, sensor.max_range
        )
        self._rule = _Rule(
            candidate=candidate,
            tolerance=round(params.height_tolerance / HEIGHT_RESOLUTION),
            allowance=round(params.height_allowance / HEIGHT_RESOLUTION) if candidate else 0,
            clearing_width=params.clearing_width / 2 if candidate else np.inf,
            clearing_margin=params.clearing_margin / HEIGHT_RESOLUTION if candidate else 0.0,
            known=stored_probability(params.probability_threshold),
            lowest=stored_probability(params.probability_min),
            highest=stored_probability(params.probability_max),
            replace_belief=params.replace_belief,
            candidate_belief=stored_probability(params.candidate_belief),
        )

    def integrate(self, beams: Beams) -> Integrated:
        """Merge the beams, one after the other."""
        geometry = self.grid.geometry
        hits, clipped, outside = _integrate(
            beams.origins,
            beams.ends,
            beams.is_hit,
            beams.is_lone,
            geometry.origin,
            geometry.resolution,
            self.grid.tile_top.shape,
            self.grid.height.cells.reshape(-1),
            self.grid.probability.cells.reshape(-1),
            self.grid.candidate_height.cells.reshape(-1),
            self.grid.candidate_probability.cells.reshape(-1),
            self.grid.tile_top.reshape(-1),
            self.grid.tile_changed.reshape(-1),
            self._hit,
            self._miss,
            self._rule,
        )
        return Integrated(hits=hits, clipped=clipped, outside=outside)


class _Likelihoods(NamedTuple):
    """P(.|O) and P(.|not O) of a reading, each at range 0 and at ``max_range``."""

    given_object: tuple[float, ...]
    given_empty: tuple[float, ...]
    max_range: float


class _Rule(NamedTuple):
    """MapperParams in the units of the stored cells."""

    candidate: bool
    tolerance: int
    allowance: int
    clearing_width: float
    clearing_margin: float
    known: int
    lowest: int
    highest: int
    replace_belief: float
    candidate_belief: int


@_inlined
def _likelihoods(distance, model):
    """P(.|O) and P(.|not O) of a reading at a distance [m]."""
    far = min(distance / model.max_range, 1.0)
    near_object, far_object = model.given_object
    near_empty, far_empty = model.given_empty
    return near_object + far * (far_object - near_object), near_empty + far * (
        far_empty - near_empty
    )


@_inlined
def _stored(probability, rule):
    """A probability as it is stored, clamped so that the cell can still change."""
    return min(max(int(probability * PROBABILITY_SCALE + 0.5), rule.lowest), rule.highest)


@_inlined
def _bayes(stored, given_object, given_empty, rule):
    """Eq. (4), with P(s|not O) in the second term, as the text under it has it."""
    prior = stored / PROBABILITY_SCALE
    for_object = given_object * prior
    return _stored(for_object / (for_object + given_empty * (1.0 - prior)), rule)


@_inlined
def _hit(cell, z, distance, model, rule):
    """A cell after a return at height z [cm].

    A cell is (height, probability, candidate height, candidate probability).
    """
    height, probability, candidate_height, candidate = cell
    given_object, given_empty = _likelihoods(distance, model)
    if probability < rule.known:
        return z, _stored(given_object, rule), 0, 0  # eq. (1), (2)
    if z > height + rule.tolerance:
        if given_object < rule.replace_belief:
            return cell
        if rule.candidate:
            return _propose(cell, z, given_object, given_empty, rule)
        return z, _stored(given_object, rule), 0, 0  # eq. (1), (2)
    if z >= height - rule.tolerance:
        belief = _bayes(probability, given_object, given_empty, rule)
        height = max(z - rule.allowance, height)
        if candidate_height <= height + rule.tolerance:
            candidate = 0  # the height has grown up to it
        return height, belief, candidate_height, candidate  # eq. (3), (4)
    return cell


@_inlined
def _propose(cell, z, given_object, given_empty, rule):
    """A cell after a reading far above its height: the paper's candidate.

    Two such readings support the lower one of them, because objects are complete from the
    ground up: what is seen at 2 m is also there at 1 m. The higher one goes on waiting, unless
    the two are the same height within the tolerance.
    """
    height, probability, candidate_height, candidate = cell
    if candidate == 0:
        return height, probability, z, _stored(given_object, rule)
    lower, higher = min(z, candidate_height), max(z, candidate_height)
    is_same = higher - lower <= rule.tolerance
    supported = higher if is_same else lower
    belief = _bayes(candidate, given_object, given_empty, rule)
    if belief < rule.candidate_belief:
        return height, probability, supported, belief
    return supported, belief, higher, 0 if is_same else _stored(given_object, rule)


@_inlined
def _miss(cell, beam_height, distance, model, rule):
    """A cell after a beam passed over it: what stands at or above it is believed less."""
    height, probability, candidate_height, candidate = cell
    given_object, given_empty = _likelihoods(distance, model)
    if candidate > 0 and candidate_height >= beam_height:
        candidate = _bayes(candidate, given_object, given_empty, rule)
        candidate = candidate if candidate >= rule.known else 0
    if probability >= rule.known and height >= beam_height:
        probability = _bayes(probability, given_object, given_empty, rule)
    return height, probability, candidate_height, candidate


@_kernel
def _integrate(  # noqa: PLR0913
    origins, ends, is_hit, is_lone, corner, resolution, tiles,
    heights, probabilities, candidate_heights, candidates, tile_top, tile_changed,
    hit_model, miss_model, rule,
):  # fmt: skip
    """Merge beams, shapes (N, 3), (N, 3), (N,); returns the counts of `Integrated`."""
    hits = clipped = outside = 0
    rows, columns = tiles
    judged = _cells_hit(ends, is_hit, is_lone, corner, resolution, columns, rule)
    for beam in range(len(ends)):
        if rule.candidate and is_lone[beam]:
            continue
        origin = _in_cells(origins, beam, corner, resolution)
        end = _in_cells(ends, beam, corner, resolution)
        if not (_is_inside(origin, rows, columns) and _is_inside(end, rows, columns)):
            outside += is_hit[beam]
            continue
        length = np.sqrt(
            (ends[beam, 0] - origins[beam, 0]) ** 2
            + (ends[beam, 1] - origins[beam, 1]) ** 2
            + (ends[beam, 2] - origins[beam, 2]) ** 2
        )
        _clear(
            origin, end, length, columns, heights, probabilities, candidate_heights, candidates,
            tile_top, tile_changed, judged, miss_model, rule,
        )  # fmt: skip
        if not is_hit[beam]:
            continue
        z = int(np.floor(end[2] + 0.5))
        clipped += abs(z) > HEIGHT_LIMIT
        z = min(max(z, -HEIGHT_LIMIT), HEIGHT_LIMIT)
        ix, iy = int(end[0]), int(end[1])
        tile = np.uint64(iy // TILE * columns + ix // TILE)
        cell = np.uint64(tile * np.uint64(_TILE_CELLS) + np.uint64(iy % TILE * TILE + ix % TILE))
        before = _content(cell, heights, probabilities, candidate_heights, candidates)
        after = _hit(before, z, length, hit_model, rule)
        heights[cell], probabilities[cell] = after[0], after[1]
        if after[3] != 0 or before[3] != 0:  # a page without candidates takes no memory
            candidate_heights[cell], candidates[cell] = after[2], after[3]
        if after[0] != before[0] or before[1] < rule.known:
            tile_changed[tile] = 1
        tile_top[tile] = max(tile_top[tile], max(after[0], z) + TOP_BIAS)
        hits += 1
    return hits, clipped, outside


@_inlined
def _in_cells(points, index, corner, resolution):
    """A point [m] as x, y [cells] from the corner and z [cm]."""
    x = (points[index, 0] - corner[0]) / resolution
    y = (points[index, 1] - corner[1]) / resolution
    return x, y, points[index, 2] / HEIGHT_RESOLUTION


@_inlined
def _is_inside(point, rows, columns):
    return 0.0 <= point[0] < columns * TILE and 0.0 <= point[1] < rows * TILE


@_inlined
def _content(cell, heights, probabilities, candidate_heights, candidates):
    """The four numbers of a cell."""
    return (
        np.int64(heights[cell]),
        np.int64(probabilities[cell]),
        np.int64(candidate_heights[cell]),
        np.int64(candidates[cell]),
    )


@_inlined
def _clear(  # noqa: PLR0913
    origin, end, length, columns, heights, probabilities, candidate_heights, candidates,
    tile_top, tile_changed, judged, model, rule,
):  # fmt: skip
    """Walk the tiles between the ends of a beam, and in them the cells that may reach it."""
    ray_x, ray_y = _axis(origin[0], end[0]), _axis(origin[1], end[1])
    entered = min(_exit(int(origin[0]), 1, ray_x), _exit(int(origin[1]), 1, ray_y))
    last = max(_entry(int(end[0]), ray_x), _entry(int(end[1]), ray_y))
    z, fall = origin[2] + rule.clearing_margin, end[2] - origin[2]
    if abs(fall) < _LEVEL:
        fall = -_LEVEL
    tx, ty = int(origin[0]) // TILE, int(origin[1]) // TILE
    exit_x, exit_y = _exit(tx, TILE, ray_x), _exit(ty, TILE, ray_y)
    across_x, across_y = abs(ray_x[2]) * TILE, abs(ray_y[2]) * TILE
    while entered < last:
        left = min(exit_x, exit_y, last)
        tile = np.uint64(ty * columns + tx)
        # Where the beam is as high as the highest cell of the tile: only below that it can meet.
        meets = (tile_top[tile] - TOP_BIAS - z) / fall
        start = max(entered, meets) if fall < 0.0 else entered
        stop = left if fall < 0.0 else min(left, meets)
        if start < stop and _clear_tile(
            tx, ty, tile, start, stop, ray_x, ray_y, z, fall, length,
            heights, probabilities, candidate_heights, candidates, judged, model, rule,
        ):  # fmt: skip
            tile_changed[tile] = 1
            tile_top[tile] = _top_of(
                tile, heights, probabilities, candidate_heights, candidates, rule
            )
        entered = left
        if exit_x < exit_y:
            tx += ray_x[3]
            exit_x += across_x
        else:
            ty += ray_y[3]
            exit_y += across_y


@_inlined
def _clear_tile(  # noqa: PLR0913
    tx, ty, tile, start, stop, ray_x, ray_y, z, fall, length,
    heights, probabilities, candidate_heights, candidates, judged, model, rule,
):  # fmt: skip
    """Lower the belief in what stands in the beam; whether a cell became unknown by it."""
    is_lost = False
    x = min(max(int(ray_x[0] + start * ray_x[1]) - tx * TILE, 0), TILE - 1)
    y = min(max(int(ray_y[0] + start * ray_y[1]) - ty * TILE, 0), TILE - 1)
    exit_x, exit_y = _exit(tx * TILE + x, 1, ray_x), _exit(ty * TILE + y, 1, ray_y)
    across_x, across_y = abs(ray_x[2]), abs(ray_y[2])
    entered = max(exit_x - across_x, exit_y - across_y)
    index = np.int64(tile) * _TILE_CELLS + y * TILE + x
    step_x, step_y = ray_x[3], ray_y[3] * TILE
    while entered < stop - _TOUCH:
        left = min(exit_x, exit_y)
        middle = 0.5 * (entered + left)
        beam_height = z + middle * fall
        cell = np.uint64(index)
        is_passed = left > max(entered, start) + _TOUCH
        stands = heights[cell] >= beam_height and probabilities[cell] >= rule.known
        held = candidates[cell] > 0 and candidate_heights[cell] >= beam_height
        if (
            is_passed
            and (stands or held)
            and (not rule.candidate or _may_judge(index, tx, ty, ray_x, ray_y, judged, rule))
        ):
            before = _content(cell, heights, probabilities, candidate_heights, candidates)
            after = _miss(before, beam_height, middle * length, model, rule)
            probabilities[cell] = after[1]
            if before[3] != 0:
                candidates[cell] = after[3]
            is_lost |= after[1] < rule.known <= before[1]
        entered = left
        if exit_x < exit_y:
            index += step_x
            exit_x += across_x
        else:
            index += step_y
            exit_y += across_y
    return is_lost


@_kernel
def _cells_hit(ends, is_hit, is_lone, corner, resolution, columns, rule):
    """A hash set of the cells that this scan's returns are in; empty for the literal rule."""
    size = 16
    while size < 8 * len(ends):
        size *= 2
    judged = np.full(size if rule.candidate else 1, np.int64(-1))
    for beam in range(len(ends)):
        if rule.candidate and is_hit[beam] and not is_lone[beam]:
            end = _in_cells(ends, beam, corner, resolution)
            ix, iy = int(np.floor(end[0])), int(np.floor(end[1]))
            tile = iy // TILE * columns + ix // TILE
            _add(tile * _TILE_CELLS + iy % TILE * TILE + ix % TILE, judged)
    return judged


@_inlined
def _add(cell, judged):
    """Put a cell into the set; false if it is in it already, or the set is full around it."""
    mask = len(judged) - 1
    slot = ((cell * _GOLDEN) >> 20) & mask
    for _ in range(_PROBES):
        if judged[slot] == cell:
            return False
        if judged[slot] == -1:
            judged[slot] = cell
            return True
        slot = (slot + 1) & mask
    return False


@_kernel
def _may_judge(index, tx, ty, ray_x, ray_y, judged, rule):
    """Whether a beam may speak against a cell: it passes the middle, and is the scan's first."""
    y, x = index % _TILE_CELLS // TILE, index % TILE
    off_x = tx * TILE + x + 0.5 - ray_x[0]
    off_y = ty * TILE + y + 0.5 - ray_y[0]
    across = abs(off_x * ray_y[1] - off_y * ray_x[1])
    if across > rule.clearing_width * np.hypot(ray_x[1], ray_y[1]):
        return False
    return _add(index, judged)


@_inlined
def _axis(origin, end):
    """A beam along one axis: origin, extent, t per cell, step, side of a cell it leaves by."""
    extent = end - origin
    if abs(extent) < _TOUCH:
        return origin, extent, _NEVER, 1, 1
    if extent > 0.0:
        return origin, extent, 1.0 / extent, 1, 1
    return origin, extent, 1.0 / extent, -1, 0


@_inlined
def _exit(index, size, ray):
    """Where, as t, a beam leaves a cell or a tile along one axis."""
    return ((index + ray[4]) * size - ray[0]) * ray[2]


@_inlined
def _entry(index, ray):
    """Where, as t, a beam enters a cell along one axis."""
    return (index + 1 - ray[4] - ray[0]) * ray[2]


@_kernel
def _top_of(tile, heights, probabilities, candidate_heights, candidates, rule):
    """Highest height or candidate in a tile, as `HeightGrid.tile_top` has it."""
    top = _OBSERVED
    first = np.int64(tile) * _TILE_CELLS
    for cell in range(first, first + _TILE_CELLS):
        if probabilities[cell] >= rule.known:
            top = max(top, heights[cell] + TOP_BIAS)
        if candidates[cell] > 0:
            top = max(top, candidate_heights[cell] + TOP_BIAS)
    return top
