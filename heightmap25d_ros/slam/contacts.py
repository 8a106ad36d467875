# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the robot stands, as returns of the ground: what lasers have seen ahead is what bears it.

This ties the pose to ground that was seen a metre or two before: height, roll and pitch, and on
slopes and at their edges the way along them, where there are no walls.
"""

from __future__ import annotations

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.slam.patches import Returns

_WHEELS = np.array([(x, y, 0.0) for x in (-0.25, 0.25) for y in (-0.25, 0.25)])
_CELL, _LEAST_RETURNS = 0.25, 12  # [m] in which the ground is compared; in it
_HIGHEST = 0.5  # [m] of base_link above the ground
_LEAST_CONTACTS = 20  # that stand on ground which was seen


def contacts_of(returns: Array, T_map_base: se3.Matrix) -> Returns:
    """Where the wheels are, as far as ground was seen there; none if it was not.

    Parameters
    ----------
    returns : (N, 3) float64 [m, map]
    T_map_base : (K, 4, 4) float64
    """
    turned = T_map_base.copy()
    turned[:, :3, 3] = 0.0
    wheels = np.array([se3.transform_points(T, _WHEELS) for T in turned])
    height = _height_above_ground(returns, (wheels + T_map_base[:, None, :3, 3]).reshape(-1, 3))
    pose_of = np.repeat(np.arange(0 if height is None else len(T_map_base)), len(_WHEELS))
    down = -T_map_base[pose_of, :3, 2]
    seen = wheels.reshape(-1, 3)[: len(pose_of)] + (height or 0.0) * down
    return Returns(seen, down, pose_of, np.ones(len(seen), np.bool_))


def _height_above_ground(returns: Array, wheels: Array) -> float | None:
    """Height [m] of base_link above the ground that was seen under it, from all poses."""
    cells = np.floor(np.concatenate([returns, wheels])[:, :2] / _CELL).astype(np.int64)
    cells -= cells.min(axis=0)
    index = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    of_returns, of_wheels = index[: len(returns)], index[len(returns) :]
    order = np.lexsort((returns[:, 2], of_returns))
    first = np.searchsorted(of_returns[order], of_wheels, side="left")
    end = np.searchsorted(of_returns[order], of_wheels, side="right")
    is_seen = end - first >= _LEAST_RETURNS
    above = wheels[is_seen, 2] - returns[order[(first + end)[is_seen] // 2], 2]
    above = above[np.abs(above) < _HIGHEST]
    return float(np.median(above)) if len(above) >= _LEAST_CONTACTS else None
