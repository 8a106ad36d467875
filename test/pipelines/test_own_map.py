# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Localization on the map made so far, on a recorded drive against its truth."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from localization_bags import PARAMS, drive, events_of
from repository import BAGS

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.localization.tracking_state import State
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.pipelines.localization import Localizer

OWN = with_values(PARAMS, {"localization.own_map": True})


@pytest.fixture(scope="module")
def start():
    return events_of(BAGS / "room_1", 9.0)


@pytest.fixture(scope="module")
def driven(start):
    return drive(start, None, params=OWN)


@pytest.mark.slow
def test_the_robot_is_where_it_says_on_the_map_that_it_makes(start, driven):
    error = driven.errors(start)[:, 0]
    alone = drive(start, None).errors(start)[:, 0]
    assert error.max() < 0.08 < 0.2 < alone.max()
    assert driven.states[-1] is State.TRACKING
    told = np.sqrt(np.linalg.eigvalsh(driven.localizer.pose.covariance[:2, :2])[-1])
    assert error[-1] < 4.0 * told


@pytest.mark.slow
def test_odometry_that_jumps_does_not_move_the_robot(start, driven):
    begin = start[0].stamp_ns + 5 * 10**9
    torn = []
    for event in start:
        message = event.message
        if event.topic == "/odom" and event.stamp_ns > begin:
            message = copy.deepcopy(message)
            message.pose.pose.position.x += 7.0
        torn.append(event._replace(message=message))
    jumped = drive(torn, None, params=OWN)
    assert jumped.errors(start)[:, 0].max() < 0.1
    assert jumped.states[-1] is State.TRACKING


def test_no_long_term_map_besides_the_own_one():
    with pytest.raises(InputError, match="own_map"):
        with_values(OWN, {"localization.map_directory": "somewhere"})
    with pytest.raises(InputError, match="own_map"):
        Localizer(OWN).set_long_term(HeightMap.from_metres(np.zeros((8, 8))))
    assert not Localizer(OWN).request_search()
