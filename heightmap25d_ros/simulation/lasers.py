# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Laser scanners of the SICK LMS-200 class: their mounts, and noisy scans of a scene.

`take_scan` takes the scans of all sensors, also those of `cloud_sensors`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi, radians
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.simulation.scene import Scene

RANGE_MIN, RANGE_MAX = 0.05, 30.0
BEAMS = 361
ANGLE_INCREMENT = pi / (BEAMS - 1)
ANGLES = np.arange(BEAMS) * ANGLE_INCREMENT - pi / 2
SCAN_DURATION = 1.0 / 75.0
TIME_INCREMENT = SCAN_DURATION / BEAMS


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeNoise:
    """Noise of ranges; all zero: exact.

    Attributes
    ----------
    sigma : float [m]
        Gaussian.
    step : float [m]
        Ranges are whole multiples of it.
    dropout : float
        Share of the beams that return nothing.
    short : float
        Share of the beams that return from somewhere before the surface.
    mixed, mixed_step : float, float [m]
        Where neighbouring ranges differ by more than the step, one of the two is, with this
        probability, a value between them.
    """

    sigma: float = 0.01
    step: float = 0.001
    dropout: float = 0.002
    short: float = 0.001
    mixed: float = 0.15
    mixed_step: float = 0.10


class RangeSensor(Protocol):
    """What `take_scan` needs to know of a sensor; all directions are in its own frame."""

    @property
    def shape(self) -> tuple[int, int]:
        """Lines of neighbouring beams, and beams of a line."""

    @property
    def duration(self) -> float:
        """Of a scan, from its first beam to its end [s]."""

    @property
    def reach(self) -> float:
        """Farthest range [m]."""

    @property
    def directions(self) -> Array:
        """(N, 3): unit vectors, line by line."""

    def beam_times(self, start: float) -> Array:
        """(N,) [s]: time of each beam of a scan."""

    def T_base_sensor(self, seconds: Array) -> se3.Matrix:
        """(N, 4, 4): the mount at times [s]."""

    def deviations(self, noise: RangeNoise, ranges: Array) -> Array:
        """(N,) [m]: standard deviations of ranges (N,) [m]."""


EXACT_RANGES = RangeNoise(sigma=0.0, step=0.0, dropout=0.0, short=0.0, mixed=0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Laser:
    """A laser and its mount in base_link; a positive pitch is downward.

    Attributes
    ----------
    position : (3,) float [m]
    pitch : float [rad]
    nod, nod_period : float [rad], [s]
        Amplitude and period of nodding about that pitch; amplitude 0: fixed.
    rate : float [Hz]
    first_scan : float [s]
        Start of the first scan; the mirrors are not synchronized.
    """

    topic: str
    frame_id: str
    position: tuple[float, float, float]
    pitch: float = 0.0
    nod: float = 0.0
    nod_period: float = 3.0
    rate: float = 37.5
    first_scan: float = 0.02

    @property
    def shape(self) -> tuple[int, int]:
        """One line of beams."""
        return 1, BEAMS

    @property
    def duration(self) -> float:
        """Of a scan [s]."""
        return SCAN_DURATION

    @property
    def reach(self) -> float:
        """Farthest range [m]."""
        return RANGE_MAX

    @property
    def directions(self) -> Array:
        """(361, 3): in the plane of the scan."""
        return np.stack([np.cos(ANGLES), np.sin(ANGLES), np.zeros(BEAMS)], axis=1)

    def beam_times(self, start: float) -> Array:
        """(361,) [s]: see `beam_times`."""
        return beam_times(start)

    def deviations(self, noise: RangeNoise, ranges: Array) -> Array:
        """(N,) [m]: the same for all ranges (N,) [m]."""
        return np.full(len(ranges), noise.sigma)

    def T_base_sensor(self, seconds: Array) -> se3.Matrix:
        """(N, 4, 4): the mount at times [s]."""
        poses = np.zeros((len(seconds), 6))
        poses[:, :3] = self.position
        poses[:, 4] = self.pitch + self.nod * np.sin(2 * pi * seconds / self.nod_period)
        return se3.from_xyz_rpy(poses)


LEVEL = Laser(topic="/scan", frame_id="laser", position=(0.30, 0.0, 0.40))
DOWN = Laser(topic="/scan_down", frame_id="laser_down", position=(0.28, 0.0, 0.60),
             pitch=radians(28.0), first_scan=0.031)  # fmt: skip
NODDING = Laser(topic="/scan_nod", frame_id="laser_nod", position=(0.25, 0.0, 0.70),
                pitch=radians(25.0), nod=radians(25.0), first_scan=0.026)  # fmt: skip


@dataclass(frozen=True, slots=True)
class TakenScan:
    """A scan and its ground truth.

    Attributes
    ----------
    start : float [s]
    ranges : (N,) float64 [m]
        As measured; infinite: no return.
    ends : (N, 3) float64 [m], map
        True end of each beam; NaN: no surface within reach.
    base_z : (N,) float64 [m], map
        Of base_link at each beam's time.
    mover : (N,) int32
        Index of the moving object that was hit, or -1.
    """

    start: float
    ranges: Array
    ends: Array
    base_z: Array
    mover: NDArray[np.int32]


def beam_times(start: float) -> Array:
    """(361,) [s]: time of each beam of a scan."""
    return np.asarray(start + TIME_INCREMENT * np.arange(BEAMS), np.float64)


def take_scan(
    sensor: RangeSensor,
    scene: Scene,
    start: float,
    T_map_base: se3.Matrix,
    noise: RangeNoise,
    rng: np.random.Generator,
) -> TakenScan:
    """One scan, each beam from its own pose.

    Parameters
    ----------
    start : float [s]
    T_map_base : (N, 4, 4) float64
        True poses at the times of its beams.
    """
    T_map_sensor = T_map_base @ sensor.T_base_sensor(sensor.beam_times(start))
    axes, own = T_map_sensor[:, :3, :3], sensor.directions
    directions = (
        axes[:, :, 0] * own[:, :1] + axes[:, :, 1] * own[:, 1:2] + axes[:, :, 2] * own[:, 2:]
    )
    # Moving objects are static during a scan.
    scene.set_time(start + 0.5 * sensor.duration)
    ranges, mover = scene.ranges(T_map_sensor[:, :3, 3], directions)
    reach = np.where(ranges <= sensor.reach, ranges, np.nan)
    ends = T_map_sensor[:, :3, 3] + reach[:, None] * directions
    lines = ranges.reshape(sensor.shape)
    noisy = np.concatenate([measured(line, noise, rng, sensor) for line in lines])
    return TakenScan(start, noisy, ends, T_map_base[:, 2, 3], mover)


def measured(
    ranges: Array, noise: RangeNoise, rng: np.random.Generator, sensor: RangeSensor | None = None
) -> Array:
    """Measured ranges (N,) [m] of true ones of neighbours; infinite where nothing returns."""
    sensor = sensor or LEVEL
    deviations = sensor.deviations(noise, ranges)
    result = _mixed(ranges, noise, rng) + rng.normal(0.0, 1.0, len(ranges)) * deviations
    is_short = rng.random(len(ranges)) < noise.short
    shortened = rng.uniform(RANGE_MIN, np.clip(ranges, RANGE_MIN, sensor.reach))
    result = np.where(is_short, shortened, result)
    if noise.step:
        result = np.rint(result / noise.step) * noise.step
    is_lost = rng.random(len(ranges)) < noise.dropout
    in_reach = (result >= RANGE_MIN) & (result <= sensor.reach)
    return np.where(in_reach & ~is_lost, result, inf)


def _mixed(ranges: Array, noise: RangeNoise, rng: np.random.Generator) -> Array:
    """At depth discontinuities the spot of a beam covers both surfaces."""
    near, far = ranges[:-1], ranges[1:]
    both = np.isfinite(near) & np.isfinite(far)
    difference = np.subtract(far, near, where=both, out=np.zeros(len(near)))
    is_mixed = (np.abs(difference) > noise.mixed_step) & (rng.random(len(near)) < noise.mixed)
    between = near + rng.random(len(near)) * difference
    index = np.arange(len(near)) + (rng.random(len(near)) < 0.5)
    result = ranges.copy()
    result[index[is_mixed]] = between[is_mixed]
    return result
