# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A kinematic robot like the ATRV-Jr that follows the terrain.

Its four wheels are on the surface below them, which determines height, roll and pitch. There is no
slip, no mass, and no suspension beyond the mean over a tyre's contact.
"""

from __future__ import annotations

import numpy as np

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.simulation.scene import Scene

LENGTH, WIDTH, HEIGHT = 0.78, 0.64, 0.70
"""[m]; up to the upper laser. The body alone is 0.55 m high."""

MAX_STEP = 0.10
"""Wheels climb at most this [m]."""

CLEARANCE = 0.13
"""Obstacles higher than this above the plane of the wheels touch the body [m]."""

MAX_SPEED, MAX_TURN_RATE = 1.5, 1.5
MAX_ACCELERATION, MAX_TURN_ACCELERATION = 1.0, 3.0
"""[m/s], [rad/s], [m/s^2], [rad/s^2]"""

_WHEELS = np.array([(x, y) for x in (-0.25, 0.25) for y in (-0.28, 0.28)])
_CONTACT = np.linspace(-0.08, 0.08, 9)
_TYRES = (_WHEELS[:, None, :] + np.stack([_CONTACT, np.zeros(9)], axis=-1)).reshape(-1, 2)
_OUTLINE = np.array(
    [(x, side * WIDTH / 2) for x in np.linspace(-LENGTH / 2, LENGTH / 2, 13) for side in (-1, 1)]
    + [(side * LENGTH / 2, y) for y in np.linspace(-WIDTH / 2, WIDTH / 2, 15) for side in (-1, 1)]
)


class Robot:
    """Pose and speed of the robot.

    Parameters
    ----------
    scene : Scene
        The robot starts at its origin, along x.

    Attributes
    ----------
    T : (4, 4) float64 [m], map
        Pose of base_link, on the plane of the wheels' contacts below the middle of the robot.
    speed, turn_rate : float [m/s], [rad/s]
    is_blocked : bool
        Whether it was stopped by a step that is too high.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._xy, self._yaw = np.zeros(2), 0.0
        self._contacts = np.zeros(4)
        self.speed, self.turn_rate, self.is_blocked = 0.0, 0.0, False
        self.T = np.eye(4)
        tyres = self._tyres(self._xy, self._yaw)
        self._settle(tyres.mean(axis=1))

    def move(self, speed: float, turn_rate: float, seconds: float) -> None:
        """Drive for a time step towards a commanded speed [m/s] and turn rate [rad/s]."""
        speed = float(np.clip(speed, -MAX_SPEED, MAX_SPEED))
        turn_rate = float(np.clip(turn_rate, -MAX_TURN_RATE, MAX_TURN_RATE))
        change, turn_change = MAX_ACCELERATION * seconds, MAX_TURN_ACCELERATION * seconds
        self.speed += float(np.clip(speed - self.speed, -change, change))
        self.turn_rate += float(np.clip(turn_rate - self.turn_rate, -turn_change, turn_change))
        if not (self.speed or self.turn_rate):
            return
        yaw = self._yaw + self.turn_rate * seconds
        middle = 0.5 * (self._yaw + yaw)
        level = float(np.hypot(self.T[0, 0], self.T[1, 0]))
        way = self.speed * seconds * level * np.array([np.cos(middle), np.sin(middle)])
        tyres = self._tyres(self._xy + way, yaw)
        self.is_blocked = self._is_too_high(tyres, self._xy + way, yaw)
        if self.is_blocked:
            self.speed = self.turn_rate = 0.0
            return
        self._xy, self._yaw = self._xy + way, yaw
        self._settle(tyres.mean(axis=1))

    def _tyres(self, xy: Array, yaw: float) -> Array:
        """(4, 9) [m]: height of the ground along each tyre's contact."""
        return self._ground(_TYRES, xy, yaw).reshape(4, -1)

    def _ground(self, points: Array, xy: Array, yaw: float) -> Array:
        """(N,) [m]: surface at points of the robot, including objects too low to pass below."""
        return self._scene.heights(_placed(points, xy, yaw), below=self.T[2, 3] + HEIGHT)

    def _is_too_high(self, tyres: Array, xy: Array, yaw: float) -> bool:
        if not np.isfinite(tyres).all() or np.abs(np.diff(tyres, axis=1)).max() > MAX_STEP:
            return True
        contacts = tyres.mean(axis=1)
        if np.abs(contacts - self._contacts).max() > MAX_STEP:
            return True
        ahead, aside = _slopes(contacts)
        plane = contacts.mean() + _OUTLINE @ np.array([ahead, aside])
        outline = _placed(_OUTLINE, xy, yaw)
        return bool(self._scene.meets(outline, plane + CLEARANCE, plane + HEIGHT).any())

    def _settle(self, contacts: Array) -> None:
        """Fit the plane of base_link to the contacts, by least squares."""
        self._contacts = contacts
        ahead, aside = _slopes(contacts)
        cos, sin = np.cos(self._yaw), np.sin(self._yaw)
        forward = np.array([cos, sin, ahead])
        up = np.cross(forward, np.array([-sin, cos, aside]))
        self.T = np.eye(4)
        self.T[:3, 0] = forward / np.linalg.norm(forward)
        self.T[:3, 2] = up / np.linalg.norm(up)
        self.T[:3, 1] = np.cross(self.T[:3, 2], self.T[:3, 0])
        self.T[:3, 3] = (*self._xy, contacts.mean())


def _placed(points: Array, xy: Array, yaw: float) -> Array:
    """Points (N, 2) of the robot in the map."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.asarray(points @ np.array([[cos, sin], [-sin, cos]]) + xy)


def _slopes(contacts: Array) -> Array:
    """Slopes of the plane through the contacts, ahead and to the left."""
    return np.asarray(contacts @ _WHEELS / (_WHEELS**2).sum(axis=0))
