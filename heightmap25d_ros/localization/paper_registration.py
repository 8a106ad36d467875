# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's registration, section IV C: ``method: paper``.

A grid of hypotheses is scored by the sum of the absolute differences in height over the cells that
are valid in both maps, here divided by their number: the plain sum is lowest where few cells are
valid, and lost the robot in one lap of four. The result is the average of the good hypotheses,
weighted by their scores. The paper specifies neither the threshold of a good one nor the steps of
the grid: here 5 % above the best score, a cell and a degree. No registration is rejected for its
score. z is the long-term height at the robot minus its estimate; as the robot does not see the
ground below itself, it is the median difference around it.
"""

from __future__ import annotations

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.registration import SIGMAS, Reason, Registration, rejected
from heightmap25d_ros.localization.surface import Surface

_REACH = 1.0, 1.0, np.radians(10.0)  # [m, m, rad] largest offset of the hypotheses
_ANGLE = np.radians(1.0)  # between hypotheses
_GOOD = 1.05  # a hypothesis is good up to this multiple of the best mean
_SPREAD = 0.5  # [steps] assumed standard deviation of the average
_VALID = 0.5  # least share of the largest number of valid cells


def register_by_paper(points: RegistrationPoints, surface: Surface, prior: Array) -> Registration:
    """Register points against the long-term map; parameters as in `registration.register`."""
    widths = np.minimum(SIGMAS * np.sqrt(np.diag(prior)), _REACH)
    steps = np.array([surface.resolution, surface.resolution, _ANGLE])
    axes = [
        step * np.arange(-n, n + 1)
        for n, step in zip(np.ceil(widths / steps).astype(int), steps, strict=True)
    ]
    hypotheses = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    results = np.array([_difference(points, h, surface) for h in hypotheses])
    means = results[:, 0] / np.maximum(results[:, 1], 1)
    valid = results[:, 1] > _VALID * results[:, 1].max()
    if not valid.any():
        return rejected(Reason.LITTLE_OVERLAP, len(points.xyz))
    best = means[valid].min()
    good = valid & (means <= _GOOD * best)
    weights = 1.0 / np.maximum(means[good], 1e-9)
    offset = np.average(hypotheses[good], axis=0, weights=weights)
    _, count, z, residual = _difference(points, offset, surface)
    return Registration(
        reason=Reason.ACCEPTED, offset=offset, z=z,
        information=np.diag(1.0 / (_SPREAD * steps) ** 2),
        known=count / len(points.xyz),
        overlap=count / len(points.xyz), residual=residual, ratio=0.0, points=len(points.xyz),
    )  # fmt: skip


def _difference(
    points: RegistrationPoints, hypothesis: Array, surface: Surface
) -> tuple[float, int, float, float]:
    """Sum of the absolute differences, number of cells, median difference, mean [m]."""
    x, y, yaw = hypothesis
    cos, sin = np.cos(yaw), np.sin(yaw)
    px, py, pz = points.xyz.T
    pivot = points.pivot
    ix = np.floor((pivot[0] + x + cos * px - sin * py - surface.origin[0]) / surface.resolution)
    iy = np.floor((pivot[1] + y + sin * px + cos * py - surface.origin[1]) / surface.resolution)
    rows, columns = surface.heights.shape
    inside = (ix >= 0) & (ix < columns) & (iy >= 0) & (iy < rows)
    heights = surface.heights[iy[inside].astype(int), ix[inside].astype(int)]
    differences = (heights - pz[inside])[~np.isnan(heights)]
    if not len(differences):
        return 0.0, 0, 0.0, 0.0
    total = float(np.abs(differences).sum())
    return total, len(differences), float(np.median(differences)), total / len(differences)
