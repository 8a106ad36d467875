# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One drive down a ramp as in Fig. 2 of the paper: the world, the robot, what its lasers measure.

What is in the world and what the drive looks like is told in bags/README.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import inf, pi, radians

import numpy as np
from analytic_worlds import Array, World, box, plane, ramp, scan_directions
from scipy.spatial.transform import Rotation

RESOLUTION, ORIGIN, SHAPE = 0.125, (-2.0, -4.0), (64, 256)
"""The mapped area: the paper's 256 x 64 cells."""

GROUND, PIT, SLOPE = -1.5, -1.9, -1.5 / 12.0
"""Heights of the yard and of a pit in it above the start, and slope of the ramp."""

WORLD = World(
    [
        plane(PIT),
        box((-inf, 22.56), (-inf, inf), GROUND),
        box((22.56, 25.44), (-1.94, inf), GROUND),
        box((25.44, inf), (-inf, inf), GROUND),
        box((-inf, 29.81), (3.06, inf), 3.0),  # the building
        box((-inf, 29.81), (-inf, -3.70), 1.0),  # the wall of the yard
        box((29.56, 29.81), (-4.0, 3.06), -0.5),  # the low wall at the end
        box((-inf, 4.0), (-1.56, 3.06), 0.0),  # the landing where the drive starts
        ramp((4.0, 16.0), (-1.56, 1.44), (0.0, GROUND)),
        box((4.0, 19.94), (1.44, 3.06), 0.0),  # the upper deck, a cliff along the ramp
        ramp((6.06, 11.06), (-1.56, -1.41), (SLOPE * 2.06 + 0.15, SLOPE * 7.06 + 0.15)),  # kerb
        box((1.06, 1.21), (-1.31, -0.69), 0.08),  # wheel stop, low enough to climb
        box((2.19, 2.81), (2.19, 2.81), 0.45),  # crate on the landing
        box((8.31, 9.06), (-3.31, -2.56), -0.9),  # crate in the yard, beside the ramp
        box((17.94, 18.56), (-2.94, -2.31), -1.0),  # crate in the yard
        ramp((19.56, 19.94), (0.06, 1.31), (GROUND, GROUND + 0.06)),  # a hump under the left
        ramp((19.94, 20.31), (0.06, 1.31), (GROUND + 0.06, GROUND)),  # ... wheels
        box((21.06, 22.31), (-2.44, -1.56), GROUND + 0.14),  # pallet
        box((20.94, 29.56), (2.06, 3.06), GROUND + 0.12),  # pavement with a kerb
        box((22.94, 23.19), (-1.06, -0.81), -0.6),  # bollard
        box((24.19, 25.06), (1.06, 1.69), -0.4),  # cabinet
    ]
)

REST, TOP_SPEED, DISTANCE = 0.3, 1.0, 26.0
"""The robot stands for a moment [s], then drives along x: speed [m/s], way [m]."""
WEAVE, WAVELENGTH = 0.35, 11.0
"""[m]"""

WHEELS = np.array([(dx, dy) for dx in (-0.25, 0.25) for dy in (-0.28, 0.28)])
"""Where the wheels of the ATRV-Jr stand [m], base_link."""


def _along(seconds: Array) -> Array:
    """How far along x [m]: the speed rises in one second, stays, and falls in one second."""
    driven = np.clip(seconds - REST, 0.0, DISTANCE / TOP_SPEED + 1.0)
    cruise_end = DISTANCE / TOP_SPEED
    speeding = 0.5 * np.minimum(driven, 1.0) ** 2
    slowing = 0.5 * np.maximum(driven - cruise_end, 0.0) ** 2
    return TOP_SPEED * (speeding + np.maximum(driven - 1.0, 0.0) - slowing)


DURATION = REST + DISTANCE / TOP_SPEED + 1.0 + REST


def poses(seconds: Array) -> Array:
    """(N, 4, 4): true T_map_base, the four wheels on the ground.

    base_link lies on the plane through the wheels' contacts, below the middle of the robot.
    """
    x = _along(seconds)
    y = -WEAVE * np.sin(2 * pi * x / WAVELENGTH)
    heading = np.arctan(-WEAVE * 2 * pi / WAVELENGTH * np.cos(2 * pi * x / WAVELENGTH))
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    # A tyre bridges what is narrower than its contact.
    contact = np.linspace(-0.08, 0.08, 9)
    dx = WHEELS[:, 0, None] + contact
    dy = np.broadcast_to(WHEELS[:, 1, None], dx.shape)
    points = np.stack([x, y], axis=-1)[:, None, None] + (
        dx[None, ..., None] * ahead[:, None, None] + dy[None, ..., None] * aside[:, None, None]
    )
    z = WORLD.top(points[..., 0], points[..., 1]).mean(axis=-1)
    slope_ahead = z @ WHEELS[:, 0] / (WHEELS[:, 0] ** 2).sum()
    slope_aside = z @ WHEELS[:, 1] / (WHEELS[:, 1] ** 2).sum()

    forward = np.concatenate([ahead, slope_ahead[:, None]], axis=-1)
    left = np.concatenate([aside, slope_aside[:, None]], axis=-1)
    up = np.cross(forward, left)
    T = np.zeros((len(x), 4, 4))
    T[:, :3, 0] = forward / np.linalg.norm(forward, axis=-1, keepdims=True)
    T[:, :3, 2] = up / np.linalg.norm(up, axis=-1, keepdims=True)
    T[:, :3, 1] = np.cross(T[:, :3, 2], T[:, :3, 0])
    T[:, :3, 3] = np.stack([x, y, z.mean(axis=-1)], axis=-1)
    T[:, 3, 3] = 1.0
    return T


@dataclass(frozen=True, slots=True, kw_only=True)
class Laser:
    """A SICK LMS-200 on the robot."""

    topic: str
    frame_id: str
    position: tuple[float, float, float]
    pitch: float
    first_scan: float
    """[s] after the start: the two mirrors turn independently."""
    seed: int

    @property
    def T_base_sensor(self) -> Array:
        """The mount; a positive pitch looks down."""
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("y", self.pitch).as_matrix()
        T[:3, 3] = self.position
        return T


LASERS = (
    Laser(topic="/scan", frame_id="laser", position=(0.30, 0.0, 0.40), pitch=0.0,
          first_scan=0.0200, seed=1),
    Laser(topic="/scan_down", frame_id="laser_down", position=(0.28, 0.0, 0.60),
          pitch=radians(28.0), first_scan=0.0287, seed=2),
)  # fmt: skip
SCAN_PERIOD = 1.0 / 37.5
SCAN_DURATION = 1.0 / 75.0
TIME_INCREMENT = SCAN_DURATION / 361
ANGLES = np.radians(np.arange(361) * 0.5 - 90.0)
RANGE_MIN, RANGE_MAX, RANGE_NOISE, RANGE_STEP = 0.05, 30.0, 0.01, 0.001


@dataclass(frozen=True, slots=True)
class TakenScan:
    """One scan: start [s], (N,) true ranges, (N,) measured ranges, (N, 3) true end points."""

    start: float
    true_ranges: Array
    ranges: Array
    ends: Array


def take_scans(laser: Laser, duration: float = DURATION) -> Iterator[TakenScan]:
    """The scans of one laser up to a time [s], each beam at its own time and with its own noise."""
    rng = np.random.default_rng(laser.seed)
    for start in np.arange(laser.first_scan, duration - SCAN_DURATION, SCAN_PERIOD):
        T_map_sensor = poses(start + TIME_INCREMENT * np.arange(len(ANGLES))) @ laser.T_base_sensor
        directions = scan_directions(T_map_sensor, ANGLES)
        true_ranges = WORLD.ranges(T_map_sensor[:, :3, 3], directions)
        measured = true_ranges + rng.normal(0.0, RANGE_NOISE, len(ANGLES))
        measured = np.rint(measured / RANGE_STEP) * RANGE_STEP
        measured[~((measured >= RANGE_MIN) & (measured <= RANGE_MAX))] = inf
        reach = np.where(np.isfinite(true_ranges), true_ranges, np.nan)
        yield TakenScan(
            float(start),
            true_ranges,
            measured,
            T_map_sensor[:, :3, 3] + reach[:, None] * directions,
        )


def seen_height(scans: Iterable[TakenScan]) -> Array:
    """(rows, columns) [m]: highest point of each cell that a noise-free beam met, else NaN."""
    seen = np.full(SHAPE, -inf)
    for scan in scans:
        ends = scan.ends[np.isfinite(scan.ranges)]
        ix, iy = np.floor((ends[:, :2] - ORIGIN) / RESOLUTION).astype(int).T
        inside = (ix >= 0) & (ix < SHAPE[1]) & (iy >= 0) & (iy < SHAPE[0])
        np.maximum.at(seen, (iy[inside], ix[inside]), ends[inside, 2])
    return np.where(np.isfinite(seen), seen, np.nan)
