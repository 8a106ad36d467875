# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drive held against a finished map, beside the poses that the map was made of.

In the map that a pass makes, what was seen first was inserted before anything was known of the
rest. Held against all of it, each pose is known as well as the last ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.localization.landmarks import Landmarks
from heightmap25d_ros.localization.odometry_errors import unknown_errors
from heightmap25d_ros.localization.scan_filter import ScanFilter
from heightmap25d_ros.localization.scan_window import ScanWindow
from heightmap25d_ros.localization.short_term import distance_travelled
from heightmap25d_ros.localization.tracking_state import CONTRADICTIONS
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import Params

_START = np.diag(np.square([0.05, 0.05, 0.01]))  # of a pose of the pass before
_APART, _APART_YAW = 0.3, 0.1  # [m], [rad] between two passes, beyond which they disagree


class ScanPose(NamedTuple):
    """Where a scan was taken.

    Attributes
    ----------
    stamp_ns : int [ns]
    T_map_odom : (4, 4) float64
        Pose of the odometry's frame in the map.
    is_sure : bool
        Otherwise the map contradicts it.
    """

    stamp_ns: int
    T_map_odom: se3.Matrix
    is_sure: bool


class MapPass:
    """Localization on a finished map, which begins, and begins anew, at poses of the pass before.

    Parameters
    ----------
    landmarks : Landmarks
        Of the finished map.
    params : Params

    Attributes
    ----------
    disagreed : float [m]
        Travelled where the passes disagree: there the poses are those of the pass before.
    """

    def __init__(self, landmarks: Landmarks, params: Params) -> None:
        self.disagreed = 0.0
        self._landmarks, self._params = landmarks, params
        self._window = ScanWindow(params.scan_filter)
        self._estimate: ScanFilter | None = None
        self._T_odom_base = np.eye(4)
        self._distance = 0.0
        self._is_sure = True

    def pose(self, beams: Beams, T_odom_base: se3.Matrix, before: ScanPose) -> ScanPose:
        """Where a scan was taken, from its beams in odom and what the pass before has found."""
        travelled = 0.0
        if self._estimate is None:
            self._estimate = self._begun_at(before.T_map_odom)
        else:
            travelled = distance_travelled(self._T_odom_base, T_odom_base)
            self._estimate.predict(self._T_odom_base, T_odom_base)
        self._T_odom_base = T_odom_base
        self._distance += travelled
        self._window.add(beams, before.stamp_ns)
        if self._window.is_due(self._distance, before.stamp_ns):
            returns = self._window.take(self._distance, before.stamp_ns)
            found = self._estimate.update(returns, T_odom_base, self._landmarks)
            self._is_sure = found.reason not in CONTRADICTIONS
            if self._is_sure:
                self._window.confirm()
        if self._is_apart(before.T_map_odom, T_odom_base):
            self.disagreed += travelled
            self._estimate = self._begun_at(before.T_map_odom)
            return before
        return before._replace(T_map_odom=self._estimate.T_map_odom, is_sure=self._is_sure)

    def _begun_at(self, T_map_odom: se3.Matrix) -> ScanFilter:
        errors = unknown_errors(self._params) if self._estimate is None else self._estimate.errors
        return ScanFilter(self._params, T_map_odom, _START, errors)

    def _is_apart(self, T_map_odom: se3.Matrix, T_odom_base: se3.Matrix) -> bool:
        assert self._estimate is not None
        apart = self._estimate.T_map_odom @ se3.inverse(T_map_odom)
        moved = ((apart - np.eye(4)) @ T_map_odom @ T_odom_base)[:2, 3]
        turn = abs(se3.yaw(apart))
        return float(np.hypot(*moved)) > _APART or turn > _APART_YAW
