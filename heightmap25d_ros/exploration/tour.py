# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The shortest way through a few places: where to go first, if all are to be visited.

Exact, by dynamic programming over the sets of places that were visited (Held and Karp, 1962).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.kernels import kernel

MOST = 10
"""Places of a tour: the work doubles with each."""


def shortest_tour(first: Array, between: Array) -> list[int]:
    """The order of the shortest way from the robot through all places; it ends at the last one.

    Parameters
    ----------
    first : (N,) float64 [m]
        Of the ways from the robot, N at most `MOST`.
    between : (N, N) float64 [m]

    Raises
    ------
    ValueError
        If there are more places.

    Examples
    --------
    >>> at = np.array([1.0, -1.5, 4.0])
    >>> shortest_tour(np.abs(at), np.abs(at[:, None] - at))
    [1, 0, 2]
    """
    if len(first) > MOST:
        raise ValueError(f"{len(first)} places are more than {MOST}")
    if not len(first):
        return []
    order = _shortest(np.asarray(first, np.float64), np.asarray(between, np.float64))
    return [int(place) for place in order]


@kernel
def _shortest(first, between):
    count = len(first)
    sets = 1 << count
    # Length of the shortest way from the robot through a set of places that ends at one of them.
    length = np.full((sets, count), np.inf)
    before = np.full((sets, count), -1)
    for place in range(count):
        length[1 << place, place] = first[place]
    for visited in range(sets):
        for last in range(count):
            so_far = length[visited, last]
            if not so_far < np.inf:
                continue
            for place in range(count):
                if visited >> place & 1:
                    continue
                there, total = visited | 1 << place, so_far + between[last, place]
                if total < length[there, place]:
                    length[there, place], before[there, place] = total, last
    visited = sets - 1
    last = int(length[visited].argmin())
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
