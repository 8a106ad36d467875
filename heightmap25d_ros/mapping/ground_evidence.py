# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether lasers see any ground: level ones do not, and then free space has no height.

A map of level lasers alone knows walls at the height of the laser, each a thin line between unknown
cells. By steps between cells they would all be free.
"""

from __future__ import annotations

import numpy as np

from heightmap25d_ros.mapping.sensor_model import Beams

BELOW = 0.15
"""Below its laser [m] from which on a return may be of ground, as for the localization layers."""

_FALL = 0.06  # [m] per metre; a laser that is level within 3 degrees falls less


def see_ground(beams: Beams) -> bool:
    """Whether one of the returns fell clearly below its laser.

    Examples
    --------
    A laser at 0.4 m that sees the ground 2 m away, and a level one:

    >>> one = np.ones(1, bool)
    >>> laser = np.array([[0.0, 0.0, 0.4]])
    >>> down = Beams(origins=laser, ends=np.array([[2.0, 0.0, 0.0]]), is_hit=one, is_lone=~one)
    >>> level = Beams(origins=laser, ends=np.array([[9.0, 0.0, 0.3]]), is_hit=one, is_lone=~one)
    >>> see_ground(down), see_ground(level)
    (True, False)
    """
    away = beams.origins - beams.ends
    fell = away[:, 2] > np.maximum(BELOW, _FALL * np.hypot(away[:, 0], away[:, 1]))
    return bool((fell & beams.is_hit & ~beams.is_lone).any())
