# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Beams into cells: each beam is traced through the grid, and the cells along it are updated.

A beam clears the cells that it passes over (`_clear`) and updates the cell in which it ends, both
with `cell_update`, and with `level_update` where surfaces are one above the other. Inside the
kernels x and y are counted in cells from the grid's corner, z in centimetres above ground zero, and
the distance along a beam in ticks: integers, which add up without rounding and faster than floats.

The kernels take plain arrays, many of them, are inlined, divide by numpy's rules, which raise
nothing, and leave a loop by one condition only. Otherwise numba counts references to the arrays
for every beam, which costs more than the work.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from heightmap25d_ros.grid.height_grid import TILE, TOP_BIAS, HeightGrid
from heightmap25d_ros.grid.height_map import (
    HEIGHT_LIMIT,
    HEIGHT_RESOLUTION,
    stored_probability,
)
from heightmap25d_ros.grid.levels import BELIEF
from heightmap25d_ros.kernels import inlined_kernel, kernel
from heightmap25d_ros.mapping.cell_update import Likelihoods, Rule, hit, is_contradicted, miss
from heightmap25d_ros.mapping.changed_tiles import include
from heightmap25d_ros.mapping.level_update import (
    BELIEFS,
    CHANGED,
    SURPLUS,
    hit_surface,
    is_in_the_way,
    lost,
    miss_upper,
    update_span,
)
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.mapping.sensor_model import beams as beams_of
from heightmap25d_ros.params.sections import MapperParams, SensorParams

_OBSERVED = 1  # a tile_top: observed, though no cell of the tile has a height now
_TILE_CELLS = TILE * TILE
_TICKS = 2.0**40  # along a beam from end to end, however long it is
_FEW = 1024  # [ticks] of tolerance: a cell that a beam crosses for less is only touched
_ENDLESS = 2.0**57  # [ticks per cell] of a beam that does not leave it along an axis
_HEIGHT_STEP = 1.0  # [cm] of the stored heights
_END = 1.0  # [m] before its end, where the whole margin counts for every beam
_LEVEL = 0.25  # [cm] least fall of a beam that is assumed when tiles are skipped
_GOLDEN = 2654435761  # Knuth's multiplicative hashing, for a hash set of cells
_PROBES = 16  # slots of the set that are probed
_NEVER = 2**30  # [cm] of clear height, where a cell has but one surface


class Integrated(NamedTuple):
    """Counts of the returns of a scan.

    Attributes
    ----------
    hits : int
        Returns that were merged into a cell.
    out_of_range : int
        Returns more than 327 m above or below ground zero, discarded.
    outside : int
        Returns beyond the extent of the grid, discarded.
    surplus : int
        Returns from more surfaces than a cell holds (``levels.max_surfaces``), discarded.
    """

    hits: int
    out_of_range: int
    outside: int
    surplus: int


class Mapper:
    """Integrates beams into a grid.

    Parameters
    ----------
    grid : HeightGrid
    sensor : SensorParams, optional
    params : MapperParams, optional

    Examples
    --------
    A laser that is 0.4 m above the ground and looks ahead; the return is 2 m away:

    >>> grid = HeightGrid()
    >>> T_base_sensor = np.eye(4)
    >>> T_base_sensor[2, 3] = 0.4
    >>> scan = Scan(angle_min=0.0, angle_increment=0.01, ranges=[2.0])
    >>> Mapper(grid).add_scan(scan, np.eye(4), T_base_sensor)
    Integrated(hits=1, out_of_range=0, outside=0, surplus=0)
    >>> height_map = grid.read()
    >>> int(height_map.height[tuple(height_map.geometry.cell_at((2.0, 0.0)))])  # [cm]
    40
    """

    def __init__(
        self,
        grid: HeightGrid,
        sensor: SensorParams | None = None,
        params: MapperParams | None = None,
    ) -> None:
        sensor, params = sensor or SensorParams(), params or MapperParams()
        self.grid = grid
        self.params = params
        self._sensor = sensor
        candidate = params.update_rule == "candidate"
        rule = Rule(
            candidate=candidate,
            tolerance=round(params.height_tolerance / HEIGHT_RESOLUTION),
            allowance=round(params.height_allowance / HEIGHT_RESOLUTION) if candidate else 0,
            clearing_width=params.clearing_width / 2 if candidate else np.inf,
            clearing_margin=params.clearing_margin / HEIGHT_RESOLUTION if candidate else 0.0,
            clearing_fall=params.clearing_fall / HEIGHT_RESOLUTION if candidate else 0.0,
            known=stored_probability(params.probability_threshold),
            lowest=stored_probability(params.probability_min),
            highest=stored_probability(params.probability_max),
            replace_belief=params.replace_belief,
            candidate_belief=stored_probability(params.candidate_belief),
            layers=grid.upper.count,
            clear=round(grid.levels.clear_height / HEIGHT_RESOLUTION)
            if grid.upper.count
            else _NEVER,
        )
        cells = (grid.height, grid.probability, grid.candidate_height, grid.candidate_probability)
        self._constants = (
            (*grid.geometry.origin, grid.geometry.ground_zero),
            1.0 / grid.geometry.resolution,
            grid.tile_top.shape,
            *(array.cells.reshape(-1) for array in cells),
            grid.tile_top.reshape(-1),
            grid.tile_changed.reshape(-1),
            grid.observed,
            grid.changed,
            tuple(array.reshape(-1) for array in (*grid.upper.stored, grid.upper.tile_span)),
        )
        self._rule = tuple(rule)  # named ones cost numba three times as much, at each call

    def add_scan(self, scan: Scan, T_map_base: ArrayLike, T_base_sensor: ArrayLike) -> Integrated:
        """Merge a scan; its beams become those of `sensor_model.beams`.

        Parameters
        ----------
        scan : Scan
        T_map_base, T_base_sensor : (N, 4, 4), (1, 4, 4) or (4, 4) float64
            Pose of the robot in the map and of the laser on the robot, at each beam's own time or
            once for all beams.

        Raises
        ------
        ValueError
            If the poses do not go with the number of beams.
        """
        lone_return = self.params.lone_return
        return self.integrate(beams_of(scan, T_map_base, T_base_sensor, self._sensor, lone_return))

    def integrate(self, beams: Beams) -> Integrated:
        """Integrate the beams in their order.

        Raises
        ------
        ValueError
            If their arrays do not go with one another.
        """
        flags = beams.is_hit.shape, beams.is_lone.shape
        if not beams.origins.shape == beams.ends.shape == (*flags[0], 3) == (*flags[1], 3):
            raise ValueError("beams: origins and ends need shape (N, 3), is_hit and is_lone (N,)")
        counts = _integrate(
            beams.origins, beams.ends, beams.is_hit, beams.is_lone, *self._constants,
            *_models(beams.sensor or self._sensor), self._rule,
        )  # fmt: skip
        return Integrated(*counts)


def _models(sensor: SensorParams) -> tuple[tuple[object, ...], tuple[object, ...]]:
    """`Likelihoods` of hits and of misses, as plain tuples."""
    end = sensor.max_range, sensor.error_growth == "quadratic"
    return (
        (sensor.hit_given_object, sensor.hit_given_empty, *end),
        (sensor.miss_given_object, sensor.miss_given_empty, *end),
    )


@kernel
def _integrate(  # noqa: PLR0913
    origins, ends, is_hit, is_lone, corner, cells_per_metre, tiles,
    heights, probabilities, candidate_heights, candidates, tile_top, tile_changed,
    observed, changed, layers, hit_model, miss_model, rule,
):  # fmt: skip
    """Integrate beams, shapes (N, 3), (N, 3), (N,); returns the counts of `Integrated`."""
    hit_model, miss_model, rule = Likelihoods(*hit_model), Likelihoods(*miss_model), Rule(*rule)
    hits = out_of_range = outside = surplus = 0
    spans = layers[2]
    rows, columns = tiles
    judged = _cells_hit(ends, is_hit, is_lone, corner, cells_per_metre, columns, rule)
    for beam in range(len(ends)):
        if rule.candidate and is_lone[beam]:
            continue
        origin = _in_cells(origins, beam, corner, cells_per_metre)
        end = _in_cells(ends, beam, corner, cells_per_metre)
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
            tile_top, tile_changed, changed, layers, judged, miss_model, rule,
        )  # fmt: skip
        if not is_hit[beam]:
            continue
        z = int(np.floor(end[2] + 0.5))
        if abs(z) > HEIGHT_LIMIT:
            out_of_range += 1
            continue
        ix, iy = int(end[0]), int(end[1])
        tile = np.uint64(iy // TILE * columns + ix // TILE)
        cell = np.uint64(tile * np.uint64(_TILE_CELLS) + np.uint64(iy % TILE * TILE + ix % TILE))
        before = _content(cell, heights, probabilities, candidate_heights, candidates)
        outcome = 0
        has_upper = spans[2 * tile + 1] != 0 and _has_upper(cell, layers, rule)
        if has_upper or _may_be_clear(before, z, rule):
            after, outcome = hit_surface(cell, tile, z, length, before, layers, hit_model, rule)
            surplus += outcome == SURPLUS
        else:
            after = hit(before, z, length, hit_model, rule)
        heights[cell], probabilities[cell] = after[0], after[1]
        if after[3] != 0 or before[3] != 0:  # a page without candidates takes no memory
            candidate_heights[cell], candidates[cell] = after[2], after[3]
        is_changed = after[0] != before[0] or before[1] < rule.known or outcome == CHANGED
        if is_changed and tile_changed[tile] == 0:
            tile_changed[tile] = 1
            include(iy // TILE, ix // TILE, changed)
        if tile_top[tile] == 0:
            include(iy // TILE, ix // TILE, observed)
        tile_top[tile] = max(tile_top[tile], max(after[0], z) + TOP_BIAS)
        hits += 1
    return hits, out_of_range, outside, surplus


@inlined_kernel
def _may_be_clear(cell, z, rule):
    """Whether the robot fits between a cell and a reading, or the cell and its candidate."""
    height, probability, candidate_height, candidate = cell
    is_far = abs(z - height) >= rule.clear or (
        candidate > 0 and candidate_height - height >= rule.clear
    )
    return probability >= rule.known and is_far


@inlined_kernel
def _in_cells(points, index, corner, cells_per_metre):
    """A point [m] as x, y [cells] from the corner (x, y, z) and z [cm]."""
    x = (points[index, 0] - corner[0]) * cells_per_metre
    y = (points[index, 1] - corner[1]) * cells_per_metre
    return x, y, (points[index, 2] - corner[2]) * (1.0 / HEIGHT_RESOLUTION)


@inlined_kernel
def _is_inside(point, rows, columns):
    return 0.0 <= point[0] < columns * TILE and 0.0 <= point[1] < rows * TILE


@inlined_kernel
def _content(cell, heights, probabilities, candidate_heights, candidates):
    """The four numbers of a cell."""
    return (
        np.int64(heights[cell]),
        np.int64(probabilities[cell]),
        np.int64(candidate_heights[cell]),
        np.int64(candidates[cell]),
    )


@inlined_kernel
def _clear(  # noqa: PLR0913
    origin, end, length, columns, heights, probabilities, candidate_heights, candidates,
    tile_top, tile_changed, changed, layers, judged, model, rule,
):  # fmt: skip
    """Traverse the tiles between the ends of a beam, and in them the cells that may reach it.

    The traversal goes from the upper end to the lower one.
    """
    upper, lower, distance, metres = origin, end, 0.0, length / _TICKS
    if origin[2] < end[2]:
        upper, lower, distance, metres = end, origin, length, -length / _TICKS
    x, y = _axis(upper[0], lower[0]), _axis(upper[1], lower[1])
    first = min(_exit(int(upper[0]), 1, x), _exit(int(upper[1]), 1, y))
    last = max(_entry(int(lower[0]), x), _entry(int(lower[1]), y)) - _FEW
    fall = upper[2] - lower[2]
    margin = _margin(fall, rule)
    z, lacking = upper[2] + margin, rule.clearing_margin - margin
    ticks_per_cm = _TICKS / max(fall, _LEVEL)
    biased_z = z + TOP_BIAS
    tx, ty = int(upper[0]) // TILE, int(upper[1]) // TILE
    index = ty * columns + tx
    exit_x, exit_y = _exit(tx, TILE, x), _exit(ty, TILE, y)
    across_x, across_y = _across(TILE, x), _across(TILE, y)
    last_tx, last_ty = int(lower[0]) // TILE, int(lower[1]) // TILE
    spans = layers[2]
    for _ in range(1 + abs(last_tx - tx) + abs(last_ty - ty)):
        stop = min(exit_x, exit_y, last)
        tile = np.uint64(index)
        # A beam above the highest cell of a tile cannot touch any of its cells. One below all that
        # is above the lowest surfaces, or above it, cannot touch that.
        meets = int((biased_z - tile_top[tile]) * ticks_per_cm)
        begin = max(first, exit_x - across_x, exit_y - across_y)
        is_among = False
        if spans[2 * tile + 1] != 0:
            meets_upper = int((biased_z - spans[2 * tile + 1]) * ticks_per_cm)
            start_z = biased_z - begin * (fall / _TICKS)
            is_among = meets_upper < stop and start_z >= spans[2 * tile] - rule.tolerance
            meets = min(meets, meets_upper) if is_among else meets
        if meets < stop and _clear_tile(
            tile, max(begin, meets), stop, x, y,
            z, fall / _TICKS, distance, metres, lacking, length - _END, origin[2],
            heights, probabilities, candidate_heights, candidates,
            layers, is_among, judged, model, rule,
        ):  # fmt: skip
            if tile_changed[tile] == 0:
                tile_changed[tile] = 1
                include(index // columns, index % columns, changed)
            tile_top[tile] = _top_of(
                tile, heights, probabilities, candidate_heights, candidates, rule
            )
            if spans[2 * tile + 1] != 0:
                update_span(tile, layers, rule)
        if exit_x < exit_y:
            index += x.step
            exit_x += across_x
        else:
            index += y.step * columns
            exit_y += across_y


@inlined_kernel
def _margin(fall, rule):
    """How far above a beam the heights are that it contradicts [cm].

    The whole margin where a beam meets the ground, on which it would otherwise graze its own end.
    A level beam passes exactly at the height of what it has hit before: it contradicts that too,
    within a step of the stored heights. Not on its last metre (`_END`): the ground may rise to
    where it ended, as a ramp does, and errors of the pose put a beam below it.
    """
    if fall >= rule.clearing_fall:
        return rule.clearing_margin
    share = fall / rule.clearing_fall
    return share * rule.clearing_margin - (1.0 - share) * _HEIGHT_STEP


@inlined_kernel
def _clear_tile(  # noqa: PLR0913
    tile, start, stop, x, y, z, fall, distance, metres, lacking, end, sensor_z,
    heights, probabilities, candidate_heights, candidates,
    layers, is_among, judged, model, rule,
):  # fmt: skip
    """Lower the probability of heights that the beam contradicts; true if a cell became unknown.

    ``fall`` [cm] and ``metres``, which start from ``z`` and ``distance``, are per tick. From a
    distance ``end`` on the beam is higher by what is ``lacking`` from the whole margin [cm].
    ``is_among``: the beam may contradict upper surfaces as well.
    """
    is_lost = False
    half_fall = 0.5 * fall
    ix = np.floor(x.origin + (start + _FEW) * x.cells)
    iy = np.floor(y.origin + (start + _FEW) * y.cells)
    exit_x, exit_y = _exit(ix, 1, x), _exit(iy, 1, y)
    across_x, across_y = _across(1, x), _across(1, y)
    entered = max(exit_x - across_x, exit_y - across_y)
    index = np.int64(tile) * _TILE_CELLS + int(iy) % TILE * TILE + int(ix) % TILE
    while entered < stop - _FEW:
        left = min(exit_x, exit_y)
        middle = 0.5 * (entered + left)
        beam_height = z - (entered + left) * half_fall
        if distance + middle * metres > end:
            beam_height += lacking
        cell = np.uint64(index)
        has_upper = is_among and _has_upper(cell, layers, rule)
        is_met = heights[cell] >= beam_height or candidates[cell] > 0 or has_upper
        if is_met and left - entered > _FEW:
            before = _content(cell, heights, probabilities, candidate_heights, candidates)
            entry = beam_height - rule.clearing_margin + (left - entered) * half_fall
            is_in_upper = has_upper and is_in_the_way(cell, beam_height, entry, layers, rule)
            if (is_in_upper or is_contradicted(before, beam_height, rule)) and (
                not rule.candidate or _may_judge(index, middle, x, y, judged, rule)
            ):
                passed = distance + middle * metres
                if is_in_upper:
                    is_lost |= miss_upper(cell, beam_height, entry, passed, layers, model, rule)
                after = miss(before, beam_height, passed, model, rule)
                if rule.layers > 0 and after[1] < rule.known <= before[1]:
                    after = lost(cell, tile, before, after, beam_height, sensor_z, layers, rule)
                    heights[cell] = after[0]
                probabilities[cell] = after[1]
                if before[3] != 0 or after[3] != 0:
                    candidate_heights[cell], candidates[cell] = after[2], after[3]
                is_lost |= after[1] < rule.known <= before[1] or after[0] != before[0]
        entered = left
        if exit_x < exit_y:
            index += x.step
            exit_x += across_x
        else:
            index += y.step * TILE
            exit_y += across_y
    return is_lost


@inlined_kernel
def _has_upper(cell, layers, rule):
    """Whether a cell has surfaces above the lowest one."""
    beliefs, found = layers[1], False
    step = len(beliefs) // (rule.layers + 1)
    for layer in range(rule.layers):
        found |= beliefs[layer * step + np.int64(cell) * BELIEFS + BELIEF] >= rule.known
    return found


@kernel
def _cells_hit(ends, is_hit, is_lone, corner, cells_per_metre, columns, rule):
    """A hash set of the cells that contain this scan's returns; empty for the literal rule."""
    size = 16
    while size < 4 * len(ends):
        size *= 2
    judged = np.full(size if rule.candidate else 1, np.int64(-1))
    for beam in range(len(ends)):
        if rule.candidate and is_hit[beam] and not is_lone[beam]:
            end = _in_cells(ends, beam, corner, cells_per_metre)
            ix, iy = int(np.floor(end[0])), int(np.floor(end[1]))
            tile = iy // TILE * columns + ix // TILE
            _add(tile * _TILE_CELLS + iy % TILE * TILE + ix % TILE, judged)
    return judged


@inlined_kernel
def _add(cell, judged):
    """Add a cell to the set; false if it is present already, or its slots are taken."""
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


@inlined_kernel
def _may_judge(index, middle, x, y, judged, rule):
    """Whether a beam may clear a cell: it passes near the centre, and is the scan's first to."""
    off_x = int(x.origin + middle * x.cells) + 0.5 - x.origin
    off_y = int(y.origin + middle * y.cells) + 0.5 - y.origin
    across = off_x * y.cells - off_y * x.cells
    if across**2 > rule.clearing_width**2 * (x.cells**2 + y.cells**2):
        return False
    return _add(index, judged)


class _Axis(NamedTuple):
    """A beam along the x or the y axis."""

    origin: float
    step: int  # from cell to cell, 1 or -1
    side: int  # of a cell, by which the beam leaves it
    cells: float  # per tick
    ticks: float  # per cell; both negative where the step is


@inlined_kernel
def _axis(origin, end):
    extent = end - origin
    ticks = min(_TICKS / abs(extent), _ENDLESS)
    if extent < 0.0:
        return _Axis(origin, -1, 0, extent / _TICKS, -ticks)
    return _Axis(origin, 1, 1, extent / _TICKS, ticks)


@inlined_kernel
def _exit(index, size, axis):
    """The tick at which a beam leaves a cell, or a tile of a size, along one axis."""
    return int(((index + axis.side) * size - axis.origin) * axis.ticks)


@inlined_kernel
def _across(size, axis):
    """The number of ticks from side to side of a cell, or of a tile of a size, along one axis."""
    return int(abs(axis.ticks) * size)


@inlined_kernel
def _entry(index, axis):
    """The tick at which a beam enters a cell along one axis."""
    return _exit(index, 1, axis) - _across(1, axis)


@kernel
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
