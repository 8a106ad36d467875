# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How well the points of a short-term map lie on a long-term map.

A hypothesis (x, y, yaw) turns the points about a pivot by the yaw and shifts them. Its score is
the mean of what the points cost, in metres, the lower the better:

- The error of z is eliminated first: the median of the differences in height is taken out.
- What is left of a point's difference costs, up to ``clip``.
- Two *edges* cost nothing. An edge is a cell that stands above a neighbour or has an unknown
  one: a wall, a post. Lasers see faces, not tops, so the stored height of an edge depends on
  where the robot was, and only its place can be compared.
- A point over an unknown cell costs the part ``unknown`` of ``clip``. So a world of one height,
  as a level laser alone sees it, is matched by where there is something.

The paper's score, the sum of the absolute differences over cells that are valid in both maps, is
this one without clip, edges, unknown cells, elimination of z and mean.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from heightmap25d_ros.grid import HEIGHT_RESOLUTION, HeightMap

_BINS = 256  # of the differences in height, for their median
_LEAST_GAIN = 1e-9  # [m] of score
_MOST_MOVES = 40  # of a descent with one step
_kernel = njit(cache=True, error_model="numpy")
_inlined = njit(cache=True, error_model="numpy", forceinline=True)


class Surface(NamedTuple):
    """A long-term map as the kernels take it.

    Attributes
    ----------
    heights : (rows, columns) float32 [m]
        NaN where unknown.
    is_edge : (rows, columns) bool
    origin : (2,) float [m], map
        The outer corner of cell (0, 0).
    resolution : float [m]
    """

    heights: NDArray[np.float32]
    is_edge: NDArray[np.bool_]
    origin: tuple[float, float]
    resolution: float


class Points(NamedTuple):
    """Places of a short-term map.

    Attributes
    ----------
    xyz : (N, 3) float64 [m]
        x and y seen from the pivot, along the axes of the map; z in the map.
    is_edge : (N,) bool
    weight : (N,) float64
        How much each counts.
    """

    xyz: NDArray[np.float64]
    is_edge: NDArray[np.bool_]
    weight: NDArray[np.float64]

    def some(self, index: NDArray[np.int64]) -> Points:
        """Those of an index."""
        return Points(self.xyz[index], self.is_edge[index], self.weight[index])


class Cost(NamedTuple):
    """What a difference in height costs.

    Attributes
    ----------
    clip : float [m]
        The most that a point costs.
    unknown : float
        Part of it for a point over an unknown cell.
    z_range : float [m]
        Errors of z are looked for up to plus and minus this.
    """

    clip: float
    unknown: float
    z_range: float


class Match(NamedTuple):
    """What a hypothesis is worth.

    Attributes
    ----------
    score : float [m]
    z : float [m]
        To be added to the points' heights.
    overlap : float
        Share of the points, by their weight, that lie over known cells.
    residual : float [m]
        The mean of what these cost.
    """

    score: float
    z: float
    overlap: float
    residual: float


def surface_of(height_map: HeightMap, edge_step: float) -> Surface:
    """The known heights of a map, and its edges."""
    heights = height_map.height.astype(np.float32) * np.float32(HEIGHT_RESOLUTION)
    heights[~height_map.known] = np.nan
    geometry = height_map.geometry
    return Surface(heights, edges(heights, edge_step), geometry.origin, geometry.resolution)


def edges(heights: NDArray[np.float32], step: float) -> NDArray[np.bool_]:
    """Known cells with an unknown one beside them, or above one of eight neighbours by a step."""
    rows, columns = heights.shape
    around = np.pad(heights, 1, constant_values=np.nan)
    is_edge = np.zeros(heights.shape, bool)
    for dy, dx in np.ndindex(3, 3):
        neighbour = around[dy : dy + rows, dx : dx + columns]
        if dy == 1 or dx == 1:
            is_edge |= np.isnan(neighbour)
        is_edge |= heights - neighbour > step
    return np.asarray(is_edge & ~np.isnan(heights))


def coarser(surface: Surface) -> Surface:
    """At half the resolution: the highest of four cells; an edge where one of them is."""
    rows, columns = (-(-side // 2) * 2 for side in surface.heights.shape)
    grow = ((0, rows - surface.heights.shape[0]), (0, columns - surface.heights.shape[1]))
    blocks = (rows // 2, 2, columns // 2, 2)
    heights = np.pad(surface.heights, grow, constant_values=np.nan).reshape(blocks)
    return Surface(
        np.fmax.reduce(np.fmax.reduce(heights, axis=3), axis=1),
        np.pad(surface.is_edge, grow).reshape(blocks).any(axis=(1, 3)),
        surface.origin,
        2 * surface.resolution,
    )


def match(
    points: Points,
    hypothesis: NDArray[np.float64],
    surface: Surface,
    pivot: tuple[float, float],
    cost: Cost,
) -> Match:
    """Score of a hypothesis below the size of a cell: a point costs what the four cells around it
    say, weighted by how near their centres are.

    Parameters
    ----------
    points : Points
    hypothesis : (3,) float64 [m, m, rad]
        x, y, yaw.
    surface : Surface
    pivot : (2,) float [m], map
    cost : Cost
    """  # noqa: D205 - the first sentence takes two lines
    x, y, yaw = hypothesis
    return Match(*_match(points, x, y, yaw, surface, pivot, cost, np.zeros(_BINS, np.int64)))


def search(
    points: Points,
    window: tuple[NDArray[Any], NDArray[Any], NDArray[np.float64]],
    surface: Surface,
    pivot: tuple[float, float],
    cost: Cost,
) -> NDArray[np.float64]:
    """Scores of all hypotheses of a window in steps of whole cells; a point's own cell counts.

    Parameters
    ----------
    window : x (X,) int64, y (Y,) int64, yaw (W,) float64 [cells, cells, rad]
        x and y without gaps.

    Returns
    -------
    (W, Y, X) float64 [m]
    """
    x, y, yaw = window
    scores = np.empty((len(yaw), len(y), len(x)))
    _search(points, x, y, yaw, surface, pivot, cost, scores)
    return scores


def descend(
    points: Points,
    hypothesis: NDArray[np.float64],
    steps: NDArray[np.float64],
    surface: Surface,
    pivot: tuple[float, float],
    cost: Cost,
) -> NDArray[np.float64]:
    """The hypothesis (3,) at the bottom of the basin.

    Parameters
    ----------
    steps : (S, 3) float64 [m, m, rad]
        The 26 neighbours at each step are tried until none is better.
    """
    return _descend(points, hypothesis, steps, surface, pivot, cost)  # type: ignore[no-any-return]


@_inlined
def _height_at(heights, iy, ix):
    if 0 <= iy < heights.shape[0] and 0 <= ix < heights.shape[1]:
        return heights[iy, ix]
    return np.float32(np.nan)


@_inlined
def _median(counts, total, z_range):
    """Median of what was counted in bins over plus and minus a range."""
    half = (total + 1) // 2
    below = 0
    for k in range(_BINS):
        if below + counts[k] >= half:
            part = (half - below - 0.5) / counts[k]
            return (k + part) * (2 * z_range / _BINS) - z_range
        below += counts[k]
    return 0.0


@_inlined
def _cost_of(height, is_edge, top, is_edge_too, clip, unknown):
    difference = abs(height - top)
    if difference != difference:
        return unknown * clip
    if is_edge and is_edge_too:
        return 0.0
    return min(difference, clip)


@_kernel
def _eliminated(columns, rows, points, surface, cost, counts):
    """Error of z over cells (N,).

    Edges are left out, unless there is hardly anything else.
    """
    heights, is_edge = surface.heights, surface.is_edge
    per_bin = _BINS / (2 * cost.z_range)
    for with_edges in range(2):
        counts[:] = 0
        counted = 0
        for i in range(len(rows)):
            iy, ix = rows[i], columns[i]
            difference = _height_at(heights, iy, ix) - points.xyz[i, 2]
            if difference != difference:
                continue
            k = int(np.floor((difference + cost.z_range) * per_bin))
            if 0 <= k < _BINS and (with_edges or not (points.is_edge[i] or is_edge[iy, ix])):
                counts[k] += 1
                counted += 1
        if 10 * counted >= len(rows):
            break
    return _median(counts, counted, cost.z_range) if counted else 0.0


@_kernel
def _match(points, x, y, yaw, surface, pivot, cost, counts):
    """`Match` of a hypothesis."""
    heights, is_edge = surface.heights, surface.is_edge
    u, v = _placed(points, yaw, surface, pivot)
    u += x / surface.resolution
    v += y / surface.resolution
    columns, rows = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    z = _eliminated(columns, rows, points, surface, cost, counts)
    over_known = known = weights = 0.0
    for i in range(len(points.xyz)):
        ix, iy = int(np.floor(u[i] - 0.5)), int(np.floor(v[i] - 0.5))
        a, b = u[i] - 0.5 - ix, v[i] - 0.5 - iy
        top = points.xyz[i, 2] + z
        weights += points.weight[i]
        for oy in range(2):
            for ox in range(2):
                height = _height_at(heights, iy + oy, ix + ox)
                if height == height:
                    edge = is_edge[iy + oy, ix + ox]
                    share = (a if ox else 1.0 - a) * (b if oy else 1.0 - b) * points.weight[i]
                    known += share
                    over_known += share * _cost_of(
                        height, edge, top, points.is_edge[i], cost.clip, cost.unknown
                    )
    total = over_known + (weights - known) * cost.unknown * cost.clip
    weights = max(weights, 1e-12)
    return total / weights, z, known / weights, over_known / max(known, 1e-12)


@_kernel
def _placed(points, yaw, surface, pivot):
    """Where points, turned by a yaw, lie in the surface [cells]."""
    cos, sin = np.cos(yaw) / surface.resolution, np.sin(yaw) / surface.resolution
    px, py = points.xyz[:, 0], points.xyz[:, 1]
    u0 = (pivot[0] - surface.origin[0]) / surface.resolution
    v0 = (pivot[1] - surface.origin[1]) / surface.resolution
    return u0 + cos * px - sin * py, v0 + sin * px + cos * py


@_kernel
def _search(points, xs, ys, yaws, surface, pivot, cost, scores):
    heights, is_edge = surface.heights, surface.is_edge
    counts = np.zeros(_BINS, np.int64)
    weights = max(points.weight.sum(), 1e-12)
    for w in range(len(yaws)):
        u, v = _placed(points, yaws[w], surface, pivot)
        columns, rows = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
        columns += xs[0]
        rows += ys[0]
        for j in range(len(ys)):
            for i in range(len(xs)):
                z = _eliminated(columns, rows, points, surface, cost, counts)
                total = 0.0
                for k in range(len(rows)):
                    iy, ix = rows[k], columns[k]
                    height = _height_at(heights, iy, ix)
                    edge = height == height and is_edge[iy, ix]
                    total += points.weight[k] * _cost_of(
                        height, edge, points.xyz[k, 2] + z, points.is_edge[k],
                        cost.clip, cost.unknown,
                    )  # fmt: skip
                scores[w, j, i] = total / weights
                columns += 1
            columns -= len(xs)
            rows += 1


@_kernel
def _descend(points, hypothesis, steps, surface, pivot, cost):
    counts = np.zeros(_BINS, np.int64)
    best = hypothesis.copy()
    score = _match(points, best[0], best[1], best[2], surface, pivot, cost, counts)[0]
    for step in steps:
        for _ in range(_MOST_MOVES):
            start = best.copy()
            before = score
            for a in range(-1, 2):
                for b in range(-1, 2):
                    for c in range(-1, 2):
                        tried = start + step * np.array([a, b, c])
                        value = _match(
                            points, tried[0], tried[1], tried[2], surface, pivot, cost, counts
                        )[0]
                        if value < score - _LEAST_GAIN:
                            score = value
                            best = tried
            if score == before:
                break
    return best
