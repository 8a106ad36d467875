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
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION
from heightmap25d_ros.localization import branch_and_bound, height_pyramid, matching
from heightmap25d_ros.localization.branch_and_bound import Descent, Ground, Turned
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
from heightmap25d_ros.localization.sweep import Sweep
from heightmap25d_ros.params.sections import RegistrationParams

_POINTS = 150  # that the search uses
_YAW_STEP = 3.0  # of the search, in multiples of the yaw that moves the points by a cell
_BEGIN = 0.4  # of the worst score, with which the search begins
_FIRST = 3  # leaves that are refined to see how good the best place is
_PIECE = 20_000  # bounds between two looks at the clock
_LEAVES = 32_768  # of a search at most
_SOME = 1024  # of them, where they are too many
_SCORED = 2048  # of them between two looks at the clock
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
    has_found_all : bool
        Whether all places that may be as good were found; the best eight are looked at closely.
    is_complete : bool
        Whether these are all: there were no more than eight, either.
    nodes : int
        Number of bounds that it took.
    """

    candidates: tuple[Candidate, ...] = ()
    has_found_all: bool = False
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
        if self._memory() > self._params.search_memory * 1e6:
            yield _of(rejected(Reason.TOO_LARGE, count))
            return
        self._few = self._points.some(search_points(self._points, _POINTS))
        self._seen: Turned = branch_and_bound.turned(
            self._few, self._yaws, self._surface.resolution, self._ground_z
        )
        self._ground: Ground = branch_and_bound.ground_of(
            self._surface.pyramid, self._cost, is_z_known=self._ground_z is not None
        )
        yield None
        self._sweep = Sweep(self._seen, self._surface.pyramid.phases, self._ground, self._within())
        if not self._sweep.strips:
            yield _of(rejected(Reason.LITTLE_OVERLAP, count))
            return
        yield from self._find()
        if self._nodes > self._params.search_nodes:
            yield _of(rejected(Reason.UNFINISHED, count), nodes=self._nodes)
            return
        candidates = []
        for start in self._starts:
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

    def _find(self) -> Iterator[None]:
        """Find all leaves that can be as good as the best one, with limits that rise.

        Where too many are within the first limit, a lower one tells which is needed.
        """
        limit, self._needed = _BEGIN * self._worst, self._worst
        has_begun_lower = False
        while True:
            self._descent = Descent(self._seen, self._ground, self._within(), _LEAVES)
            self._limit_now = limit
            yield from self._divide()
            if self._is_full() and not has_begun_lower:
                limit, has_begun_lower = 0.5 * limit, True
                continue
            leaves = self._descent.leaves
            looked_at = leaves if self._has_found_all else self._best(leaves)
            self._starts = yield from self._minima(looked_at)
            yield None
            self._lower(self._starts[:_FIRST])
            yield None
            if self._needed <= self._limit_now or not self._has_found_all:
                break
            limit = min(self._needed, 2 * limit)

    def _divide(self) -> Iterator[None]:
        """Find all leaves within a limit, which falls as soon as a good place is found.

        Not all are found if they are too many, or the budget is spent.
        """
        descent, before = self._descent, self._nodes
        self._has_found_all = False
        self._least_bound = np.inf
        for strip in self._sweep.strips:
            known = len(descent.leaves)
            descent.begin(self._sweep.roots(strip, self._limit_now / HEIGHT_RESOLUTION))
            yield None
            while not descent.is_done:
                descent.divide(self._limit_now, _PIECE)
                self._nodes = before + descent.nodes
                yield None
                if descent.is_full:
                    starts = yield from self._minima(self._best(descent.leaves))
                    self._lower(starts[:_FIRST])
                    yield None
                    if self._is_full():
                        return
                    known = len(descent.leaves)
                if self._nodes > self._params.search_nodes:
                    return
            if len(descent.leaves) > known:
                self._lower_by(descent.leaves[known:])
        self._has_found_all = True

    def _is_full(self) -> bool:
        return len(self._descent.leaves) > _LEAVES // 2

    def _bounds(self, leaves: NDArray[np.int32]) -> Array:
        return branch_and_bound.bounds(self._seen, leaves, self._ground, self._limit_now)

    def _best(self, leaves: NDArray[np.int32]) -> NDArray[np.int32]:
        """Those with the lowest bounds, of leaves that are too many to look at all of them."""
        return leaves[np.argsort(self._bounds(leaves), kind="stable")[:_SOME]]

    def _lower_by(self, leaves: NDArray[np.int32]) -> None:
        """Lower the limit by the best of new leaves (K, 4), if it is better than those before."""
        bounds = self._bounds(leaves)
        best = int(bounds.argmin())
        if bounds[best] < self._least_bound:
            self._least_bound = float(bounds[best])
            self._lower(self._hypotheses(leaves[[best]]))

    def _lower(self, starts: Array) -> None:
        """Lower the limit to what is as good as the best pose that hypotheses (B, 4) lead to."""
        found = [self._refined(start, self._few, _COARSE) for start in starts]
        self._needed = min([self._needed, *(self._limit(candidate) for candidate in found)])
        if self._needed < self._limit_now:
            self._limit_now = self._needed
            self._descent.keep(self._needed)

    @property
    def _worst(self) -> float:
        """Score [m] up to which places are looked for at most."""
        return worst_score(self._params)

    def _memory(self) -> int:
        """Estimate [bytes] of what the search takes."""
        rows, columns = (int(side) + 2 * BORDER for side in self._surface.heights.shape)
        return height_pyramid.memory_of((rows, columns))

    def _within(self) -> tuple[float, float, float]:
        """The circle of the prior: row, column, radius [cells]."""
        if self._prior is None:
            return 0.0, 0.0, np.inf
        cell = self._surface.resolution
        x, y = (np.array(self._prior[:2]) - self._surface.origin) / cell
        return float(y), float(x), self._prior.radius / cell

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
        is_complete = self._has_found_all and len(coarse) <= _FINAL
        reason = Reason.ACCEPTED
        # Without a prior a robot that sees beyond the map could be at any of its borders.
        if found.known < params.min_overlap:
            reason = Reason.LITTLE_OVERLAP
        elif found.residual > params.max_residual:
            reason = Reason.HIGH_RESIDUAL
        elif len(as_good) > 1 or not self._has_found_all:
            reason = Reason.AMBIGUOUS
        return SearchResult(
            reason=reason, offset=best.offset, z=best.z + found.z, information=np.zeros((3, 3)),
            known=found.known, overlap=found.overlap, residual=found.residual,
            ratio=best.score / fine[1].score if len(fine) > 1 else 0.0, points=count,
            candidates=as_good, has_found_all=self._has_found_all, is_complete=is_complete,
            nodes=self._nodes,
        )  # fmt: skip


def compile_kernels(params: RegistrationParams) -> None:
    """Compile, or load from numba's cache, what any search of the whole map needs."""
    surface = Surface(np.zeros((4, 4), np.float32), np.zeros((4, 4), bool), (0.0, 0.0), 1.0)
    points = RegistrationPoints(
        np.zeros((MIN_POINTS, 3)), np.zeros(MIN_POINTS, bool), np.ones(MIN_POINTS), (2.0, 2.0)
    )
    search = GlobalSearch(points, surface, params)
    search.finish()
    search._descent.keep(0.0)  # as where there are too many places


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
