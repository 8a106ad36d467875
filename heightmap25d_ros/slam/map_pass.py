# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drive held against a finished map that others have made as well.

Its own poses fit together. Against the map they take the place of the odometry.
"""

from __future__ import annotations

from dataclasses import replace
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

_START = np.diag(np.square([0.05, 0.05, 0.01]))  # of a given pose
_APART, _APART_YAW = 0.3, 0.1  # [m], [rad] between two that disagree


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
    """Localization on a finished map, which begins, and begins anew, at given poses.

    Parameters
    ----------
    landmarks : Landmarks
        Of the finished map.
    params : Params

    Attributes
    ----------
    disagreed : float [m]
        Travelled where the map and the given poses disagree: there these are kept.
    """

    def __init__(self, landmarks: Landmarks, params: Params) -> None:
        self.disagreed = 0.0
        self._landmarks, self._params = landmarks, params
        self._window = ScanWindow(params.scan_filter)
        self._estimate: ScanFilter | None = None  # of the given poses' frame in the map
        self._given = np.eye(4)
        self._distance = 0.0
        self._is_sure = True

    def pose(self, beams: Beams, T_odom_base: se3.Matrix, given: ScanPose) -> ScanPose:
        """Where a scan was taken, from its beams in odom and where it is thought to be."""
        travelled = 0.0
        before, self._given = self._given, given.T_map_odom @ T_odom_base
        if self._estimate is None:
            self._estimate = self._begun()
        else:
            travelled = distance_travelled(before, self._given)
            self._estimate.predict(before, self._given)
        self._distance += travelled
        ends = np.ascontiguousarray(se3.transform_points(given.T_map_odom, beams.ends))
        self._window.add(replace(beams, ends=ends), given.stamp_ns)
        if self._window.is_due(self._distance, given.stamp_ns):
            returns = self._window.take(self._distance, given.stamp_ns)
            found = self._estimate.update(returns, self._given, self._landmarks)
            self._is_sure = found.reason not in CONTRADICTIONS
            if self._is_sure:
                self._window.confirm()
        if is_apart(self._given, self._estimate.T_map_odom @ self._given):
            self.disagreed += travelled
            self._estimate = self._begun()
            return given
        T_map_odom = self._estimate.T_map_odom @ given.T_map_odom
        return given._replace(T_map_odom=T_map_odom, is_sure=self._is_sure)

    def _begun(self) -> ScanFilter:
        errors = unknown_errors(self._params) if self._estimate is None else self._estimate.errors
        return ScanFilter(self._params, np.eye(4), _START, errors)


def is_apart(one: se3.Matrix, other: se3.Matrix) -> bool:
    """Whether two poses (4, 4) of the robot are too far apart for both to be right."""
    turn = abs(se3.yaw(other @ se3.inverse(one)))
    return bool(np.hypot(*(other - one)[:2, 3]) > _APART) or turn > _APART_YAW
