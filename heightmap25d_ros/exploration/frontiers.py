# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which unknown cells matter, and from which cells the robot can look at them.

A frontier is where free cells that the robot can come to border on unknown ones. What matters of
the unknown is what lies a short way behind a frontier: the robot might drive there. The rest of it
is inside of walls, or behind them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.kernels import kernel
from heightmap25d_ros.terrain.steps import NEIGHBOURS

_SIDES = NEIGHBOURS[::2]
"""(dy, dx) of the cells that share a side with one."""

_CROSS = ndimage.generate_binary_structure(2, 1)

_RIM = 3
"""Width of the ground that is only too near to the unknown [cells]."""

Mask = NDArray[np.bool_]


def touched(known: Mask, occupied: Mask, reachable: Mask, radius: float) -> Mask:
    """(rows, columns): the free cells that the robot touches, which border on what it can look at.

    Parameters
    ----------
    known, occupied : (rows, columns) bool
    reachable : (rows, columns) bool
        Cells at which the robot's centre may be.
    radius : float [cells]
        Of the robot: so far beside reachable cells it touches free ones.
    """
    free = known & ~occupied
    return _spread(reachable & free, math.ceil(radius), free)


def wanted(
    known: Mask,
    touched: Mask,
    allowed: Mask,
    depth: float,
    height: NDArray[np.float32] | None = None,
) -> Mask:
    """(rows, columns): the unknown cells that matter.

    Those not farther than the depth behind a frontier, on a path over cells that are not occupied.

    Parameters
    ----------
    known : (rows, columns) bool
    touched : (rows, columns) bool
        As of the function of this name.
    allowed : (rows, columns) bool
        Unknown cells elsewhere are not wanted.
    depth : float [cells]
    height : (rows, columns) float32 [m], optional
        In the cells that matter it becomes that of the frontier before them, in place.

    Examples
    --------
    Beyond a door in a wall; behind the wall nothing is wanted:

    >>> known = np.array([[True, True, False, False], [True, True, False, False]])
    >>> occupied = np.array([[False, False, False, False], [False, True, False, False]])
    >>> beside = touched(known, occupied, known & ~occupied, radius=0.0)
    >>> wanted(known, beside, ~occupied, depth=1.0)
    array([[False, False,  True, False],
           [False, False, False, False]])
    """
    unknown = ~known & allowed
    return _spread(touched, math.ceil(depth), unknown, height) & unknown


def openings(occupied: Mask, reachable: Mask, allowed: Mask, radius: float, least: int) -> Mask:
    """Where the robot might come to much new ground, if the unknown were free.

    A door is narrow: the unknown that it shows is small, what is behind it may not be.

    Parameters
    ----------
    occupied, reachable : (rows, columns) bool
        As of `touched`.
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
    new = ground & ~ndimage.binary_dilation(reachable, _CROSS, iterations=_RIM)
    parts, _ = ndimage.label(new)
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    large = sizes[parts] >= least
    return np.asarray(ndimage.binary_dilation(large, _CROSS, iterations=math.ceil(radius) + _RIM))


def _spread(
    mask: Mask, cells: int, within: Mask, carried: NDArray[np.float32] | None = None
) -> Mask:
    """A mask grown by so many steps over the sides of cells, within another one.

    Values (rows, columns) are carried along, in place.
    """
    steps, added = _grown(mask, cells, within)
    if carried is not None:
        _carry(mask, added, carried)
    return np.asarray(steps.view(np.bool_))


@kernel
def _grown(mask, cells, within):
    """As `_spread`, as uint8, and the added cells in their order.

    By breadth first, so that only what is added takes time.
    """
    rows, columns = mask.shape
    steps = np.zeros((rows, columns), np.uint8)  # 1: in the mask or added, 0: neither
    queue = np.empty((mask.size, 2), np.int32)
    end = 0
    for y in range(rows):
        for x in range(columns):
            if within[y, x] and not mask[y, x] and cells > 0 and _is_beside(mask, y, x):
                queue[end] = y, x
                end += 1
            steps[y, x] = mask[y, x]
    for n in range(end):
        steps[queue[n, 0], queue[n, 1]] = 1
    begin = 0
    for _ in range(cells - 1):
        last = end
        for n in range(begin, last):
            y, x = queue[n]
            for dy, dx in _SIDES:
                iy, ix = y + dy, x + dx
                if not (0 <= iy < rows and 0 <= ix < columns):
                    continue
                if within[iy, ix] and steps[iy, ix] == 0:
                    steps[iy, ix] = 1
                    queue[end] = iy, ix
                    end += 1
        begin = last
    return steps, queue[:end].copy()


@kernel
def _carry(mask, added, values):
    """Give each added cell the value of one beside it that is in the mask, or was added before."""
    rows, columns = mask.shape
    has_value = mask.copy()
    for n in range(len(added)):
        y, x = added[n]
        for dy, dx in _SIDES:
            iy, ix = y + dy, x + dx
            if 0 <= iy < rows and 0 <= ix < columns and has_value[iy, ix]:
                values[y, x] = values[iy, ix]
                break
        has_value[y, x] = True


@kernel
def _is_beside(mask, y, x):
    rows, columns = mask.shape
    for dy, dx in _SIDES:
        iy, ix = y + dy, x + dx
        if 0 <= iy < rows and 0 <= ix < columns and mask[iy, ix]:
            return True
    return False


def viewpoints(costs: NDArray[np.float64], spacing: int) -> NDArray[np.int64]:
    """(N, 2): the cells of a lattice at which the robot's centre may be.

    Parameters
    ----------
    costs : (rows, columns) float64
        Of the ways there: not finite where there is none.
    spacing : int [cells]
        Of the lattice, which begins with the first row and column.
    """
    return np.argwhere(np.isfinite(costs[::spacing, ::spacing])) * spacing
