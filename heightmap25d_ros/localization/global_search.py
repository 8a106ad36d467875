# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Search for the robot's pose in the whole long-term map, without a prior.

Every position and yaw is scored at half the resolution with few points; the best minima are then
refined as in `registration`. The search is one kernel over a small array, with the same score as
the registrations that follow.
"""

from __future__ import annotations

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization import matching
from heightmap25d_ros.localization.matching import Cost, RegistrationPoints, Window
from heightmap25d_ros.localization.registration import (
    MIN_POINTS,
    Reason,
    Registration,
    rejected,
    scale_of,
    search_points,
)
from heightmap25d_ros.localization.surface import Surface, coarser
from heightmap25d_ros.params.sections import RegistrationParams

_POINTS = 120  # that the search uses
_YAW_STEP = 1.5  # of the search, in multiples of the yaw that moves the points by a cell
_MINIMA = 24  # that are refined
_STEPS = (1.0, 1 / 2, 1 / 4, 1 / 8)  # [cells] of the refinement
_APART = 2  # [cells of half the resolution, steps of yaw] between two minima of the search
_DISTINCT = 3.0  # [cells] between two distinct poses
_Z_RANGE = 3.0  # [m]


def relocalize(
    points: RegistrationPoints,
    surface: Surface,
    params: RegistrationParams,
) -> Registration:
    """Search the whole map for the pose at which the points match.

    Parameters
    ----------
    points : RegistrationPoints
        Relative to the pivot.
    surface : Surface
    params : RegistrationParams

    Returns
    -------
    Registration
        Without information: a pose is not a measurement until it is confirmed.
    """
    if len(points.xyz) < MIN_POINTS or np.isnan(surface.heights).all():
        return rejected(Reason.FEW_POINTS, len(points.xyz))
    cost = Cost(params.clip, params.unknown, _Z_RANGE)
    some = points.some(search_points(points, params.search_points))
    scale = scale_of(points, surface)
    steps = np.outer(_STEPS, scale)
    minima = np.array([
        matching.descend(some, start, steps, surface, cost)
        for start in _starts(points, surface, cost)
    ])  # fmt: skip
    scores = np.array([
        matching.match(some, minimum, surface, cost).score for minimum in minima
    ])  # fmt: skip
    best = int(scores.argmin())
    apart = minima - minima[best]
    apart[:, 2] = np.angle(np.exp(1j * apart[:, 2]))
    is_other = np.linalg.norm(apart / scale, axis=1) > _DISTINCT
    ratio = float(scores[best] / scores[is_other].min()) if is_other.any() else 0.0
    found = matching.match(points, minima[best], surface, cost)
    reason = Reason.ACCEPTED
    # Without a prior a robot that sees beyond the map could be at any of its borders.
    if found.known < params.min_overlap:
        reason = Reason.LITTLE_OVERLAP
    elif found.residual > params.max_residual:
        reason = Reason.HIGH_RESIDUAL
    elif ratio > params.max_search_ratio:
        reason = Reason.AMBIGUOUS
    return Registration(
        reason=reason, offset=minima[best], z=found.z, information=np.zeros((3, 3)),
        overlap=found.known, residual=found.residual, ratio=ratio, points=len(points.xyz),
    )  # fmt: skip


def _starts(points: RegistrationPoints, surface: Surface, cost: Cost) -> Array:
    """The best hypotheses (B, 3) of the whole map that are not adjacent to one another."""
    coarse = coarser(surface)
    few = points.some(search_points(points, _POINTS))
    count = int(np.ceil(2 * np.pi / (_YAW_STEP * scale_of(points, coarse)[2])))
    yaws = np.arange(count, dtype=np.float64) * (2 * np.pi / count)
    rows, columns = coarse.heights.shape
    corner = coarse.origin[0] + 0.5 * coarse.resolution, coarse.origin[1] + 0.5 * coarse.resolution
    window = Window(np.arange(columns), np.arange(rows), yaws)
    scores = matching.search(few._replace(pivot=corner), window, coarse, cost)
    found = []
    for _ in range(_MINIMA):
        w, iy, ix = (int(k) for k in np.unravel_index(scores.argmin(), scores.shape))
        x, y = corner[0] + ix * coarse.resolution, corner[1] + iy * coarse.resolution
        found.append((x - points.pivot[0], y - points.pivot[1], yaws[w]))
        adjacent = np.arange(w - _APART, w + _APART + 1) % count
        rows_, columns_ = (slice(max(k - _APART, 0), k + _APART + 1) for k in (iy, ix))
        scores[adjacent, rows_, columns_] = np.inf
    return np.array(found)
