# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where localization's submaps are, as mapping is told: which one is the newest, and who moved."""

from __future__ import annotations

from typing import Any

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.io import decode

_STAYED = 1e-3  # [m], and share of it per metre: less is no motion


class SubmapPoses:
    """The beginnings of the submaps of a drive.

    Attributes
    ----------
    newest : int
        Number of the submap that is growing, counted from 1; 0 before the first.
    begun_ns : int [ns]
        When the first one began; another map has another one.
    """

    def __init__(self) -> None:
        self.newest = 0
        self.begun_ns = -1
        self._poses: Array = np.empty((0, 4, 4))

    def take(self, message: Any, frame: str) -> Array | None:
        """Take a nav_msgs/Path in, whose header says when the first one began.

        Returns
        -------
        (K, 4, 4) float64 or None
            How those that are known already have moved, by their number; none, where all stayed.

        Raises
        ------
        InputError
            If it is in another frame, or a pose is none.
        """
        decode.require_frame(message.header, frame)
        begun_ns, poses = decode.stamp_ns(message.header), decode.path_poses(message)
        before, self._poses = self._poses, poses
        is_same = begun_ns == self.begun_ns and len(poses) >= len(before)
        self.begun_ns, self.newest = begun_ns, len(poses)
        if not is_same or not len(before):
            return None
        motions = np.stack([
            np.eye(4), *(now @ se3.inverse(then) for now, then in zip(poses, before, strict=False))
        ])  # fmt: skip
        return None if np.allclose(motions, np.eye(4), rtol=0.0, atol=_STAYED) else motions
