# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Made-up places of boxes on a floor, as a long-term map and as seen by a robot."""

from __future__ import annotations

import numpy as np

from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.surface import Surface, edges

CELL = 0.125
SIDE = 128


def boxes(rng: np.random.Generator, count: int = 40):
    """x, y, half sizes, yaw, height [m] of boxes about the middle of 16 m x 16 m."""
    return np.column_stack([
        rng.uniform(-7, 7, (count, 2)), rng.uniform(0.15, 0.6, (count, 2)),
        rng.uniform(0, np.pi, count), rng.uniform(0.2, 1.0, count),
    ])  # fmt: skip


def height(place, x, y):
    """Height [m] of the place at points: the highest box, else the floor."""
    top = np.zeros(np.broadcast(x, y).shape)
    for bx, by, half_x, half_y, yaw, tall in place:
        u = np.cos(yaw) * (x - bx) + np.sin(yaw) * (y - by)
        v = -np.sin(yaw) * (x - bx) + np.cos(yaw) * (y - by)
        top = np.where((np.abs(u) < half_x) & (np.abs(v) < half_y), np.maximum(top, tall), top)
    return top


def long_term(place, rng, noise=0.0) -> Surface:
    """The highest of 4 x 4 points of each cell, as a map holds it."""
    fine = (np.arange(4 * SIDE) + 0.5) * CELL / 4 - SIDE * CELL / 2
    top = height(place, fine[None, :], fine[:, None]).reshape(SIDE, 4, SIDE, 4).max(axis=(1, 3))
    top = (top + rng.normal(0.0, 1.0, top.shape) * noise).astype(np.float32)
    return Surface(top, edges(top, 0.15), (-SIDE * CELL / 2,) * 2, CELL)


def short_term(place, rng, pose, noise=0.025, reach=4.0) -> RegistrationPoints:
    """What is around a pose (x, y, yaw), seen from there: one point in each cell of its own."""
    x, y, yaw = pose
    axis = np.arange(-reach, reach, CELL) + CELL / 2
    u, v = (grid.ravel() for grid in np.meshgrid(axis, axis))
    top = height(
        place, x + np.cos(yaw) * u - np.sin(yaw) * v, y + np.sin(yaw) * u + np.cos(yaw) * v
    )
    heights = top.reshape(len(axis), -1).astype(np.float32)
    return RegistrationPoints(
        np.column_stack([u, v, top + rng.normal(0.0, noise, len(top))]),
        edges(heights, 0.15).ravel(),
        np.ones(len(top)),
    )
