# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import os

import numpy as np
import pytest

from heightmap25d_msgs.msg import HeightGrid
from heightmap25d_ros import memory
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import encode, map_directory
from heightmap25d_ros.localization.matching import RegistrationPoints
from heightmap25d_ros.localization.registration import MIN_POINTS, register
from heightmap25d_ros.localization.surface import surface_of
from heightmap25d_ros.params.sections import RegistrationParams
from heightmap25d_ros.pipelines.localization import Localizer

FLAT = HeightMap.from_metres(np.zeros((40, 40)), resolution=0.02)


def test_what_is_available_is_less_than_what_there_is():
    there_is = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    assert 0 < memory.available_bytes() < there_is
    memory.require(1, "a byte")
    with pytest.raises(InputError, match=r"all of it needs about .* GiB of memory"):
        memory.require(there_is, "all of it")


def test_maps_and_searches_ask_first(tmp_path, monkeypatch):
    map_directory.save(tmp_path / "map", FLAT)
    surface = surface_of(FLAT, 0.15)
    points = RegistrationPoints(
        np.zeros((MIN_POINTS, 3)), np.zeros(MIN_POINTS, bool), np.ones(MIN_POINTS), (0.4, 0.4)
    )
    monkeypatch.setattr(memory, "available_bytes", lambda: 10_000)
    for work in (
        lambda: map_directory.load(tmp_path / "map"),
        lambda: surface_of(FLAT, 0.15),
        lambda: register(points, surface, 9.0 * np.eye(3), RegistrationParams()),
    ):
        with pytest.raises(InputError, match="GiB are available"):
            work()


def test_a_long_term_grid_that_cannot_be_used_leaves_the_one_before(monkeypatch):
    localizer = Localizer()
    message = HeightGrid()
    encode.fill_height_grid(message, FLAT, 0, "map")
    localizer.take_long_term(message)
    assert localizer.request_search()
    for resolution in (0.002, 0.0, 1e9):
        message.info.resolution = resolution
        localizer.take_long_term(message)
    message.info.resolution = 0.02
    monkeypatch.setattr(memory, "available_bytes", lambda: 10_000)
    localizer.take_long_term(message)
    assert localizer.dropped == {
        "long_term_grid: bad info.resolution": 3,
        "long_term_grid: bad content": 1,
    }
    assert localizer.request_search()
