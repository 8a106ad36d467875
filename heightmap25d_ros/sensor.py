# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scan, the mount of its laser and the poses of the robot become beams in the map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.params import SensorParams


@dataclass(frozen=True, slots=True, kw_only=True)
class Scan:
    """One planar scan, as sensor_msgs/LaserScan.

    Attributes
    ----------
    stamp_ns : int [ns]
        Of the first beam.
    frame_id : str
    angle_min, angle_increment : float [rad]
    time_increment : float [s]
        Between beams; negative where the laser turns the other way round in time.
    range_min, range_max : float [m]
    ranges : (N,) float32 [m]
    """

    stamp_ns: int
    frame_id: str
    angle_min: float
    angle_increment: float
    time_increment: float
    range_min: float
    range_max: float
    ranges: NDArray[np.float32]

    def beam_stamps_ns(self) -> NDArray[np.int64]:
        """(N,) int64: when each beam was taken; (1,) where all were at once."""
        count = len(self.ranges) if self.time_increment else 1
        offsets = np.arange(count) * (self.time_increment * 1e9)
        stamps: NDArray[np.int64] = self.stamp_ns + np.rint(offsets).astype(np.int64)
        return stamps


@dataclass(frozen=True, slots=True, kw_only=True)
class Beams:
    """Straight lines through empty space; those that hit end on an object.

    Attributes
    ----------
    origins : (N, 3) float64 [m], map
        The laser at each beam's own time.
    ends : (N, 3) float64 [m], map
    is_hit : (N,) bool
        Whether the end is the top of an object as far as this beam can tell; otherwise the
        beam only clears.
    """

    origins: NDArray[np.float64]
    ends: NDArray[np.float64]
    is_hit: NDArray[np.bool_]


def beams(
    scan: Scan, T_map_base: se3.Matrix, T_base_sensor: se3.Matrix, params: SensorParams
) -> Beams:
    """Beams of a scan in the map frame, by REP-117.

    +inf: no return, clears to ``clearing_range`` or ``range_max``, the nearer one. NaN, -inf and
    values outside of ``range_min .. range_max`` or below ``min_range``: no beam. Returns beyond ``max_range``
    clear up to there, and returns outside of the window ``min_height .. max_height`` above
    base_link clear up to the return; neither hits.

    Parameters
    ----------
    scan : Scan
    T_map_base, T_base_sensor : (N, 4, 4) or (1, 4, 4) float64
        At each beam's own time.
    params : SensorParams
    """
    ranges = scan.ranges.astype(np.float64)
    nearest = max(scan.range_min, params.min_range)
    is_return = (ranges >= nearest) & (ranges <= scan.range_max)
    is_miss = ranges == np.inf
    cleared = min(params.clearing_range, scan.range_max)
    reach = np.where(is_miss, cleared, np.minimum(ranges, params.max_range))
    used = (is_return | is_miss) & (reach > 0.0)

    T_map_sensor = T_map_base @ T_base_sensor
    origins = np.broadcast_to(T_map_sensor[:, :3, 3], (len(ranges), 3))[used]
    base_z = np.broadcast_to(T_map_base[:, 2, 3], len(ranges))[used]
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    axes = np.broadcast_to(T_map_sensor[:, :3, :2], (len(ranges), 3, 2))[used]
    direction = axes[:, :, 0] * np.cos(angles[used])[:, None]
    direction += axes[:, :, 1] * np.sin(angles[used])[:, None]
    ends = origins + reach[used, None] * direction

    above_base = ends[:, 2] - base_z
    in_window = (above_base >= params.min_height) & (above_base <= params.max_height)
    is_hit = is_return[used] & (ranges[used] <= params.max_range) & in_window
    return Beams(origins=np.ascontiguousarray(origins), ends=ends, is_hit=is_hit)
