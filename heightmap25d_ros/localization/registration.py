# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Registration of a short-term map against the long-term map: the error of the pose, or a reason.

`register` searches a window around the prior in steps of whole cells with some of the points,
refines the best minima to sub-cell accuracy, and the best of them with all points (at most 3000).
Directions that the surroundings do not observe (along a flat street) get no information and no
correction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import memory, se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization import matching
from heightmap25d_ros.localization.matching import Cost, Match, RegistrationPoints, Window
from heightmap25d_ros.localization.short_term import LocalCells
from heightmap25d_ros.localization.sliced_search import SlicedSearch
from heightmap25d_ros.localization.surface import Surface
from heightmap25d_ros.params.sections import RegistrationParams

MIN_POINTS = 60
"""Least number of points that are registered."""

_FRESH = 0.5  # [m] travelled after which a point weighs 1/e, since odometry drifts
_MINIMA = 8  # that are refined
_APART = 2  # [cells, steps of yaw] between two minima of the search
_DISTINCT = 1.5  # [cells] between two distinct minima
_COARSE_STEPS, _FINE_STEPS = (1 / 2, 1 / 4), (1 / 4, 1 / 8, 1 / 16, 1 / 32)  # [cells]
_FINE_POINTS = 3000  # at most, in the last pass
_PENALTY = 0.003  # [clip] cost of a hypothesis one standard deviation from the prior
SIGMAS = 3.0
"""Half the width of the search window in standard deviations of the prior."""

_BYTES_OF_HYPOTHESIS = 100
_CERTAINTY = 250.0  # [1 / cell^2 / curvature] information per curvature, as measured


class Reason(Enum):
    """The outcome of a registration: accepted, or why it was rejected."""

    ACCEPTED = "accepted"
    FEW_POINTS = "too few points"
    LITTLE_OVERLAP = "too little overlap"
    HIGH_RESIDUAL = "heights do not agree"
    AMBIGUOUS = "another place fits as well"
    FAR_FROM_PRIOR = "too far from the prior"
    UNOBSERVED = "nothing to hold on to"
    TOO_LARGE = "the map is too large to be searched"
    UNFINISHED = "the search was not finished"


@dataclass(frozen=True, slots=True, kw_only=True)
class Registration:
    """The error of the prior pose of the robot, or the reason why it is not known.

    Attributes
    ----------
    reason : Reason
    offset : (3,) float64 [m, m, rad], map
        To be added to x, y and yaw of the robot.
    z : float [m]
        To be added to its z.
    information : (3, 3) float64
        Inverse of the covariance of the offset; zero along directions that are not observed.
    known : float
        Share of the points over known cells.
    overlap : float
        The same, among those at places that the map covers.
    residual : float [m]
        Mean cost of these.
    ratio : float
        Of the score to that of the second-best minimum; 0 without one.
    points : int
    """

    reason: Reason
    offset: Array
    z: float
    information: Array
    known: float
    overlap: float
    residual: float
    ratio: float
    points: int

    @property
    def is_accepted(self) -> bool:
        """Whether the pose may be corrected."""
        return self.reason is Reason.ACCEPTED


def to_registration_points(
    cells: LocalCells, T_map_odom: se3.Matrix, T_odom_base: se3.Matrix
) -> RegistrationPoints:
    """Points of a short-term map about the robot, which is the pivot."""
    x, y = (T_map_odom @ T_odom_base)[:2, 3]
    xyz = se3.transform_points(T_map_odom, cells.xyz) - (x, y, 0.0)
    return RegistrationPoints(
        np.ascontiguousarray(xyz),
        cells.is_edge,
        np.exp(-cells.age / _FRESH),
        (float(x), float(y)),
    )


def register(
    points: RegistrationPoints,
    surface: Surface,
    prior: Array,
    params: RegistrationParams,
) -> Registration:
    """Register points against the long-term map.

    Parameters
    ----------
    points : RegistrationPoints
        At the prior pose.
    surface : Surface
    prior : (3, 3) float64
        Covariance of x, y, yaw of the prior pose.
    params : RegistrationParams

    Raises
    ------
    InputError
        If the window has so many hypotheses that the memory is not available.
    """
    return RegistrationSearch(points, surface, prior, params).finish()


class RegistrationSearch(SlicedSearch[Registration]):
    """A registration that is done in slices: a wide window takes seconds.

    Parameters
    ----------
    points, surface, prior, params
        As of `register`; the errors as well, when `step` is called.
    """

    def __init__(
        self,
        points: RegistrationPoints,
        surface: Surface,
        prior: Array,
        params: RegistrationParams,
    ) -> None:
        self._points, self._surface, self._prior = points, surface, prior
        self._params = params
        super().__init__()

    def _run(self) -> Iterator[Registration | None]:
        """The registration, in pieces of some milliseconds; the last one is its result."""
        points, surface, prior, params = self._points, self._surface, self._prior, self._params
        if len(points.xyz) < MIN_POINTS:
            yield rejected(Reason.FEW_POINTS, len(points.xyz))
            return
        cost = Cost(params.clip, params.unknown, params.z_range)
        scale = scale_of(points, surface)
        few = points.some(search_points(points, params.search_points))
        window = _window(prior, scale, params)
        memory.require(_hypotheses_of(window) * _BYTES_OF_HYPOTHESIS, "the search around the pose")
        scores = np.empty((len(window.yaw), len(window.y), len(window.x)))
        for number, yaw in enumerate(window.yaw):
            turned = window._replace(yaw=np.array([yaw]))
            scores[number] = matching.search(few, turned, surface, cost)[0]
            yield None
        precision = np.asarray(np.linalg.inv(prior), np.float64)
        minima: list[Array] = []
        for start in _minima(scores, window, surface, cost, precision):
            steps = np.outer(_COARSE_STEPS, scale)
            minima.append(matching.descend(few, start, steps, surface, cost))
            yield None
        yield self._judged(np.array(minima), few, cost, precision)

    def _judged(
        self, minima: Array, few: RegistrationPoints, cost: Cost, precision: Array
    ) -> Registration:
        """The best of the minima (B, 3), refined, and why it is accepted or rejected."""
        points, surface, params = self._points, self._surface, self._params
        scale = scale_of(points, surface)
        scores = np.array([
            matching.match(few, minimum, surface, cost).score for minimum in minima
        ]) + _penalty(minima, precision, cost)  # fmt: skip
        best = int(scores.argmin())
        fine = points.some(search_points(points, _FINE_POINTS))
        offset = matching.descend(fine, minima[best], np.outer(_FINE_STEPS, scale), surface, cost)
        found = matching.match(points, offset, surface, cost)
        values, directions = curvature(fine, offset, surface, cost, scale)
        is_observed = values > 2 * params.min_curvature
        directions, values = directions[:, is_observed], values[is_observed]
        information = _information(values, directions, scale)
        apart = np.linalg.norm((minima - offset) / scale @ directions, axis=1) > _DISTINCT
        ratio = float(scores[best] / scores[apart].min()) if apart.any() else 0.0
        deviation = _deviation(offset, self._prior, directions, values, scale)
        return Registration(
            reason=_reason(found, ratio, deviation, len(values), params),
            offset=offset,
            z=found.z,
            information=information,
            known=found.known,
            overlap=found.overlap,
            residual=found.residual,
            ratio=ratio,
            points=len(points.xyz),
        )


def search_points(points: RegistrationPoints, count: int) -> NDArray[np.int64]:
    """Index of the points of a search: two thirds edges if there are enough, spread evenly."""
    edges, others = np.flatnonzero(points.is_edge), np.flatnonzero(~points.is_edge)
    of_edges = min(len(edges), max(2 * count // 3, count - len(others)))
    return np.sort(np.concatenate([_spread(edges, of_edges), _spread(others, count - of_edges)]))


def curvature(
    points: RegistrationPoints,
    offset: Array,
    surface: Surface,
    cost: Cost,
    scale: Array,
) -> tuple[Array, Array]:
    """Curvature of the score around a hypothesis, from one cell away, by principal directions.

    Returns
    -------
    values : (3,) float64 [clip / cell^2]
    directions : (3, 3) float64
        In columns, in units of ``scale``.
    """

    def value(*steps: float) -> float:
        return matching.match(points, offset + scale * steps, surface, cost).score

    unit = np.eye(3)
    middle = value(0.0, 0.0, 0.0)
    hessian = np.empty((3, 3))
    for i in range(3):
        hessian[i, i] = value(*unit[i]) + value(*-unit[i]) - 2 * middle
        for j in range(i):
            same = value(*(unit[i] + unit[j])) + value(*(-unit[i] - unit[j]))
            other = value(*(unit[i] - unit[j])) + value(*(unit[j] - unit[i]))
            hessian[i, j] = hessian[j, i] = (same - other) / 4
    values, directions = np.linalg.eigh(hessian / cost.clip)
    return values, directions


def rejected(reason: Reason, points: int) -> Registration:
    """A registration without a result."""
    return Registration(
        reason=reason, offset=np.zeros(3), z=0.0, information=np.zeros((3, 3)), known=0.0,
        overlap=0.0, residual=0.0, ratio=0.0, points=points,
    )  # fmt: skip


def scale_of(points: RegistrationPoints, surface: Surface) -> Array:
    """(3,) [m, m, rad]: changes of x, y and yaw that move the points by about a cell."""
    radius = np.sqrt(np.average((points.xyz[:, :2] ** 2).sum(axis=1), weights=points.weight))
    cell = surface.resolution
    return np.array([cell, cell, cell / max(radius, cell)])


def _spread(index: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    if len(index) <= count:
        return index
    return index[np.arange(count) * len(index) // max(count, 1)]


def _window(prior: Array, scale: Array, params: RegistrationParams) -> Window:
    """The hypotheses within the limits around the prior, in steps of the scale."""
    widths = SIGMAS * np.sqrt(np.diag(prior))
    limits = params.window_distance, params.window_distance, params.window_angle
    counts = np.ceil(np.minimum(widths, limits) / scale).astype(int)
    x, y, yaw = (np.arange(-n, n + 1) for n in np.maximum(counts, 1))
    return Window(x, y, yaw * scale[2])


def _hypotheses_of(window: Window) -> int:
    return len(window.x) * len(window.y) * len(window.yaw)


def _minima(scores: Array, window: Window, surface: Surface, cost: Cost, precision: Array) -> Array:
    """The best hypotheses (B, 3) of a window that are not adjacent, by their scores (W, Y, X)."""
    x, y, yaw = window
    hypotheses = np.stack(np.meshgrid(yaw, y, x, indexing="ij"), axis=-1)[..., ::-1].copy()
    hypotheses[..., :2] *= surface.resolution
    scores = scores + _penalty(hypotheses, precision, cost)
    found = []
    for _ in range(_MINIMA):
        w, j, i = np.unravel_index(scores.argmin(), scores.shape)
        if np.isinf(scores[w, j, i]):
            break
        found.append(hypotheses[w, j, i])
        scores[tuple(slice(max(k - _APART, 0), k + _APART + 1) for k in (w, j, i))] = np.inf
    return np.array(found)


def _penalty(hypotheses: Array, precision: Array, cost: Cost) -> Array:
    """Cost of hypotheses (..., 3) for their distance from the prior."""
    squared = np.einsum("...i,ij,...j->...", hypotheses, precision, hypotheses)
    return np.asarray(_PENALTY * cost.clip * squared)


def _information(values: Array, directions: Array, scale: Array) -> Array:
    """Information of the offset, from the curvature along observed directions (3, K)."""
    scaled = directions / scale[:, None]
    return np.asarray(scaled * (_CERTAINTY * values) @ scaled.T)


def _deviation(
    offset: Array, prior: Array, directions: Array, values: Array, scale: Array
) -> float:
    """Standard deviations of the offset from the prior, along observed directions."""
    if not len(values):
        return 0.0
    along = directions.T @ (offset / scale)
    spread = directions.T @ (prior / np.outer(scale, scale)) @ directions
    spread += np.diag(1.0 / (_CERTAINTY * values))
    return float(np.sqrt(along @ np.linalg.solve(spread, along)))


def _reason(
    found: Match, ratio: float, deviation: float, observed: int, params: RegistrationParams
) -> Reason:
    if found.overlap < params.min_overlap:
        return Reason.LITTLE_OVERLAP
    if found.residual > params.max_residual:
        return Reason.HIGH_RESIDUAL
    if observed == 0:
        return Reason.UNOBSERVED
    if ratio > params.max_ratio:
        return Reason.AMBIGUOUS
    if deviation > params.max_deviation:
        return Reason.FAR_FROM_PRIOR
    return Reason.ACCEPTED
