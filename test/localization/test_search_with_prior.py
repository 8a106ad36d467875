# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A search that knows about which way the robot looks, in a room that is the same both ways."""

import numpy as np
import pytest

from heightmap25d_ros.localization.global_search import Prior, relocalize
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.registration import Reason
from heightmap25d_ros.localization.surface import Surface
from heightmap25d_ros.params.sections import RegistrationParams

CELL = 0.125
ROWS, COLUMNS = 16, 32


@pytest.fixture(scope="module")
def room():
    """Walls around 4 x 2 m, seen by a level laser: what is inside is unknown."""
    heights = np.full((ROWS, COLUMNS), np.nan, np.float32)
    heights[[0, -1]] = heights[:, [0, -1]] = 0.5
    return Surface(heights, ~np.isnan(heights), (0.0, 0.0), CELL)


@pytest.fixture(scope="module")
def points(room):
    """The walls as the robot expects them, which is 0.3 m and 0.1 rad off, beside the middle."""
    iy, ix = np.nonzero(room.is_edge)
    robot = np.array([2.5, 1.2])
    seen = np.column_stack([(ix + 0.5) * CELL, (iy + 0.5) * CELL]) - robot
    cos, sin = np.cos(-0.1), np.sin(-0.1)
    turned = seen @ np.array([[cos, sin], [-sin, cos]])
    xyz = np.column_stack([turned, np.full(len(seen), 0.5)])
    pivot = float(robot[0] - 0.3), float(robot[1])
    return RegistrationPoints(xyz, np.ones(len(seen), bool), np.ones(len(seen)), pivot)


def test_a_room_that_is_the_same_both_ways_is_ambiguous(room, points):
    found = relocalize(points, room, RegistrationParams(), Prior(2.2, 1.2, 2.0))
    assert found.reason is Reason.AMBIGUOUS
    assert len(found.candidates) == 2


def test_with_a_prior_of_the_yaw_it_is_not(room, points):
    found = relocalize(points, room, RegistrationParams(), Prior(2.2, 1.2, 2.0, turn=0.3))
    assert found.reason is Reason.ACCEPTED
    np.testing.assert_allclose(found.offset, [0.3, 0.0, 0.1], atol=0.03)


def test_where_nothing_fits_the_search_says_so(room, points):
    elsewhere = Prior(2.2, 1.2, 0.5, turn=0.3)
    crooked = points._replace(xyz=points.xyz * (0.5, 1.6, 1.0))
    found = relocalize(crooked, room, RegistrationParams(), elsewhere)
    assert not found.is_accepted
