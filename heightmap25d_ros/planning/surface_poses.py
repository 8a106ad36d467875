# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The points of a path become poses on the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.planning.graph import TransitionGraph


def on_surface(
    graph: TransitionGraph, points: Array, heading: Array, reach: int
) -> NDArray[np.float64]:
    """Poses on the ground, inclined as the plane under the footprint.

    Parameters
    ----------
    graph : TransitionGraph
    points : (N, 2) float64 [cells]
        (y, x).
    heading : (N,) float64 [rad]
    reach : int
        z is the mean over this many points before and after: single heights are noisy. Where no
        known cell is near, it leads in a straight line from the last height to the next.

    Returns
    -------
    (N, 4, 4) float64 [m], map
    """
    resolution, (x0, y0) = graph.geometry.resolution, graph.geometry.origin
    gx, gy = interpolated(graph.gradient, points)
    up = np.stack([-gx, -gy, np.ones_like(gx)], axis=-1)
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    ahead = np.stack([np.cos(heading), np.sin(heading), np.zeros_like(heading)], axis=-1)
    ahead[:, 2] = gx * ahead[:, 0] + gy * ahead[:, 1]  # on the ground, seen from above the same
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    poses = np.tile(np.eye(4), (len(points), 1, 1))
    poses[:, :3, 0], poses[:, :3, 1], poses[:, :3, 2] = ahead, np.cross(up, ahead), up
    poses[:, 0, 3] = x0 + points[:, 1] * resolution
    poses[:, 1, 3] = y0 + points[:, 0] * resolution
    height = _smoothed(_bridged(interpolated(graph.height[None], points)[0]), reach)
    poses[:, 2, 3] = height + graph.geometry.ground_zero
    return poses


def interpolated(layers: NDArray[np.float32], points: Array) -> NDArray[np.float64]:
    """(L, N): layers (L, rows, columns) at points (N, 2) [cells], linear between cells' centres."""
    indices = np.maximum(points.T - 0.5, 0.0)
    return np.array(
        [ndimage.map_coordinates(layer, indices, np.float64, 1, "nearest") for layer in layers]
    )


def _bridged(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values with those in between in place of NaN; zeros where there are none at all."""
    given = np.flatnonzero(np.isfinite(values))
    if not len(given):
        return np.zeros_like(values)
    return np.interp(np.arange(len(values)), given, values[given])


def _smoothed(values: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """Means over this many neighbours on either side, fewer near the ends: lines stay straight."""
    index = np.arange(len(values))
    reaches = np.minimum(reach, np.minimum(index, index[::-1]))
    sums = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray((sums[index + reaches + 1] - sums[index - reaches]) / (2 * reaches + 1))
