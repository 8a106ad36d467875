# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Search for the robot's pose in the whole long-term map, without a prior or with a vague one.

`branch_and_bound` finds every place that can be as good as the best one known so far, but for what
noise explains. All of them are refined by the score of the registrations (`matching`), and a pose
is accepted only if no other place is as good. The yaw is searched in steps that move the points by
three cells; between them the refinement finds it.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization import branch_and_bound, height_pyramid, matching
from heightmap25d_ros.localization.branch_and_bound import ROOT, Descent, Ground, Turned
from heightmap25d_ros.localization.height_pyramid import LEVELS
from heightmap25d_ros.localization.matching import Cost, RegistrationPoints
from heightmap25d_ros.localization.registration import (
    MIN_POINTS,
    Reason,
    Registration,
    rejected,
    scale_of,
    search_points,
)
from heightmap25d_ros.localization.sliced_search import SlicedSearch
from heightmap25d_ros.localization.surface import BORDER, Surface
from heightmap25d_ros.params.sections import RegistrationParams

_POINTS = 150  # that the search uses
_YAW_STEP = 3.0  # of the search, in multiples of the yaw that moves the points by a cell
_BEGIN = 0.2  # of the worst score, with which the search begins
_FIRST = 3  # leaves that are refined to see how good the best place is
_PIECE = 20_000  # bounds between two looks at the clock
_LEAVES = 32_768  # of a search at most
_SCORED = 2048  # of these between two looks at the clock
_MINIMA = 32  # that are refined
_APART = 3, 2  # [cells, steps of yaw] between two of these
_COARSE, _FINE = (1.0, 1 / 2, 1 / 4), (1.0, 1 / 2, 1 / 4, 1 / 8)  # [cells] of the refinement
_FINAL = 8  # that are refined with more points
_DISTINCT = 3.0  # [cells] between two distinct poses
_Z_RANGE = 3.0  # [m] where the ground under the robot was not seen
_AROUND, _OF_GROUND = 4.0, 30  # [m] from the robot, and number of points, that tell its ground
_LEAST_GROUND = 5
_UNSEEN = 0.3  # of the clip: mean cost of points at a wrong place
_WORST = 0.5  # of the cost of an unknown cell: no worse place is looked for


class Prior(NamedTuple):
    """Where the robot must be.

    Attributes
    ----------
    x, y : float [m], map
    radius : float [m]
    turn : float [rad]
        How far it may be turned from the pose at which the points are; all ways by default.
    """

    x: float
    y: float
    radius: float
    turn: float = np.pi


@dataclass(frozen=True, slots=True)
class Candidate:
    """A pose at which the points match.

    Attributes
    ----------
    offset : (3,) float64 [m, m, rad], map
        To be added to x, y and yaw of the robot.
    z : float [m]
        To be added to its z.
    score : float [m]
        Of `matching.match`, with ``search_points`` of the points.
    known : float
        Share of these that lie over known cells.
    """

    offset: Array
    z: float
    score: float
    known: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchResult(Registration):
    """A registration without a prior, and all poses that are as good.

    Attributes
    ----------
    candidates : tuple of Candidate
        The best pose first, then the distinct ones that noise or ``max_search_ratio`` do not tell
        from it, at most 32. More than one: ambiguous.
    is_complete : bool
        Whether these are all.
    nodes : int
        Number of bounds that it took.
    """

    candidates: tuple[Candidate, ...] = ()
    is_complete: bool = False
    nodes: int = 0


def relocalize(
    points: RegistrationPoints,
    surface: Surface,
    params: RegistrationParams,
    prior: Prior | None = None,
) -> SearchResult:
    """Search the whole map for the pose at which the points match.

    Parameters
    ----------
    points : RegistrationPoints
        Relative to the pivot.
    surface : Surface
    params : RegistrationParams
    prior : Prior, optional

    Returns
    -------
    SearchResult
        Without information: a pose is not a measurement until it is confirmed.
    """
    return GlobalSearch(points, surface, params, prior).finish()


class GlobalSearch(SlicedSearch[SearchResult]):
    """A search of the whole map that is done in slices.

    Parameters
    ----------
    points, surface, params, prior
        As of `relocalize`. The first search on a surface makes its pyramid, in one slice.

    Examples
    --------
    >>> points = RegistrationPoints(np.zeros((3, 3)), np.zeros(3, bool), np.ones(3))
    >>> flat = Surface(np.zeros((8, 8), np.float32), np.zeros((8, 8), bool), (0.0, 0.0), 0.125)
    >>> search = GlobalSearch(points, flat, RegistrationParams())
    >>> while not search.step(0.01):
    ...     pass  # do something else
    >>> search.result.reason.value
    'too few points'
    """

    def __init__(
        self,
        points: RegistrationPoints,
        surface: Surface,
        params: RegistrationParams,
        prior: Prior | None = None,
    ) -> None:
        self._points, self._surface, self._params = points, surface, params
        self._prior = prior
        self._ground_z = _ground_under(points)
        z_range = _Z_RANGE if self._ground_z is None else params.z_range
        self._cost = Cost(params.clip, params.unknown, z_range)
        self._nodes = 0
        super().__init__()

    def _run(self) -> Iterator[SearchResult | None]:
        """The search, in pieces of some milliseconds; the last one is its result."""
        count = len(self._points.xyz)
        if count < MIN_POINTS or np.isnan(self._surface.heights).all():
            yield _of(rejected(Reason.FEW_POINTS, count))
            return
        self._scale = scale_of(self._points, self._surface)
        self._yaws = self._searched_yaws()
        yaws = len(self._yaws)
        if self._memory() > self._params.search_memory * 1e6:
            yield _of(rejected(Reason.TOO_LARGE, count))
            return
        roots = np.concatenate([self._roots(yaw) for yaw in range(yaws)])
        if not len(roots):
            yield _of(rejected(Reason.LITTLE_OVERLAP, count))
            return
        self._few = self._points.some(search_points(self._points, _POINTS))
        self._seen: Turned = branch_and_bound.turned(
            self._few, self._yaws, self._surface.resolution, self._ground_z
        )
        self._ground: Ground = branch_and_bound.ground_of(
            self._surface.pyramid, self._cost, is_z_known=self._ground_z is not None
        )
        yield None
        yield from self._find(roots)
        if self._nodes > self._params.search_nodes:
            yield _of(rejected(Reason.UNFINISHED, count), nodes=self._nodes)
            return
        candidates = []
        for start in (yield from self._minima(self._descent.leaves)):
            candidates.append(self._refined(start, self._few, _COARSE))
            yield None
        yield self._judged(candidates)

    def _searched_yaws(self) -> Array:
        """In steps: all around, or as far as the prior allows to both sides."""
        turn = np.pi if self._prior is None else self._prior.turn
        yaws = int(np.ceil(2 * np.pi / (_YAW_STEP * self._scale[2])))
        self._yaw_step = step = 2 * np.pi / yaws
        steps = int(np.ceil(turn / step))
        if 2 * steps + 1 >= yaws:
            return np.arange(yaws, dtype=np.float64) * step
        return np.arange(-steps, steps + 1, dtype=np.float64) * step

    def _find(self, roots: NDArray[np.int32]) -> Iterator[None]:
        """Find all leaves that can be as good as the best one, with limits that rise.

        The best place is soon found with a low limit, and tells the one that is needed.
        """
        limit = _BEGIN * self._worst
        while True:
            self._descent = Descent(self._seen, roots, self._ground, self._within(), _LEAVES)
            yield from self._divide(limit)
            best = yield from self._best_of(self._descent.leaves)
            needed = self._worst if best is None else self._limit(best)
            if needed <= limit or not self._descent.is_done:
                break
            limit = min(needed, 2 * limit)

    def _divide(self, limit: float) -> Iterator[None]:
        """Find all leaves within a limit; not done if they are too many, or the budget is spent."""
        descent, before = self._descent, self._nodes
        while not descent.is_done and self._nodes <= self._params.search_nodes:
            descent.divide(limit, _PIECE)
            self._nodes = before + descent.nodes
            yield None
            if descent.is_full:
                best = yield from self._best_of(descent.leaves)
                limit = limit if best is None else min(limit, self._limit(best))
                descent.keep(limit)
                yield None
                if len(descent.leaves) > _LEAVES // 2:
                    break

    @property
    def _worst(self) -> float:
        """Score [m] up to which places are looked for at most."""
        return worst_score(self._params)

    def _memory(self) -> int:
        """Estimate [bytes] of what the search takes."""
        rows, columns = (int(side) for side in self._surface.heights.shape)
        roots = len(self._yaws) * -(-rows // ROOT) * -(-columns // ROOT)
        return height_pyramid.memory_of((rows + 2 * BORDER, columns + 2 * BORDER)) + 60 * roots

    def _within(self) -> tuple[float, float, float]:
        """The circle of the prior: row, column, radius [cells]."""
        if self._prior is None:
            return 0.0, 0.0, np.inf
        cell = self._surface.resolution
        x, y = (np.array(self._prior[:2]) - self._surface.origin) / cell
        return float(y), float(x), self._prior.radius / cell

    def _roots(self, yaw: int) -> NDArray[np.int32]:
        """Nodes (K, 4) of the highest level at a yaw."""
        y, x, radius = self._within()
        sides = []
        for middle, cells in zip((y, x), self._surface.heights.shape, strict=True):
            low, high = max(middle - radius, 0.0), min(middle + radius, cells - 1.0)
            sides.append(np.arange(int(low) // ROOT, int(high) // ROOT + 1) * ROOT)
        rows, columns = np.meshgrid(*sides, indexing="ij")
        same = np.ones(rows.size, np.int32)
        return np.column_stack([
            yaw * same, (LEVELS - 1) * same, rows.ravel(), columns.ravel()
        ]).astype(np.int32)  # fmt: skip

    def _best_of(self, leaves: NDArray[np.int32]) -> Generator[None, None, Candidate | None]:
        """The best pose that the most promising leaves lead to; None without leaves."""
        minima = yield from self._minima(leaves)
        found = [self._refined(start, self._few, _COARSE) for start in minima[:_FIRST]]
        yield None
        return min(found, key=self._cautious, default=None)

    def _cautious(self, candidate: Candidate) -> float:
        return cautious_score(candidate, self._params)

    def _limit(self, candidate: Candidate) -> float:
        return as_good_score(candidate, self._params)

    def _minima(self, leaves: NDArray[np.int32]) -> Generator[None, None, Array]:
        """The best hypotheses (B, 4) in leaves (K, 4) that are not adjacent to one another."""
        hypotheses = self._hypotheses(leaves)
        scores = np.empty(len(leaves))
        for begin in range(0, len(leaves), _SCORED):
            part = slice(begin, begin + _SCORED)
            scores[part] = matching.scores_at(
                self._few, hypotheses[part], self._surface, self._cost
            )
            yield None
        found: list[Array] = []
        waiting = np.argsort(scores, kind="stable")
        while len(waiting) and len(found) < _MINIMA:
            best = waiting[0]
            found.append(hypotheses[best])
            apart = np.abs(leaves[waiting] - leaves[best])
            turned = self._yaws[leaves[waiting, 0]] - self._yaws[leaves[best, 0]]
            turn = np.rint(np.abs(np.angle(np.exp(1j * turned))) / self._yaw_step)
            is_apart = (apart[:, 2:].max(axis=1) > _APART[0]) | (turn > _APART[1])
            waiting = waiting[is_apart]
            yield None
        return np.array(found)

    def _hypotheses(self, leaves: NDArray[np.int32]) -> Array:
        """x, y, yaw, z (K, 4) of the middles of leaves."""
        surface, pivot = self._surface, self._points.pivot
        x = surface.origin[0] + (leaves[:, 3] + 0.5) * surface.resolution - pivot[0]
        y = surface.origin[1] + (leaves[:, 2] + 0.5) * surface.resolution - pivot[1]
        z = np.zeros(len(leaves))
        if self._ground_z is not None:
            rows, columns = leaves[:, 2].astype(np.int64), leaves[:, 3].astype(np.int64)
            z = surface.pyramid.ground_at(rows, columns) - self._ground_z
        return np.column_stack([x, y, self._yaws[leaves[:, 0]], z])

    def _refined(
        self, start: Array, points: RegistrationPoints, steps: tuple[float, ...]
    ) -> Candidate:
        """The minimum of the score of points around a hypothesis (4,)."""
        lifted = points._replace(xyz=points.xyz + (0.0, 0.0, start[3]))
        offset = matching.descend(
            lifted, start[:3], np.outer(steps, self._scale), self._surface, self._cost
        )
        found = matching.match(lifted, offset, self._surface, self._cost)
        return Candidate(offset, float(start[3] + found.z), found.score, found.known)

    def _judged(self, candidates: list[Candidate]) -> SearchResult:
        """The best of the refined poses, and why it is accepted or rejected."""
        count, params = len(self._points.xyz), self._params
        if not candidates:
            return _of(rejected(Reason.HIGH_RESIDUAL, count), nodes=self._nodes)
        some = self._points.some(search_points(self._points, params.search_points))
        limit = self._limit(min(candidates, key=self._cautious)) + params.search_margin
        coarse = [c for c in _distinct(candidates, self._scale) if c.score <= limit]
        if not coarse:  # not even the best place fits
            return _of(rejected(Reason.HIGH_RESIDUAL, count), nodes=self._nodes)
        fine = _distinct(
            [self._refined(np.append(c.offset, c.z), some, _FINE) for c in coarse[:_FINAL]],
            self._scale,
        )
        fine.sort(key=self._cautious)
        best = fine[0]
        as_good = (best, *(c for c in fine[1:] if c.score <= self._limit(best)))
        lifted = self._points._replace(xyz=self._points.xyz + (0.0, 0.0, best.z))
        found = matching.match(lifted, best.offset, self._surface, self._cost)
        is_complete = self._descent.is_done and len(coarse) <= _FINAL
        reason = Reason.ACCEPTED
        # Without a prior a robot that sees beyond the map could be at any of its borders.
        if found.known < params.min_overlap:
            reason = Reason.LITTLE_OVERLAP
        elif found.residual > params.max_residual:
            reason = Reason.HIGH_RESIDUAL
        elif len(as_good) > 1 or not self._descent.is_done:
            reason = Reason.AMBIGUOUS
        return SearchResult(
            reason=reason, offset=best.offset, z=best.z + found.z, information=np.zeros((3, 3)),
            known=found.known, overlap=found.overlap, residual=found.residual,
            ratio=best.score / fine[1].score if len(fine) > 1 else 0.0, points=count,
            candidates=as_good, is_complete=is_complete, nodes=self._nodes,
        )  # fmt: skip


def worst_score(params: RegistrationParams) -> float:
    """Score [m] up to which places are looked for at most."""
    return _WORST * params.unknown * params.clip


def cautious_score(candidate: Candidate, params: RegistrationParams) -> float:
    """The score that a pose would have if what the map does not know there were not as seen."""
    return candidate.score + (1.0 - candidate.known) * _UNSEEN * params.clip


def as_good_score(candidate: Candidate, params: RegistrationParams) -> float:
    """Score up to which places are as good as a pose."""
    score = cautious_score(candidate, params)
    as_good = max(score / params.max_search_ratio, score + params.search_margin)
    return min(as_good, worst_score(params))


def _of(registration: Registration, nodes: int = 0) -> SearchResult:
    """A result without candidates."""
    values = {field.name: getattr(registration, field.name) for field in fields(registration)}
    return SearchResult(**values, nodes=nodes)


def _ground_under(points: RegistrationPoints) -> float | None:
    """Height [m] of the ground under the robot, by its own points; None if they do not tell it."""
    distance = np.hypot(*points.xyz[:, :2].T)
    near = np.flatnonzero(~points.is_edge & (distance < _AROUND))
    near = near[np.argsort(distance[near], kind="stable")[:_OF_GROUND]]
    return float(np.median(points.xyz[near, 2])) if len(near) >= _LEAST_GROUND else None


def _distinct(candidates: list[Candidate], scale: Array) -> list[Candidate]:
    """The best of candidates that are the same pose, in order of their scores."""
    kept: list[Candidate] = []
    for candidate in sorted(candidates, key=lambda candidate: candidate.score):
        apart = np.array([candidate.offset - other.offset for other in kept]).reshape(-1, 3)
        apart[:, 2] = np.angle(np.exp(1j * apart[:, 2]))
        if (np.linalg.norm(apart / scale, axis=1) > _DISTINCT).all():
            kept.append(candidate)
    return kept
