# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A 3-D lidar and a depth camera: their mounts and their beams.

Both take scans as lasers do (`lasers.take_scan`), with more beams in more directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import pi, radians, tan
from typing import ClassVar

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.simulation.lasers import RANGE_MAX, RangeNoise

FEWEST_RINGS, MOST_RINGS = 8, 128
"""Of a lidar."""


@dataclass(frozen=True, kw_only=True)
class Lidar:
    """A spinning lidar of the Ouster OS1 class; its columns of beams follow one another in time.

    Attributes
    ----------
    topic, frame_id : str
    position : (3,) float [m]
        In base_link; it stands upright.
    rings : int
        Beams of a column, evenly from `LOWEST` to `HIGHEST`.
    columns : int
        Of a turn.
    rate : float [Hz]
    first_scan : float [s]
    reach : float [m]
        Farthest range.
    nod : float [rad]
        It is fixed.
    """

    LOWEST: ClassVar[float] = radians(-25.0)
    HIGHEST: ClassVar[float] = radians(15.0)

    topic: str = "/points"
    frame_id: str = "lidar"
    position: tuple[float, float, float] = (0.0, 0.0, 0.9)
    rings: int = 32
    columns: int = 512
    rate: float = 10.0
    first_scan: float = 0.02
    reach: float = RANGE_MAX
    nod: float = 0.0

    @property
    def duration(self) -> float:
        """Of a turn [s]."""
        return 1.0 / self.rate

    @property
    def shape(self) -> tuple[int, int]:
        """Rings and columns of the cloud."""
        return self.rings, self.columns

    def T_base_sensor(self, seconds: Array) -> se3.Matrix:
        """(N, 4, 4): the mount at times [s]."""
        return _fixed(se3.from_xyz_rpy([*self.position, 0.0, 0.0, 0.0]), seconds)

    def beam_times(self, start: float) -> Array:
        """(rings * columns,) [s]: time of each beam, ring by ring."""
        return np.tile(start + np.arange(self.columns) * (self.duration / self.columns), self.rings)

    @cached_property
    def directions(self) -> Array:
        """(rings * columns, 3): in the sensor's frame, ring by ring from the highest down."""
        elevation = np.linspace(self.HIGHEST, self.LOWEST, self.rings)[:, None]
        azimuth = np.arange(self.columns) * (2 * pi / self.columns)
        level = np.cos(elevation)
        up = np.broadcast_to(np.sin(elevation), self.shape)
        return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), up], -1).reshape(-1, 3)

    def deviations(self, noise: RangeNoise, ranges: Array) -> Array:
        """(N,) [m]: standard deviation of ranges (N,) [m]; twice that of a planar laser."""
        return np.full(len(ranges), 2.0 * noise.sigma)


@dataclass(frozen=True, kw_only=True)
class DepthCamera:
    """A depth camera of the RealSense D435 class, in frames of rows, all at one time.

    Attributes
    ----------
    topic, frame_id : str
        The frame is the optical one: z ahead, x to the right.
    position : (3,) float [m]
        In base_link.
    pitch : float [rad]
        Positive: downward.
    rows, columns : int
    width_angle : float [rad]
        Of the picture; the pixels are square.
    reach : float [m]
        Farthest range.
    range_noise : float [1/m]
        Standard deviation of a range is this times its square, at a `RangeNoise.sigma` of 1 cm.
    rate : float [Hz]
    first_scan : float [s]
    nod : float [rad]
        It is fixed.
    duration : float [s]
        All of a frame is of one time.
    """

    topic: str = "/depth/points"
    frame_id: str = "depth_optical"
    position: tuple[float, float, float] = (0.35, 0.0, 0.5)
    pitch: float = radians(25.0)
    rows: int = 60
    columns: int = 106
    width_angle: float = radians(86.0)
    reach: float = 6.0
    range_noise: float = 0.002
    rate: float = 15.0
    first_scan: float = 0.03
    nod: float = 0.0
    duration: ClassVar[float] = 0.0

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the cloud."""
        return self.rows, self.columns

    def T_base_sensor(self, seconds: Array) -> se3.Matrix:
        """(N, 4, 4): the mount at times [s]."""
        body = se3.from_xyz_rpy([*self.position, 0.0, self.pitch, 0.0])
        optical = se3.from_xyz_rpy([0.0, 0.0, 0.0, -pi / 2, 0.0, -pi / 2])
        return _fixed(body @ optical, seconds)

    def beam_times(self, start: float) -> Array:
        """(rows * columns,) [s]: the same for all."""
        return np.full(self.rows * self.columns, start)

    @cached_property
    def directions(self) -> Array:
        """(rows * columns, 3): in the optical frame, row by row from the top."""
        focal = self.columns / 2 / tan(self.width_angle / 2)  # [pixels]
        x = (np.arange(self.columns) + 0.5 - self.columns / 2) / focal
        y = (np.arange(self.rows) + 0.5 - self.rows / 2) / focal
        rays = np.stack([*np.meshgrid(x, y), np.ones(self.shape)], axis=-1).reshape(-1, 3)
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))

    def deviations(self, noise: RangeNoise, ranges: Array) -> Array:
        """(N,) [m]: standard deviation of ranges (N,) [m]."""
        near = np.minimum(ranges, self.reach)
        return np.asarray(noise.sigma / RangeNoise().sigma * self.range_noise * near**2)


def _fixed(T: se3.Matrix, seconds: Array) -> se3.Matrix:
    return np.broadcast_to(T, (len(seconds), 4, 4))
