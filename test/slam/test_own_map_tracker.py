# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is kept of a drive for its poses to be refined."""

import numpy as np
from landmark_worlds import ROOM, beams_to, ground_returns, wall_returns

from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.own_map_tracker import OwnMapTracker

SCAN_NS = 13_000_000


def test_walls_are_kept_of_where_the_drive_begins_though_the_first_scans_are_of_the_ground():
    """Which way the frame looks is known as well as the walls that were seen from there."""
    rng, tracker = np.random.default_rng(1), OwnMapTracker(Params())
    for number in range(30):
        is_wall = number > 3 and number % 2
        ends = wall_returns(rng, 180, ROOM) if is_wall else ground_returns(rng, 180)
        tracker.integrate(beams_to(ends), np.eye(4), number * SCAN_NS)
    assert any((keyframe.returns[:, 2] > 0.1).sum() > 100 for keyframe in tracker.keyframes)
