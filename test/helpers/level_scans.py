# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans of a level laser in rooms of straight walls, whose beams are intersected in closed form."""

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.mapping.sensor_model import Beams

ANGLES = np.radians(np.arange(-120.0, 120.5, 1.0))
REACH = 20.0  # [m] of the laser
ROOM = [
    ((-3.0, -2.0), (5.0, -2.0)), ((5.0, -2.0), (5.0, 4.0)), ((5.0, 4.0), (-3.0, 4.0)),
    ((-3.0, 4.0), (-3.0, -2.0)), ((1.0, 2.0), (1.8, 2.0)), ((1.8, 2.0), (1.8, 3.0)),
]  # fmt: skip
CORRIDOR = [((-100.0, -1.0), (100.0, -1.0)), ((-100.0, 1.2), (100.0, 1.2))]


def planar(x, y, yaw, tilt=0.0):
    return se3.from_xyz_rpy([x, y, 0.0, 0.0, tilt, yaw])


def ranges(walls, x, y, yaw):
    """How far beams reach that begin at a place: to the nearest crossing of a wall."""
    rays = np.column_stack([np.cos(yaw + ANGLES), np.sin(yaw + ANGLES)])
    nearest = np.full(len(ANGLES), np.inf)
    for begin, end in np.array(walls):
        along = end - begin
        across = rays[:, 0] * along[1] - rays[:, 1] * along[0]
        to = begin - (x, y)
        across = np.where(across == 0.0, 1e-12, across)
        away = (to[0] * along[1] - to[1] * along[0]) / across
        share = (to[0] * rays[:, 1] - to[1] * rays[:, 0]) / across
        is_met = (away > 0.0) & (share >= 0.0) & (share <= 1.0)
        nearest = np.where(is_met, np.minimum(nearest, away), nearest)
    return nearest


def scan(walls, true, told, fall=0.0):
    """Beams in the frame of the wheels of a robot that is at a place, and told to be at another."""
    away = ranges(walls, *true)
    is_hit = away < REACH
    away = np.where(is_hit, away, REACH)
    ends = np.column_stack([away * np.cos(ANGLES), away * np.sin(ANGLES), -fall * away])
    return Beams(
        origins=np.broadcast_to(told[:3, 3], ends.shape).copy(),
        ends=se3.transform_points(told, ends), is_hit=is_hit, is_lone=np.zeros(len(away), bool),
    )  # fmt: skip
