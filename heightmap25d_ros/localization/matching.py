# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The score of a hypothesis: how well the points of a short-term map lie on a long-term map.

A hypothesis (x, y, yaw) turns the points about a pivot by the yaw and shifts them. Its score is
the mean cost of the points in metres; lower is better:

- The error of z is eliminated first: the median of the differences in height is subtracted.
- The rest of a point's difference is its cost, up to ``clip``.
- Two *edges* (`surface`) over each other cost nothing: only their positions can be compared.
- An edge over an unknown cell costs the share ``unknown`` of ``clip``, so that a world of one
  height, as a level laser alone sees it, is matched by the positions of its objects. Points beyond
  the map are not counted, neither edges farther than `surface.NEAR` cells from known ones nor other
  points over unknown cells: a robot that sees farther than the map reaches must not be drawn back
  into it. At least half of the points are counted, the missing ones as points over unknown cells,
  so that no hypothesis wins by having little to compare.

The paper's score, the sum of the absolute differences over cells that are valid in both maps, is
this one without clip, edges, unknown cells, elimination of z and mean.

`match` scores one hypothesis with sub-cell accuracy, `search` many in steps of whole cells, and
`descend` follows the score to its minimum.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.kernels import inlined_kernel, kernel
from heightmap25d_ros.localization.surface import BORDER, Surface

_BINS = 256  # of the differences in height, for their median
_LEAST_GAIN = 1e-9  # [m] of score
_MOST_MOVES = 40  # of a descent with one step
_LEAST_COUNTED = 0.5  # share of the points, the missing ones as points over unknown cells


class RegistrationPoints(NamedTuple):
    """Known cells of a short-term map, relative to the pivot.

    Attributes
    ----------
    xyz : (N, 3) float64 [m]
        x and y relative to the pivot, along the axes of the map; z in the map.
    is_edge : (N,) bool
    weight : (N,) float64
        Of each point in the score.
    pivot : (2,) float [m], map
        What a hypothesis turns the points about: the robot at the prior pose.
    """

    xyz: NDArray[np.float64]
    is_edge: NDArray[np.bool_]
    weight: NDArray[np.float64]
    pivot: tuple[float, float] = (0.0, 0.0)

    def some(self, index: NDArray[np.int64]) -> RegistrationPoints:
        """The points of an index."""
        return RegistrationPoints(
            self.xyz[index], self.is_edge[index], self.weight[index], self.pivot
        )

    @property
    def arrays(self) -> tuple[Array, NDArray[np.bool_], Array]:
        """The points without the pivot, as the kernels take them."""
        return self.xyz, self.is_edge, self.weight


class Cost(NamedTuple):
    """Parameters of the cost of a difference in height.

    Attributes
    ----------
    clip : float [m]
        Highest cost of a point.
    unknown : float
        Cost of a point over an unknown cell, as a share of ``clip``.
    z_range : float [m]
        Largest error of z, up and down.
    """

    clip: float
    unknown: float
    z_range: float


class Window(NamedTuple):
    """Hypotheses of a search: all combinations of these.

    Attributes
    ----------
    x, y : (X,), (Y,) int64 [cells]
    yaw : (W,) float64 [rad]
    """

    x: NDArray[Any]
    y: NDArray[Any]
    yaw: NDArray[np.float64]


class Match(NamedTuple):
    """The score of a hypothesis, and what it consists of.

    Attributes
    ----------
    score : float [m]
    z : float [m]
        To be added to the points' heights.
    known : float
        Share of the points, by weight, that lie over known cells.
    overlap : float
        That share of the points at places that the map covers, within `surface.NEAR` cells of known
        ones; at least half of all points are taken for such.
    residual : float [m]
        Mean cost of these.
    """

    score: float
    z: float
    known: float
    overlap: float
    residual: float


def match(
    points: RegistrationPoints,
    hypothesis: NDArray[np.float64],
    surface: Surface,
    cost: Cost,
) -> Match:
    """Score of a hypothesis, with sub-cell accuracy.

    The cost of a point is interpolated between the four cells around it.

    Parameters
    ----------
    points : RegistrationPoints
    hypothesis : (3,) float64 [m, m, rad]
        x, y, yaw.
    surface : Surface
    cost : Cost
    """
    x, y, yaw = hypothesis
    counts = np.zeros(_BINS, np.int64)
    return Match(
        *_match(*points.arrays, x, y, yaw, _cells(surface, points.pivot), tuple(cost), counts)
    )


def scores_at(
    points: RegistrationPoints,
    hypotheses: NDArray[np.float64],
    surface: Surface,
    cost: Cost,
) -> NDArray[np.float64]:
    """Scores (K,) [m] of hypotheses, as of `match`.

    Parameters
    ----------
    hypotheses : (K, 4) float64 [m, m, rad, m]
        x, y, yaw, and z that is added to the points' heights.
    """
    scores = np.empty(len(hypotheses))
    _scores_at(*points.arrays, hypotheses, _cells(surface, points.pivot), tuple(cost), scores)
    return scores


def search(
    points: RegistrationPoints,
    window: Window,
    surface: Surface,
    cost: Cost,
) -> NDArray[np.float64]:
    """Scores of all hypotheses of a window; the cost of a point is that of its own cell.

    Parameters
    ----------
    window : Window

    Returns
    -------
    (W, Y, X) float64 [m]
    """
    scores = np.empty((len(window.yaw), len(window.y), len(window.x)))
    _search(*points.arrays, *window, _cells(surface, points.pivot), tuple(cost), scores)
    return scores


def descend(
    points: RegistrationPoints,
    hypothesis: NDArray[np.float64],
    steps: NDArray[np.float64],
    surface: Surface,
    cost: Cost,
) -> NDArray[np.float64]:
    """The hypothesis (3,) at the minimum of the score around another one.

    Parameters
    ----------
    steps : (S, 3) float64 [m, m, rad]
        For each step the best of the 26 neighbours is taken until none is better.
    """
    return np.asarray(
        _descend(*points.arrays, hypothesis, steps, _cells(surface, points.pivot), tuple(cost)),
        np.float64,
    )


def _cells(surface: Surface, pivot: tuple[float, float]) -> tuple[Any, ...]:
    """A surface as plain arrays with a border of unknown cells, and the pivot in its cells.

    Inside the kernels x and y are counted in cells from the corner of the border.
    """
    u, v = (np.asarray(pivot) - surface.origin) / surface.resolution + BORDER
    return (
        *surface.bordered,
        float(u),
        float(v),
        1.0 / surface.resolution,
    )


@inlined_kernel
def _inside(cell, count):
    """A row or a column, clamped to the border."""
    return min(max(cell, 0), count - 1)


@inlined_kernel
def _cost_of(height, is_edge, top, is_edge_too, clip):
    return 0.0 if is_edge and is_edge_too else min(abs(height - top), clip)


@inlined_kernel
def _z_error(  # noqa: PLR0913
    columns, rows, shift_x, shift_y, xyz, edge, heights, edges, z_range, counts,
):  # fmt: skip
    """Error of z over cells (N,): the median of the differences, by a histogram.

    Edges are excluded, unless fewer than a tenth of the points remain.
    """
    per_bin = _BINS / (2 * z_range)
    counted = 0
    for with_edges in range(2):
        counts[:] = 0
        counted = 0
        for i in range(len(rows)):
            iy = _inside(rows[i] + shift_y, heights.shape[0])
            ix = _inside(columns[i] + shift_x, heights.shape[1])
            k = (heights[iy, ix] - xyz[i, 2] + z_range) * per_bin
            # Unknown heights are NaN, which is never within.
            if 0.0 <= k < _BINS and (with_edges or not (edge[i] or edges[iy, ix])):
                counts[int(k)] += 1
                counted += 1
        if 10 * counted >= len(rows):
            break
    half, below, k = (counted + 1) // 2, 0, 0
    while k < _BINS - 1 and below + counts[k] < half:
        below += counts[k]
        k += 1
    part = (half - below - 0.5) / max(counts[k], 1)
    return (k + part) * (2 * z_range / _BINS) - z_range if counted else 0.0


@inlined_kernel
def _positions(  # noqa: PLR0913
    xyz, yaw, u0, v0, per_metre, u, v, columns, rows,
):  # fmt: skip
    """Positions [cells] of points turned by a yaw."""
    cos, sin = np.cos(yaw) * per_metre, np.sin(yaw) * per_metre
    for i in range(len(xyz)):
        u[i] = u0 + cos * xyz[i, 0] - sin * xyz[i, 1]
        v[i] = v0 + sin * xyz[i, 0] + cos * xyz[i, 1]
        columns[i], rows[i] = int(np.floor(u[i])), int(np.floor(v[i]))


@kernel
def _match(  # noqa: PLR0913
    xyz, edge, weight, x, y, yaw, cells, cost, counts,
):  # fmt: skip
    """`Match` of a hypothesis."""
    heights, edges, counts_there, u0, v0, per_metre = cells
    clip, unknown, z_range = cost
    u, v = np.empty(len(xyz)), np.empty(len(xyz))
    columns, rows = np.empty(len(xyz), np.int64), np.empty(len(xyz), np.int64)
    _positions(xyz, yaw, u0 + x * per_metre, v0 + y * per_metre, per_metre, u, v, columns, rows)
    z = _z_error(columns, rows, 0, 0, xyz, edge, heights, edges, z_range, counts)
    over_known = known = counted = covered = weights = 0.0
    for i in range(len(xyz)):
        left, low = np.floor(u[i] - 0.5), np.floor(v[i] - 0.5)
        a, b = u[i] - 0.5 - left, v[i] - 0.5 - low
        weights += weight[i]
        for oy in range(2):
            iy = _inside(int(low) + oy, heights.shape[0])
            for ox in range(2):
                ix = _inside(int(left) + ox, heights.shape[1])
                height = heights[iy, ix]
                share = (a if ox else 1.0 - a) * (b if oy else 1.0 - b) * weight[i]
                if height == height:
                    known += share
                    counted += share
                    over_known += share * _cost_of(
                        height, edges[iy, ix], xyz[i, 2] + z, edge[i], clip
                    )
                elif edge[i] and counts_there[iy, ix]:
                    counted += share
                if counts_there[iy, ix]:
                    covered += share
    least = max(_LEAST_COUNTED * weights, 1e-12)
    counted, covered = max(counted, least), max(covered, least)
    score = (over_known + (counted - known) * unknown * clip) / counted
    return score, z, known / max(weights, 1e-12), known / covered, over_known / max(known, 1e-12)


@kernel
def _scores_at(xyz, edge, weight, hypotheses, cells, cost, scores):
    counts = np.zeros(_BINS, np.int64)
    lifted = xyz.copy()
    for k in range(len(hypotheses)):
        x, y, yaw, z = hypotheses[k]
        lifted[:, 2] = xyz[:, 2] + z
        scores[k] = _match(lifted, edge, weight, x, y, yaw, cells, cost, counts)[0]


@kernel
def _search(  # noqa: PLR0913
    xyz, edge, weight, xs, ys, yaws, cells, cost, scores,
):  # fmt: skip
    """Scores (W, Y, X) of hypotheses in steps of whole cells."""
    heights, edges, counts_there, u0, v0, per_metre = cells
    clip, unknown, z_range = cost
    counts = np.zeros(_BINS, np.int64)
    u, v = np.empty(len(xyz)), np.empty(len(xyz))
    columns, rows = np.empty(len(xyz), np.int64), np.empty(len(xyz), np.int64)
    least = max(_LEAST_COUNTED * weight.sum(), 1e-12)
    for w in range(len(yaws)):
        _positions(xyz, yaws[w], u0, v0, per_metre, u, v, columns, rows)
        for j in range(len(ys)):
            for i in range(len(xs)):
                z = _z_error(
                    columns, rows, xs[i], ys[j], xyz, edge, heights, edges, z_range, counts
                )
                total = known = counted = 0.0
                for k in range(len(rows)):
                    iy = _inside(rows[k] + ys[j], heights.shape[0])
                    ix = _inside(columns[k] + xs[i], heights.shape[1])
                    height = heights[iy, ix]
                    if height == height:
                        known += weight[k]
                        counted += weight[k]
                        total += weight[k] * _cost_of(
                            height, edges[iy, ix], xyz[k, 2] + z, edge[k], clip
                        )
                    elif edge[k] and counts_there[iy, ix]:
                        counted += weight[k]
                counted = max(counted, least)
                scores[w, j, i] = (total + (counted - known) * unknown * clip) / counted


@kernel
def _descend(xyz, edge, weight, hypothesis, steps, cells, cost):
    counts = np.zeros(_BINS, np.int64)
    best = hypothesis.copy()
    score = _match(xyz, edge, weight, best[0], best[1], best[2], cells, cost, counts)[0]
    for s in range(len(steps)):
        for _ in range(_MOST_MOVES):
            start, before = best.copy(), score
            for move in range(27):
                x = start[0] + steps[s, 0] * (move % 3 - 1)
                y = start[1] + steps[s, 1] * (move // 3 % 3 - 1)
                yaw = start[2] + steps[s, 2] * (move // 9 - 1)
                value = _match(xyz, edge, weight, x, y, yaw, cells, cost, counts)[0]
                if value < score - _LEAST_GAIN:
                    score = value
                    best[0], best[1], best[2] = x, y, yaw
            if score == before:
                break
    return best
