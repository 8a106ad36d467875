# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which unknown cells matter, and from which cells the robot can look at them.

A frontier is where free cells that the robot can come to border on unknown ones. What matters of
the unknown is what lies a short way behind a frontier: the robot might drive there. The rest of it
is inside of walls, or behind them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.grid.height_map import Cell
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.level_graph import LevelGraph, Place
from heightmap25d_ros.planning.search import STRAIGHT, cost_to_go, to_cell
from heightmap25d_ros.planning.start_clearing import ClearedStart

_SIDES = ndimage.generate_binary_structure(2, 1)

_RIM = 3
"""Width of the ground that is only too near to the unknown [cells]."""

Mask = NDArray[np.bool_]


def travel_costs(cleared: ClearedStart, start: Cell) -> NDArray[np.float64]:
    """(rows, columns) [cells of flat ground]: cost between the robot and each cell; inf: no path.

    Costs are those of the way back to the robot: on slopes those of the way there differ a little,
    where one of the two exists so does the other.

    Parameters
    ----------
    cleared : ClearedStart
        The map in which the robot can leave from where it stands.
    start : (row, column)
        Of the robot.
    """
    graph = cleared.graph

    def search(cell: Cell) -> NDArray[np.int32]:
        return cost_to_go(graph.incoming, cell).dense()[None]

    return np.asarray(_costs_from(cleared, Place(0, start), search, 1)[0])


def travel_costs_over_levels(
    levels: LevelGraph, graphs: Sequence[TransitionGraph], cleared: ClearedStart, start: Place
) -> NDArray[np.float64]:
    """(slices, rows, columns): as `travel_costs`, over all slices of a map with several levels.

    Parameters
    ----------
    levels : LevelGraph
    graphs : sequence of TransitionGraph
        One a slice.
    cleared : ClearedStart
        In the slice of the start.
    start : Place
        Of the robot.
    """
    changed = list(graphs)
    changed[start.slice] = cleared.graph

    def search(cell: Cell) -> NDArray[np.int32]:
        fields = levels.cost_to_go(Place(start.slice, cell), changed, np.inf)
        return np.stack([field.dense() for field in fields])

    return _costs_from(cleared, start, search, len(graphs))


def _costs_from(
    cleared: ClearedStart, start: Place, search: Callable[[Cell], NDArray[np.int32]], slices: int
) -> NDArray[np.float64]:
    """(slices, rows, columns): the least costs of searches from a start, or from its exits."""
    costs = np.full((slices, *cleared.graph.geometry.shape), np.inf)
    if cleared.graph.enterable[start.cell]:
        sources = [(0.0, start.cell)]
    else:
        worth = cleared.costs + cleared.penalties
        sources = [(float(cleared.costs[n]), to_cell(cleared.exits[n])) for n in np.argsort(worth)]
    for cost, cell in sources:
        # From one exit the others that are connected with it are reached as well.
        if cleared.graph.enterable[cell] and np.isinf(costs[(start.slice, *cell)]):
            field = search(cell)
            np.minimum(costs, np.where(field < 0, np.inf, cost + field / STRAIGHT), out=costs)
    return costs


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frontiers:
    """The unknown that matters.

    Attributes
    ----------
    wanted : (rows, columns) bool
        Unknown cells not farther than the depth behind a frontier, on a path over cells that are
        not occupied.
    border : (rows, columns) bool
        Those of them that border on free cells which the robot can touch.
    """

    wanted: Mask
    border: Mask


def find(
    known: Mask, occupied: Mask, reachable: Mask, allowed: Mask, radius: float, depth: float
) -> Frontiers:
    """The frontiers of a map.

    Parameters
    ----------
    known, occupied : (rows, columns) bool
    reachable : (rows, columns) bool
        Cells at which the robot's centre may be.
    allowed : (rows, columns) bool
        Unknown cells elsewhere are not wanted.
    radius : float [cells]
        Of the robot: so far beside reachable cells it touches free ones.
    depth : float [cells]

    Examples
    --------
    Beyond a door in a wall; behind the wall nothing is wanted:

    >>> known = np.array([[True, True, False, False], [True, True, False, False]])
    >>> occupied = np.array([[False, False, False, False], [False, True, False, False]])
    >>> find(known, occupied, known & ~occupied, ~occupied, radius=0.0, depth=1.0).wanted
    array([[False, False,  True, False],
           [False, False, False, False]])
    """
    free = known & ~occupied
    touched = _spread(reachable & free, math.ceil(radius), free)
    unknown = ~known & allowed
    wanted = _spread(touched, math.ceil(depth), touched | unknown) & unknown
    border = ndimage.binary_dilation(touched, _SIDES) & wanted
    return Frontiers(wanted=np.asarray(wanted), border=np.asarray(border))


def openings(occupied: Mask, reachable: Mask, allowed: Mask, radius: float, least: int) -> Mask:
    """Where the robot might come to much new ground, if the unknown were free.

    A door is narrow: the unknown that it shows is small, what is behind it may not be.

    Parameters
    ----------
    occupied, reachable : (rows, columns) bool
        As of `find`.
    allowed : (rows, columns) bool
        Cells elsewhere are not passed.
    radius : float [cells]
        Of the robot.
    least : int [cells]
        Of a part of the new ground.

    Returns
    -------
    (rows, columns) bool
        The new ground, and what the robot touches there.

    Examples
    --------
    >>> occupied = np.array([[False, False, True, False, False, False]])
    >>> reachable = np.array([[True, True, False, False, False, False]])
    >>> openings(occupied, reachable, ~occupied, radius=0.0, least=1).any()
    np.False_
    >>> openings(occupied & False, reachable, occupied | True, radius=0.0, least=1).any()
    np.True_
    """
    if not reachable.any():
        return np.zeros_like(reachable)
    clear = ndimage.distance_transform_edt(~np.pad(occupied, 1))[1:-1, 1:-1] > radius
    passable = (clear & allowed) | reachable
    parts, _ = ndimage.label(passable)
    ground = passable & np.isin(parts, np.unique(parts[reachable]))
    # Beside the reachable ground lies a rim that is only too near to the unknown.
    new = ground & ~ndimage.binary_dilation(reachable, _SIDES, iterations=_RIM)
    parts, _ = ndimage.label(new)
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    large = sizes[parts] >= least
    return np.asarray(ndimage.binary_dilation(large, _SIDES, iterations=math.ceil(radius) + _RIM))


def _spread(mask: Mask, cells: int, within: Mask) -> Mask:
    """A mask grown by so many steps over the sides of cells, within another one."""
    if cells == 0 or not mask.any():
        return mask
    return np.asarray(ndimage.binary_dilation(mask, _SIDES, iterations=cells, mask=within))


def viewpoints(reachable: Mask, spacing: int) -> NDArray[np.int64]:
    """(N, 2): the cells of a lattice at which the robot's centre may be.

    Parameters
    ----------
    reachable : (rows, columns) bool
    spacing : int [cells]
        Of the lattice, which begins with the first row and column.
    """
    return np.argwhere(reachable[::spacing, ::spacing]) * spacing


def count_around(mask: Mask, cells: NDArray[np.int64], reach: int) -> NDArray[np.int64]:
    """(N,): how many cells of a mask are within a square around each cell (N, 2)."""
    rows, columns = mask.shape
    sums = np.zeros((rows + 1, columns + 1), np.int32)
    np.cumsum(mask, axis=1, dtype=np.int32, out=sums[1:, 1:])
    for row in range(1, rows):  # in the order of memory, which numpy's own sum of rows is not
        sums[row + 1] += sums[row]
    low = np.clip(cells - reach, 0, (rows, columns))
    high = np.clip(cells + reach + 1, 0, (rows, columns))
    return np.asarray(
        sums[high[:, 0], high[:, 1]]
        - sums[low[:, 0], high[:, 1]]
        - sums[high[:, 0], low[:, 1]]
        + sums[low[:, 0], low[:, 1]],
        np.int64,
    )
