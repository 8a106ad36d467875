# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The true heights over the cells of a map, wherever its frame lies in the world."""

from __future__ import annotations

import numpy as np
import pytest

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_map import Geometry
from heightmap25d_ros.simulation import recording
from heightmap25d_ros.simulation.truth import RESOLUTION, Surface, levels_at, tops_at


@pytest.fixture(scope="module")
def world():
    return recording.world_of("room", 1)


def test_in_the_frame_of_the_world_they_are_those_of_its_surface(world):
    surface = Surface(world)
    geometry = Geometry(resolution=RESOLUTION, origin=surface.origin, shape=surface.shape)
    np.testing.assert_array_equal(tops_at(world, geometry, np.eye(4)), surface.heights(0.0)[0])


def test_a_turned_map_has_them_turned_and_nothing_beyond_the_world(world):
    """By a right angle: cells of the map are cells of the world."""
    surface = Surface(world)
    x0, y0 = surface.origin
    T_world_map = se3.from_xyz_rpy([x0, y0, 0.25, 0.0, 0.0, np.pi / 2])
    rows, columns = surface.shape
    below = Geometry(
        resolution=RESOLUTION, origin=(0.0, -columns * RESOLUTION), shape=(columns, rows)
    )
    found = tops_at(world, below, T_world_map)
    inside = found[1:-1, 1:-1]
    expected = np.rot90(surface.heights(0.0)[0])[1:-1, 1:-1] - 0.25
    assert (np.abs(inside - expected) < 0.02).mean() > 0.99
    beyond = Geometry(resolution=RESOLUTION, origin=(0.0, 1.0), shape=(4, 4))
    assert np.isnan(tops_at(world, beyond, T_world_map)).all()


def test_levels_are_the_ground_below_decks_and_the_tops_of_all():
    garage = recording.world_of("garage", 1)
    surface = Surface(garage)
    geometry = Geometry(resolution=RESOLUTION, origin=surface.origin, shape=surface.shape)
    top, ground, clearance = surface.heights(0.0)
    lower, upper = levels_at(garage, geometry, np.eye(4))
    np.testing.assert_array_equal(upper, top)
    np.testing.assert_array_equal(lower, ground)
    is_below = np.isfinite(clearance)
    assert (upper > lower + 1.0)[is_below].mean() > 0.9
    np.testing.assert_array_equal(upper[~is_below], lower[~is_below])
