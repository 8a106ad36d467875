# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a map lies in another one of the same place, without any prior.

Pieces of the one are searched in all of the other (`global_search`). Each place where a piece fits
is a hypothesis about the whole map: its walls and its ground are held against those of the other
one, in circles around the piece that grow, since the yaw of a small piece is not known well enough
for what is far away. Its score is the number of cells of walls that agree with the other map, less
eight times those that do not: flat ground alone fits everywhere, and along a corridor most walls
agree wherever it is put. The best hypothesis is accepted only if no other one has half its score.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.localization import surface
from heightmap25d_ros.localization.global_search import relocalize
from heightmap25d_ros.localization.landmarks import Landmarks, landmarks_of
from heightmap25d_ros.localization.layers import NAMES, LayerMap
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.scan_update import Update, update_by_returns
from heightmap25d_ros.localization.surface import Surface
from heightmap25d_ros.params.sections import Params

_SPACING, _REACH = 5.0, 8.0  # [m] between two pieces; half the side of one
_PIECES = 32  # that are searched at most
_LEAST_EDGES = 20  # cells of a piece: without them it could be anywhere
_FIRST = np.square([0.15, 0.15, 0.05, 0.15])  # variances about a pose of the search
_NEXT = np.square([0.05, 0.05, 0.01, 0.05])  # about one that a smaller circle has given
_FIXED = np.full(4, 1e-12)
_SAME_PLACE, _SAME_YAW = 0.5, 0.1  # [m], [rad] between hypotheses that are one
_LEAST_AGREEING = 0.75  # share of the cells over known places that must agree with these
_CONTRADICTION = 8.0  # cells of walls that must agree for each that does not
_OF_HEIGHTS = 4.0  # the same in a map of heights alone, whose places are known to a cell
_ENOUGH = 3  # pieces that fit in a single place, the same one: other pieces are not asked
_LEAST_KNOWN = 0.3  # share of the cells near known places of which the other map tells something
LEAST_SCORE = 80.0
"""Cells of walls that agree, beyond those that outweigh the others: 5 m of each map."""
AS_GOOD = 0.5
"""Of the score of the best hypothesis: another one is a rival."""
_UNKNOWN = 0.5  # of the clip: cost of what the other map may not have seen, see `matching`
_EVIDENCE = 4.0  # returns, as which a known cell without layers counts


class Outcome(Enum):
    """Whether two maps were registered, or why not."""

    REGISTERED = "registered"
    NO_PLACE = "no place where they fit"
    AMBIGUOUS = "several places where they fit"


@dataclass(frozen=True, slots=True, kw_only=True)
class MapRegistration:
    """The outcome of a registration of two maps.

    Attributes
    ----------
    outcome : Outcome
    T_fixed_moving : (4, 4) float64
        The best pose of the moving map: shifted, and turned by a yaw.
    score : float
        Cells of walls of both maps that agree with the other one, less eight times the others.
    agreeing : float
        Share of what both maps know that agrees.
    residual : float [m]
        Mean distance between walls and ground of both, at most 0.1 m each.
    rivals : tuple of (4, 4) float64
        Other poses that fit as well.
    """

    outcome: Outcome
    T_fixed_moving: se3.Matrix
    score: float = 0.0
    agreeing: float = 0.0
    residual: float = 0.0
    rivals: tuple[se3.Matrix, ...] = ()


class RegisteredMap:
    """A map, with what a registration needs of it; made when it is first asked for.

    Parameters
    ----------
    height_map : HeightMap
    layers : LayerMap or None
        Without layers, walls and ground are those of the heights.
    params : Params
    is_growing : bool
        Whether what is not known yet, also close to what is, does not speak against another map.
    """

    def __init__(
        self,
        height_map: HeightMap,
        layers: LayerMap | None,
        params: Params,
        *,
        is_growing: bool = False,
    ) -> None:
        self.height_map, self._is_growing = height_map, is_growing
        self.layers = layers
        self._edge_step = params.registration.edge_step

    @cached_property
    def surface(self) -> Surface:
        """For the search."""
        return surface.surface_of(self.height_map, self._edge_step)

    @cached_property
    def landmarks(self) -> Landmarks:
        """Walls and ground."""
        return landmarks_of(self.height_map, self._evidence, is_growing=self._is_growing)

    @cached_property
    def _evidence(self) -> LayerMap:
        if self.layers is not None:
            return self.layers
        return layers_of_heights(self.height_map, self.surface)

    @property
    def ground_returns(self) -> Array:
        """(rows, columns): how many returns of the ground tell the height of a cell."""
        return np.asarray(self._evidence.ground_count, np.float64)

    @cached_property
    def cells(self) -> tuple[Array, NDArray[np.bool_]]:
        """Mean places (N, 3) [m] of the known cells, and whether (N,) each is a wall's."""
        layers, known = self._evidence, self.height_map.known
        is_high = layers.elevated_count > 0
        offsets = np.stack([
            np.where(is_high, layers.elevated_x, layers.ground_x)[known],
            np.where(is_high, layers.elevated_y, layers.ground_y)[known],
        ], axis=-1)  # fmt: skip
        xy = self.height_map.geometry.cell_center(np.argwhere(known)) + offsets
        is_wall = self.surface.is_edge[known]
        has_ground = ~is_wall & (layers.ground_count[known] > 0)
        height = self.surface.heights[known].astype(np.float64)
        z = np.where(has_ground, layers.ground_height[known], height)
        return np.column_stack([xy, z]), is_wall

    def pieces(self) -> list[Array]:
        """Middles (3,) [m] of pieces that can be searched, on known ground; most walls first."""
        xyz, is_wall = self.cells
        ground, walls = xyz[~is_wall], xyz[is_wall]
        if not len(ground):
            return []
        nodes = np.floor(ground[:, :2] / _SPACING).astype(np.int64)
        _, group = np.unique(nodes, axis=0, return_inverse=True)
        away = np.linalg.norm(ground[:, :2] - (nodes + 0.5) * _SPACING, axis=1)
        order = np.lexsort((away, group.ravel()))
        nearest = order[np.unique(group.ravel()[order], return_index=True)[1]]
        seen = [np.count_nonzero(_within(walls, ground[k], _REACH)) for k in nearest]
        order = np.argsort(seen, kind="stable")[::-1]
        told = [nearest[k] for k in order if seen[k] >= _LEAST_EDGES]
        step = max(-(-len(told) // _PIECES), 1)
        return [ground[k] for k in told[::step]]

    def piece(self, middle: Array, reach: float = _REACH) -> RegistrationPoints:
        """The cells in a square of twice the reach [m] around a middle (3,), for the search."""
        xyz, is_wall = self.cells
        near = _within(xyz, middle, reach)
        pivot = (float(middle[0]), float(middle[1]))
        points = np.ascontiguousarray(xyz[near] - (*pivot, 0.0))
        return RegistrationPoints(points, is_wall[near], np.ones(len(points)), pivot)


class Agreement(NamedTuple):
    """How two maps agree, if one of them lies at a pose in the other.

    Attributes
    ----------
    forward, backward : Update
        Of all cells of the moving map, held against the fixed one, and the other way round.
    walls : int
        Cells of walls of both of which the other map can tell whether they agree.
    agreeing, contradicted : int
        Of these, those that do, and those that stand where the other map has nothing.
    """

    forward: Update
    backward: Update
    walls: int
    agreeing: int
    contradicted: int


def agreement(
    T_fixed_moving: se3.Matrix, fixed: RegisteredMap, moving: RegisteredMap, params: Params
) -> Agreement:
    """Hold each of two maps against the other one, at a pose (4, 4) of the moving one."""
    forward, walls = _held(moving, T_fixed_moving, fixed, params)
    backward, others = _held(fixed, se3.inverse(T_fixed_moving), moving, params)
    return Agreement(
        forward, backward, walls.over_known + others.over_known, walls.agreeing + others.agreeing,
        walls.contradicted + others.contradicted,
    )  # fmt: skip


def register_maps(fixed: RegisteredMap, moving: RegisteredMap, params: Params) -> MapRegistration:
    """Find the moving map in the fixed one.

    Parameters
    ----------
    fixed, moving : RegisteredMap
        Of one resolution.
    params : Params
    """
    searched = replace(params.registration, unknown=_UNKNOWN)
    fitting: list[MapRegistration] = []
    unique: list[MapRegistration] = []
    for middle in moving.pieces():
        found = relocalize(moving.piece(middle), fixed.surface, searched)
        for candidate in found.candidates:
            x, y, yaw = candidate.offset
            about = se3.from_xyz_rpy([*middle, 0.0, 0.0, 0.0])
            start = se3.correction_about(about, (x, y, candidate.z), float(yaw))
            pose = _refined(start, middle, fixed, moving, params)
            judged = _judged(pose, fixed, moving, params)
            if judged is not None:
                fitting.append(judged)
                unique += [judged] if found.is_accepted else []
        if len(unique) >= _ENOUGH and len(_distinct(unique)) == 1:
            break
    return _unique(_distinct(fitting))


def _unique(found: list[MapRegistration]) -> MapRegistration:
    """The first one of those that fit, the best, unless others fit as well."""
    if not found:
        return MapRegistration(outcome=Outcome.NO_PLACE, T_fixed_moving=np.eye(4))
    best = found[0]
    rivals = tuple(f.T_fixed_moving for f in found[1:] if f.score >= AS_GOOD * best.score)
    outcome = Outcome.AMBIGUOUS if rivals else Outcome.REGISTERED
    return MapRegistration(
        outcome=outcome, T_fixed_moving=best.T_fixed_moving, score=best.score,
        agreeing=best.agreeing, residual=best.residual, rivals=rivals,
    )  # fmt: skip


def _refined(
    T: se3.Matrix, middle: Array, fixed: RegisteredMap, moving: RegisteredMap, params: Params
) -> se3.Matrix:
    """A pose of the moving map, held against the fixed one in circles that grow around a piece."""
    xyz, _ = moving.cells
    farthest = float(np.abs(xyz[:, :2] - middle[:2]).max())
    radius, variances = _REACH, _FIRST
    while True:
        near = xyz[_within(xyz, middle, radius)]
        update = _update(near, T, middle, fixed.landmarks, variances, params)
        x, y, yaw, z = (float(error) for error in update.error[:4])
        about = T @ se3.from_xyz_rpy([*middle, 0.0, 0.0, 0.0])
        T = se3.correction_about(about, (x, y, z), yaw) @ T
        if radius > farthest:
            return T
        radius, variances = 2.0 * radius, _NEXT


def _judged(
    T: se3.Matrix, fixed: RegisteredMap, moving: RegisteredMap, params: Params
) -> MapRegistration | None:
    """What a pose of the moving map has to show; None if the maps do not fit there."""
    found = agreement(T, fixed, moving, params)
    forward, backward = found.forward, found.backward
    for update in (forward, backward):
        if update.over_known < _LEAST_KNOWN * update.near_known:
            return None
        if update.agreeing < _LEAST_AGREEING * update.over_known:
            return None
    has_layers = fixed.layers is not None and moving.layers is not None
    weight = _CONTRADICTION if has_layers else _OF_HEIGHTS
    score = found.agreeing - weight * (found.walls - found.agreeing)
    if score < LEAST_SCORE:
        return None
    both = forward.over_known + backward.over_known
    return MapRegistration(
        outcome=Outcome.REGISTERED, T_fixed_moving=T, score=score,
        agreeing=(forward.agreeing + backward.agreeing) / both,
        residual=max(forward.residual, backward.residual),
    )  # fmt: skip


def _held(
    of: RegisteredMap, T: se3.Matrix, within: RegisteredMap, params: Params
) -> tuple[Update, Update]:
    """How the cells of a map agree with another one where it is now: all of them, and its walls."""
    xyz, is_wall = of.cells
    middle = xyz.mean(axis=0)
    all_cells, walls = (
        _update(chosen, T, middle, within.landmarks, _FIXED, params)
        for chosen in (xyz, xyz[is_wall])
    )
    return all_cells, walls


def _update(
    xyz: Array, T: se3.Matrix, middle: Array, landmarks: Landmarks, variances: Array, params: Params
) -> Update:
    """Hold places (N, 3) against a map, at a pose (4, 4) that is off by so much about a middle."""
    position = T[:3, :3] @ middle + T[:3, 3]
    returns = (xyz - middle) @ T[:3, :3].T
    return update_by_returns(
        np.ascontiguousarray(returns), np.ascontiguousarray(position), np.diag(1.0 / variances),
        landmarks, params.scan_filter,
    )  # fmt: skip


def _within(xyz: Array, middle: Array, reach: float) -> NDArray[np.bool_]:
    """(N,) bool: which places are in a square around a middle."""
    return np.asarray((np.abs(xyz[:, :2] - middle[:2]) <= reach).all(axis=1))


def _distinct(found: list[MapRegistration]) -> list[MapRegistration]:
    """The best one of those that are the same place; the best place first."""
    kept: list[MapRegistration] = []
    for registration in sorted(found, key=lambda registration: -registration.score):
        pose = registration.T_fixed_moving
        apart = [se3.inverse(other.T_fixed_moving) @ pose for other in kept]
        if not any(
            np.hypot(*T[:2, 3]) < _SAME_PLACE and abs(se3.yaw(T)) < _SAME_YAW for T in apart
        ):
            kept.append(registration)
    return kept


def layers_of_heights(height_map: HeightMap, cells: Surface) -> LayerMap:
    """Walls and ground as far as heights alone tell them: edges, and all other known cells."""
    shape = height_map.geometry.shape
    dense = {name: np.zeros(shape, np.float32) for name in NAMES}
    is_ground = height_map.known & ~cells.is_edge
    dense["ground_count"][is_ground] = _EVIDENCE
    dense["ground_height"][is_ground] = cells.heights[is_ground]
    dense["elevated_count"][cells.is_edge] = _EVIDENCE
    return LayerMap(geometry=height_map.geometry, above=(), **dense)
