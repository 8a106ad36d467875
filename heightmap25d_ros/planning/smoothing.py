# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cells become a path that a robot can follow: string-pulled, rounded and sampled.

Points (y, x) are in cells: cell (iy, ix) covers [iy, iy + 1) x [ix, ix + 1).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.search import STRAIGHT, CostToGo

SPACING = 0.1
"""Largest distance between the poses of a path [m]."""

_ROUNDING = 0.8
"""Largest distance from a corner at which its rounding begins [m]."""

_LEAST_TURN = math.radians(3.0)
"""Corners of a smaller angle are not rounded."""

_SLACK = 1.005
"""Highest cost of a straight line, relative to that of the cells that it replaces."""


LineTest = Callable[[Array, Array], bool]
"""Whether the robot fits along a line between two points (2,) [cells]."""


def string_pull(
    graph: TransitionGraph,
    field: CostToGo,
    cells: NDArray[np.int64],
    fits: LineTest | None = None,
) -> Array:
    """The vertices of an any-angle path along cells that costs at most 0.5 % more than they do.

    From each vertex the line goes to the farthest cell of the path to which it crosses only open
    transitions between enterable cells (all that it touches, corners included) and to which it
    costs no more than the path.

    Parameters
    ----------
    graph : TransitionGraph
    field : CostToGo
        In which the cells are a cheapest path.
    cells : (N, 2) int64
    fits : callable, optional
        What lines must pass besides, unless they are transitions.

    Returns
    -------
    (M, 2) float64 [cells]
        Centres of some of the cells, the first and the last one among them.
    """
    centers = cells + 0.5
    remaining = field.remaining[cells[:, 0] + 1, cells[:, 1] + 1].astype(np.float64) / STRAIGHT

    def is_as_good(first: int, last: int) -> bool:
        cost = graph.line_cost(centers[first], centers[last])
        if cost < 0.0 or cost > _SLACK * (remaining[first] - remaining[last]):
            return False
        return fits is None or fits(centers[first], centers[last])

    vertices = [0]
    while vertices[-1] < len(cells) - 1:
        first, stride = vertices[-1], 2
        good = first + 1  # a transition is a line
        while first + stride < len(cells) and is_as_good(first, first + stride):
            good, stride = first + stride, 2 * stride
        bad = min(first + stride, len(cells))
        while bad - good > 1:
            middle = (good + bad) // 2
            good, bad = (middle, bad) if is_as_good(first, middle) else (good, middle)
        vertices.append(good)
    return np.asarray(centers[vertices])


def round_corners(graph: TransitionGraph, vertices: Array) -> Array:
    """The polyline with its corners rounded by parabolas, as far as free space permits.

    Parameters
    ----------
    graph : TransitionGraph
    vertices : (N, 2) float64 [cells]

    Returns
    -------
    (M, 2) float64 [cells]
        With the ends of the polyline.
    """
    reach = _ROUNDING / graph.geometry.resolution
    points = [vertices[0]]
    for before, corner, after in zip(vertices, vertices[1:], vertices[2:], strict=False):
        arms = before - corner, after - corner
        lengths = [math.hypot(*arm) for arm in arms]
        curve = corner[None]
        if min(lengths) > 0.0 and _turn(*arms) > _LEAST_TURN:
            cut = min(reach, *(0.5 * length for length in lengths))
            curve = _rounded(
                graph, points[-1], corner, [a / n for a, n in zip(arms, lengths, strict=True)], cut
            )
        points.extend(curve)
    points.append(vertices[-1])
    return np.array(points)


def _turn(before: Array, after: Array) -> float:
    """Angle [rad] by which a corner with these arms turns."""
    cross = before[0] * after[1] - before[1] * after[0]
    return math.pi - abs(math.atan2(cross, float(before @ after)))


def _rounded(
    graph: TransitionGraph, previous: Array, corner: Array, arms: list[Array], cut: float
) -> Array:
    """The widest parabola at a corner that crosses only open transitions, or the corner itself."""
    for _ in range(4):
        ends = [corner + cut * arm for arm in arms]
        count = max(3, math.ceil(2.0 * cut * graph.geometry.resolution / SPACING) + 1)
        t = np.linspace(0.0, 1.0, count)[:, None]
        curve = (1 - t) ** 2 * ends[0] + 2 * t * (1 - t) * corner + t**2 * ends[1]
        line = np.vstack([previous, curve])
        if all(graph.line_cost(p, q) >= 0.0 for p, q in itertools.pairwise(line)):
            return np.asarray(curve)
        cut *= 0.5
    return corner[None]


def sampled(points: Array, spacing: float) -> Array:
    """A polyline (N, 2) resampled so that no two points are farther apart than the spacing.

    Repeated points are removed, except for the first.
    """
    steps = np.hypot(*np.diff(points, axis=0).T)
    parts = [points[:1]]
    for start, end, length in zip(points, points[1:], steps, strict=False):
        if length > 1e-9:
            fractions = np.linspace(0.0, 1.0, math.ceil(length / spacing - 1e-9) + 1)[1:, None]
            parts.append(start + fractions * (end - start))
    return np.concatenate(parts)


def headings(points: Array, first: float | None, last: float | None) -> Array:
    """(N,) [rad]: the heading at each point of a path: that of the following line.

    Parameters
    ----------
    points : (N, 2) float64
        (y, x), N at least 1.
    first, last : float [rad], optional
        Headings at the ends, in place of the direction of the path.
    """
    steps = np.diff(points, axis=0)
    along = np.arctan2(steps[:, 0], steps[:, 1])
    result = np.append(along, along[-1:]) if len(along) else np.zeros(1)
    if first is not None:
        result[0] = first
    if last is not None:
        result[-1] = last
    return result


def path_points(
    graph: TransitionGraph,
    field: CostToGo,
    cells: NDArray[np.int64],
    ends: tuple[Array, Array],
    fits: LineTest | None = None,
) -> Array:
    """The vertices of an any-angle path along cells, from a point to a point.

    Parameters
    ----------
    graph : TransitionGraph
    field : CostToGo
        In which the cells are a cheapest path.
    cells : (N, 2) int64
    ends : (2,) float64 and (2,) float64 [cells]
        Points in the first and in the last cell.
    fits : callable, optional
        As of `string_pull`.

    Returns
    -------
    (M, 2) float64 [cells]
    """

    def is_open(start: Array, end: Array) -> bool:
        return graph.line_cost(start, end) >= 0.0 and (fits is None or fits(start, end))

    first, last = ends
    inner = list(string_pull(graph, field, cells, fits))
    # The ends lie beside the centres of their cells. Where a line from there is blocked, the
    # path leads over the centre.
    if len(cells) == 1:
        return np.array([first, last])
    head = [] if is_open(first, inner[1]) else [inner[0]]
    tail = [] if is_open(inner[-2], last) else [inner[-1]]
    vertices = [first, *head, *inner[1:-1], *tail, last]
    if len(vertices) == 2 and not is_open(first, last):
        vertices = [first, inner[0], inner[-1], last]
    return np.array(vertices)
