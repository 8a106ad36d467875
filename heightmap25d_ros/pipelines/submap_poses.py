# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where localization's submaps are, as mapping is told: which one is the newest, and who moved."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.io import decode

_AROUND = 8.0  # [m] from its beginning, of most that was seen from a submap
_MOVED, _LIFTED = 2.0, 0.05  # [cells], [m], from which cells move


class SubmapPoses:
    """The beginnings of the submaps of a drive.

    Submaps that have moved by less than two cells, all in all, are left where they are: a map moves
    by whole cells, so that small steps would be lost one by one, and each opens seams.

    Parameters
    ----------
    resolution : float [m]
        Side of the cells of the map.

    Attributes
    ----------
    newest : int
        Number of the submap that is growing, counted from 1; 0 before the first.
    begun_ns : int [ns]
        When the first one began; another map has another one.
    """

    def __init__(self, resolution: float) -> None:
        self._least = _MOVED * resolution
        self.newest = 0
        self.begun_ns = -1
        self._poses: Array = np.empty((0, 4, 4))

    def take(self, message: Any, frame: str) -> Array | None:
        """Take a nav_msgs/Path in, whose header says when the first one began.

        Returns
        -------
        (K, 4, 4) float64 or None
            How what was mapped from those that are known already is to be moved, by their number;
            none, where all stay.

        Raises
        ------
        InputError
            If it is in another frame, or a pose is none.
        """
        decode.require_frame(message.header, frame)
        begun_ns, poses = decode.stamp_ns(message.header), decode.path_poses(message)
        is_same = begun_ns == self.begun_ns and len(poses) >= len(self._poses)
        before = self._poses if is_same else poses
        self.begun_ns, self.newest = begun_ns, len(poses)
        self._poses = np.concatenate([before, poses[len(before) :]])
        motions = poses @ se3.inverse(self._poses)
        is_moved = self._is_moved(motions, self._poses)
        if not is_moved.any():
            return None
        self._poses[is_moved] = poses[is_moved]
        motions[~is_moved] = np.eye(4)
        return np.concatenate([np.eye(4)[None], motions[: len(before)]])

    def _is_moved(self, motions: Array, poses: Array) -> NDArray[np.bool_]:
        """Whether motions (K, 4, 4) move what is around poses (K, 4, 4) far enough."""
        shift = (motions @ poses - poses)[:, :3, 3]
        turn = np.abs(se3.to_xyz_rpy(motions)[:, 5])
        aside = np.hypot(shift[:, 0], shift[:, 1]) + _AROUND * turn
        return (aside >= self._least) | (np.abs(shift[:, 2]) >= _LIFTED)
