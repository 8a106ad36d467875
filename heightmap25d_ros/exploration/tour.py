# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A way through a few places: where to go first, so that most is seen soon.

The shortest way through all of them would begin with what is small and near, and leave for the end
what is worth most. Where each metre is weighed by what is still to come, as in the problem of the
travelling repairman, small things are left that cost a long way at the end. So a metre counts half
for itself, and half for what is still to come.

Exact, by dynamic programming over the sets of places that were visited (Held and Karp, 1962).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.kernels import kernel

MOST = 10
"""Places of a tour: the work doubles with each."""


def soonest_tour(first: Array, between: Array, worth: Array) -> list[int]:
    """The order in which places are visited so that the way is short and most of it comes soon.

    Least is the sum of the whole way and of the mean way to a place, weighed by what it is worth.

    Parameters
    ----------
    first : (N,) float64 [m]
        Of the ways from the robot, N at most `MOST`.
    between : (N, N) float64 [m]
    worth : (N,) float64
        Positive.

    Raises
    ------
    ValueError
        If there are more places.

    Examples
    --------
    >>> at = np.array([1.0, -1.5, 4.0])
    >>> soonest_tour(np.abs(at), np.abs(at[:, None] - at), np.ones(3))
    [1, 0, 2]
    >>> soonest_tour(np.abs(at), np.abs(at[:, None] - at), np.array([1.0, 1.0, 50.0]))
    [0, 2, 1]
    """
    if len(first) > MOST:
        raise ValueError(f"{len(first)} places are more than {MOST}")
    if not len(first):
        return []
    visited = np.arange(1 << len(first))[:, None] >> np.arange(len(first)) & 1
    left = 1.0 + (1 - visited) @ (np.asarray(worth, np.float64) / np.sum(worth))
    order = _soonest(np.asarray(first, np.float64), np.asarray(between, np.float64), left)
    return [int(place) for place in order]


@kernel
def _soonest(first, between, left):
    """The order, by what a metre weighs when each set of places has been visited."""
    count, sets = len(first), len(left)
    # The least weighed way through a set to one of its places.
    least = np.full((sets, count), np.inf)
    before = np.full((sets, count), -1)
    for place in range(count):
        least[1 << place, place] = first[place] * left[0]
    for visited in range(sets):
        for last in range(count):
            so_far = least[visited, last]
            if not so_far < np.inf:
                continue
            for place in range(count):
                if visited >> place & 1:
                    continue
                there = visited | 1 << place
                total = so_far + between[last, place] * left[visited]
                if total < least[there, place]:
                    least[there, place], before[there, place] = total, last
    visited = sets - 1
    last = int(least[visited].argmin())
    order = np.empty(count, np.int64)
    for n in range(count - 1, -1, -1):
        order[n] = last
        visited, last = visited ^ 1 << last, before[visited, last]
    return order


def least_between(costs: Array, places: NDArray[np.float64]) -> Array:
    """(N, N) [m]: what the ways between places are at the least.

    Parameters
    ----------
    costs : (N,) float64 [m]
        Of the ways from the robot: by two of them there is a way from place to place, and so they
        differ by its length at the most.
    places : (N, D) float64 [m]
    """
    straight = np.linalg.norm(places[:, None] - places, axis=2)
    return np.asarray(np.maximum(straight, np.abs(costs[:, None] - costs)))
