# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether lasers are mounted as assumed, judged by what they see while the robot drives.

`DrivenGround` tells of pitch and roll, `SideSlip` of the yaw, each where it can be told at all.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.mapping.driven_ground import DrivenGround
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.mapping.side_slip import SideSlip

_SPACING = 0.1  # [m] of travel between two scans that are looked at
_JUMP = 1.0  # [m] between these: no motion
_BEAMS = 400  # of a scan that are looked at, about
_OFF = np.radians(1.2)  # by which a mount is told to be off
_SURE = 4.0  # deviations that this exceeds
_SPANS = 6  # from which a yaw is told


class MountWatch:
    """Judges the mounts of all lasers."""

    def __init__(self) -> None:
        self._lasers: dict[str, _Laser] = defaultdict(_Laser)

    def observe(
        self, topic: str, scan: Scan, T_odom_base: se3.Matrix, T_base_sensor: se3.Matrix
    ) -> None:
        """A scan has its poses, (N, 4, 4) or (1, 4, 4), as in a `Reading`."""
        self._lasers[topic].observe(scan, T_odom_base, T_base_sensor)

    def fault(self) -> str:
        """Which mounts are off, and by how much; empty where none is known to be."""
        told = [f"{topic}: {', '.join(off)}" for topic, laser in self._lasers.items()
                if (off := list(laser.faults()))]  # fmt: skip
        return "; ".join(told)


class _Laser:
    """One laser, where the robot was when it was looked at, and what it told."""

    def __init__(self) -> None:
        self._position: NDArray[np.float64] | None = None
        self._ground, self._slip = DrivenGround(), SideSlip()

    def observe(self, scan: Scan, T_odom_base: se3.Matrix, T_base_sensor: se3.Matrix) -> None:
        position = T_odom_base[0, :3, 3]
        travelled = np.inf if self._position is None else math.dist(position, self._position)
        if travelled < _SPACING:
            return
        self._position = position.copy()
        if travelled > _JUMP:
            self._ground.restart()
            self._slip.restart()
            travelled = 0.0
        step = 1 + len(scan.ranges) // _BEAMS
        self._ground.observe(scan, T_odom_base, T_base_sensor, travelled, step)
        self._slip.observe(scan, T_odom_base, T_base_sensor, travelled, step)

    def faults(self) -> Iterator[str]:
        tilt, slip = self._ground.tilt(), self._slip.slip()
        if tilt is not None:
            yield from _told("roll", tilt.roll, tilt.roll_deviation)
            yield from _told("pitch", tilt.pitch, tilt.pitch_deviation)
        if slip is not None and slip.spans >= _SPANS:
            yield from _told("yaw", slip.yaw, slip.deviation)


def _told(axis: str, angle: float, deviation: float) -> Iterator[str]:
    if abs(angle) > max(_OFF, _SURE * deviation):
        side = "large" if angle > 0.0 else "small"
        yield f"{axis} seems {np.degrees(abs(angle)):.1f} degrees too {side}"
