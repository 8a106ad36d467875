# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every place of a map at which points can match, found by bounds: none is left out.

A *node* is a yaw and a square of 2^l cells in which the robot stands. Its bound is a lower bound
of the score (`matching.match`) at every position in it with the error of z that the ground of the
map allows: each point is compared with all that its window (`height_pyramid`) holds, and takes what
is cheapest. Nodes whose bound is above a limit are dropped with all that they contain, others are
divided in four, down to single cells, the *leaves*.

The score is a mean over the points that count. It is at most a limit if the sum of the costs is,
with the limit as the cost of every point that does not count; of those over half of the points
each costs as over an unknown cell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION
from heightmap25d_ros.kernels import inlined_kernel, kernel
from heightmap25d_ros.localization.height_pyramid import (
    ANYWHERE,
    BEYOND,
    EDGE,
    KNOWN,
    LEVELS,
    NEAR_KNOWN,
    NOTHING,
    HeightPyramid,
)
from heightmap25d_ros.localization.matching import Cost, RegistrationPoints

SLACK = 0.1
"""Largest difference [m] between the ground of the map and that under the robot."""

ROOT: int = 2 ** (LEVELS - 1)
"""Side [cells] of the squares with which a search begins (`sweep`)."""

_EDGES = 16  # to be added to the flags of a window for an edge
_SLICES = 3  # of the error of z, of the smallest nodes
_SLICED = 1  # highest level of these
_STACK = 4 * LEVELS


class Turned(NamedTuple):
    """Points turned by all yaws of a search, for the kernels.

    Attributes
    ----------
    rows, columns : (W, N) int32 [cells]
        From the robot's cell to where the windows of the points begin.
    heights : (N,) float32 [cm]
        Above the ground under the robot.
    kind : (N,) uint8
        16 for edges, 0 for others.
    weight : (N,) float32
        Their sum is 1.
    """

    rows: NDArray[np.int32]
    columns: NDArray[np.int32]
    heights: NDArray[np.float32]
    kind: NDArray[np.uint8]
    weight: NDArray[np.float32]


class Ground(NamedTuple):
    """What the kernels know of the map and of z.

    Attributes
    ----------
    windows, levels
        `HeightPyramid.windows` and ``ground``.
    pad : int [cells]
    slack : float [cm]
        Infinite where z is unknown: then the robot can stand everywhere.
    clip, unknown : float [cm]
        Highest cost of a point, and its cost over an unknown cell.
    """

    windows: NDArray[np.int16]
    levels: tuple[NDArray[np.int16], ...]
    pad: int
    slack: float
    clip: float
    unknown: float


def turned(
    points: RegistrationPoints, yaws: Array, resolution: float, ground: float | None
) -> Turned:
    """Points turned by yaws (W,), the heaviest first: these decide soonest.

    Parameters
    ----------
    ground : float [m], optional
        z of the ground under the robot, as the points'.
    """
    order = np.argsort(-points.weight, kind="stable")
    x, y, z = points.xyz[order].T
    cos, sin = np.cos(yaws)[:, None] / resolution, np.sin(yaws)[:, None] / resolution
    weight = points.weight[order]
    return Turned(
        rows=np.floor(sin * x + cos * y - 0.5).astype(np.int32),
        columns=np.floor(cos * x - sin * y - 0.5).astype(np.int32),
        heights=((z - (ground or 0.0)) / HEIGHT_RESOLUTION).astype(np.float32),
        kind=np.where(points.is_edge[order], _EDGES, 0).astype(np.uint8),
        weight=(weight / weight.sum()).astype(np.float32),
    )


def ground_of(pyramid: HeightPyramid, cost: Cost, *, is_z_known: bool) -> Ground:
    """The map for the kernels."""
    clip = cost.clip / HEIGHT_RESOLUTION
    slack = SLACK / HEIGHT_RESOLUTION if is_z_known else np.inf
    return Ground(pyramid.windows, pyramid.ground, pyramid.pad, slack, clip, cost.unknown * clip)


def bounds(seen: Turned, nodes: NDArray[np.int32], ground: Ground, limit: float) -> Array:
    """Bounds (K,) [m] of nodes: where a pose scores at most the limit, the bound is at most it.

    A bound above the limit is not summed to its end.

    Parameters
    ----------
    nodes : (K, 4) int32
        Yaw, level, row and column of the first cell.
    limit : float [m]
        At most the cost of an unknown cell.
    """
    found = np.empty(len(nodes))
    _bounds(*seen, nodes, ground, limit / HEIGHT_RESOLUTION, found)
    return found * HEIGHT_RESOLUTION


class Descent:
    """Divides nodes until all leaves within a limit are found, in pieces of some nodes.

    Parameters
    ----------
    seen : Turned
    ground : Ground
    within : (row, column, radius) [cells]
        A circle outside of which no leaf is wanted.
    room : int
        Number of leaves that are kept.

    Attributes
    ----------
    nodes : int
        Number of bounds so far.
    """

    def __init__(
        self,
        seen: Turned,
        ground: Ground,
        within: tuple[float, float, float],
        room: int,
    ) -> None:
        self.nodes = 0
        self._seen, self._ground, self._within = seen, ground, within
        self._roots = np.empty((0, 4), np.int32)
        self._leaves = np.empty((room, 4), np.int32)
        self._stack = np.empty((_STACK, 4), np.int32)
        self._root = self._waiting = self._found = 0

    def begin(self, roots: NDArray[np.int32]) -> None:
        """Go on with other nodes (K, 4) of the highest level, when all before are divided."""
        self._roots, self._root = roots, 0

    @property
    def leaves(self) -> NDArray[np.int32]:
        """Leaves (K, 4) found so far."""
        return self._leaves[: self._found]

    @property
    def is_done(self) -> bool:
        """Whether all nodes are divided."""
        return self._root == len(self._roots) and self._waiting == 0

    @property
    def is_full(self) -> bool:
        """Whether there is no room for four more leaves."""
        return self._found > len(self._leaves) - 4

    def divide(self, limit: float, nodes: int) -> None:
        """Divide until a number of nodes is bounded, or all are, or there is no room."""
        self._root, self._waiting, self._found, bounded = _divide(
            *self._seen, self._roots, self._ground, self._within, limit / HEIGHT_RESOLUTION, nodes,
            self._root, self._waiting, self._found, self._stack, self._leaves,
        )  # fmt: skip
        self.nodes += bounded

    def keep(self, limit: float) -> None:
        """Drop the leaves above a limit that is lower than before."""
        is_kept = bounds(self._seen, self.leaves, self._ground, limit) <= limit
        kept = self.leaves[is_kept]
        self._leaves[: len(kept)] = kept
        self._found = len(kept)


@kernel
def caps_of(clip, unknown, limit):
    """Highest cost (32,) by the flags of a window, for edges from 16 on; whether none can count."""
    caps, is_uncounted = np.full(32, np.inf, np.float32), np.zeros(32, np.float32)
    for index in range(32):
        flags, is_edge = index % 16, index >= _EDGES
        counts_unknown = is_edge and flags & NEAR_KNOWN
        if flags & KNOWN:
            caps[index] = clip
        if counts_unknown:
            caps[index] = min(caps[index], unknown)
        if flags & BEYOND or (flags & NEAR_KNOWN and not is_edge):
            caps[index] = min(caps[index], limit)
        if is_edge and flags & EDGE:
            caps[index] = 0.0
        is_uncounted[index] = 0.0 if flags & KNOWN or counts_unknown else 1.0
    return caps, is_uncounted


@inlined_kernel
def _sum(  # noqa: PLR0913
    rows, columns, heights, kind, weight, windows, w, level, y, x, low, high, caps, is_uncounted,
    limit, excess,
):  # fmt: skip
    """Sum of the least costs; what is above the limit is not summed to its end."""
    total = uncounted = np.float32(0.0)
    for i in range(len(heights)):
        iy, ix = y + rows[w, i], x + columns[w, i]
        if 0 <= iy < windows.shape[1] and 0 <= ix < windows.shape[2]:
            index = np.uint32(windows[level, iy, ix, 2] + kind[i])
            above = np.float32(windows[level, iy, ix, 0]) - (heights[i] + high)
            below = (heights[i] + low) - np.float32(windows[level, iy, ix, 1])
            cost = min(max(above, below, np.float32(0.0)), caps[index])
            uncounted += weight[i] * is_uncounted[index]
        else:
            cost = limit
            uncounted += weight[i]
        total += weight[i] * cost
        if total > limit:
            break
    return total + max(uncounted - np.float32(0.5), np.float32(0.0)) * excess


@inlined_kernel
def _bound(  # noqa: PLR0913
    rows, columns, heights, kind, weight, node, ground, limit, caps, is_uncounted,
):  # fmt: skip
    """Bound of a node; infinite where the robot cannot stand."""
    windows, levels, pad, slack, _, unknown = ground
    w, level, y, x = node
    low, high, slices = -ANYWHERE, ANYWHERE, 1
    if slack < np.inf:
        there = levels[level]
        lowest = there[y >> level, x >> level, 0]
        if lowest == NOTHING:
            return np.inf
        low, high = lowest - slack, there[y >> level, x >> level, 1] + slack
        slices = _SLICES if level <= _SLICED else 1
    excess = np.float32(unknown - limit)
    least = np.inf
    # First the whole range of z: that drops most nodes, and the slices are three times the work.
    for k in range(-1, slices if slices > 1 else 0):
        part = np.float32((high - low) / (slices if k >= 0 else 1))
        bottom = np.float32(low) + np.float32(max(k, 0)) * part
        total = _sum(
            rows, columns, heights, kind, weight, windows, w, level, y + pad, x + pad,
            bottom, bottom + part, caps, is_uncounted, np.float32(limit), excess,
        )  # fmt: skip
        if k >= 0:
            least = min(least, total)
        elif total > limit or slices == 1:
            return total
    return least


@kernel
def _bounds(  # noqa: PLR0913
    rows, columns, heights, kind, weight, nodes, ground, limit, found,
):  # fmt: skip
    caps, is_uncounted = caps_of(ground[4], ground[5], limit)
    for k in range(len(nodes)):
        node = (nodes[k, 0], nodes[k, 1], nodes[k, 2], nodes[k, 3])
        found[k] = _bound(
            rows, columns, heights, kind, weight, node, ground, limit, caps, is_uncounted
        )


@inlined_kernel
def _child(node, quarter, shape):
    """A quarter of a node, and whether it begins inside the map."""
    half = 1 << (node[1] - 1)
    y, x = node[2] + half * (quarter // 2), node[3] + half * (quarter % 2)
    return (node[0], node[1] - 1, y, x), y < shape[0] and x < shape[1]


@kernel
def _divide(  # noqa: PLR0913
    rows, columns, heights, kind, weight, roots, ground, within, limit, nodes, root, waiting,
    found, stack, leaves,
):  # fmt: skip
    """Go on with a search; returns the next root, lengths of stack and leaves, nodes bounded."""
    shape = ground[1][0].shape
    middle_y, middle_x, radius = within
    caps, is_uncounted = caps_of(ground[4], ground[5], limit)
    bounded = 0
    while bounded < nodes and found <= len(leaves) - 4:
        if waiting == 0:
            if root == len(roots):
                break
            node = (roots[root, 0], roots[root, 1], roots[root, 2], roots[root, 3])
            root += 1
        else:
            waiting -= 1
            node = (stack[waiting, 0], stack[waiting, 1], stack[waiting, 2], stack[waiting, 3])
        for quarter in range(4):
            child, is_inside = _child(node, quarter, shape)
            if not is_inside:
                continue
            bounded += 1
            if (
                _bound(
                    rows, columns, heights, kind, weight, child, ground, limit, caps, is_uncounted
                )
                > limit
            ):
                continue
            if child[1] > 0:
                stack[waiting, 0], stack[waiting, 1], stack[waiting, 2], stack[waiting, 3] = child
                waiting += 1
            elif np.hypot(child[2] + 0.5 - middle_y, child[3] + 0.5 - middle_x) <= radius:
                leaves[found, 0], leaves[found, 1], leaves[found, 2], leaves[found, 3] = child
                found += 1
    return root, waiting, found, bounded
