# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pose of the odometry's frame in the map: what localization says, kept over jumps."""

from __future__ import annotations

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.pipelines.odometry_gate import OdometryGate


class MapCorrection:
    """The correction of the odometry; where that jumps, the robot stays where it was in the map.

    Parameters
    ----------
    gate : OdometryGate
        Which knows the frames of the odometry.
    is_bridging : bool
        Whether the jumps are bridged here; otherwise the poses jump with the odometry.
    """

    def __init__(self, gate: OdometryGate, *, is_bridging: bool) -> None:
        self._gate = gate
        self._is_bridging = is_bridging
        self._T_map_odom = self._T_map_first = np.eye(4)

    def set(self, T_map_odom: se3.Matrix, stamp_ns: int = 0) -> None:
        """Pose (4, 4) of the frame that the odometry has at a stamp."""
        self._T_map_odom = T_map_odom
        self._T_map_first = T_map_odom @ se3.inverse(self._gate.T_first_odom(stamp_ns))

    def begin_anew(self) -> None:
        """The odometry's present frame is the one that the correction is about."""
        self._gate.begin_anew()
        self._T_map_first = self._T_map_odom

    def restart(self, same_from_ns: int | None = None) -> None:
        """Time started over; from a stamp [ns] on in the newest frame, or in the first one."""
        self._gate.restart(same_from_ns)
        if same_from_ns is None:
            self._T_map_first = self._T_map_odom

    def T_map_odom(self, stamp_ns: int) -> se3.Matrix:
        """Pose (4, 4) of the odometry's frame of a stamp in the map."""
        if not self._is_bridging:
            return self._T_map_odom
        return np.asarray(self._T_map_first @ self._gate.T_first_odom(stamp_ns))
