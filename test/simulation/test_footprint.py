# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rectangle of 0.78 m x 0.64 m, which the truth takes to be smaller by 5 cm on each side."""

import numpy as np
import pytest

from heightmap25d_ros.simulation import footprint

SPACING = 0.03125
X, Y = np.meshgrid(np.arange(-80, 80) * SPACING, np.arange(-64, 64) * SPACING)
BEYOND = (0, 64, 140)


def reached(height, start=(0, 64, 20), is_steep=None):
    height = height if height.ndim == 3 else height[None]
    steep = np.zeros(height.shape, bool) if is_steep is None else is_steep
    return footprint.reached(height, footprint.faces(height, 0.10), steep, SPACING, start)


def wall_with_a_gap(width, turned=0.0):
    along = X * np.cos(turned) + Y * np.sin(turned)
    across = Y * np.cos(turned) - X * np.sin(turned)
    return np.where((np.abs(along) < 0.1) & (np.abs(across) > width / 2), 0.5, 0.0)


@pytest.mark.parametrize("turned", [0.0, 0.4, -0.7])
@pytest.mark.parametrize(("width", "is_open"), [(0.46, False), (0.66, True)])
def test_a_gap_is_passed_if_the_rectangle_fits_through_it(width, is_open, turned):
    _, gets = reached(wall_with_a_gap(width, turned))
    assert gets[0, 64, 20]
    assert gets[BEYOND] == is_open


def test_it_turns_to_stand_where_it_does_not_fit_as_it_is():
    """A bay 0.66 m wide is entered along one axis, and one of 0.46 m not at all."""
    for width, fits in ((0.66, True), (0.46, False)):
        height = np.where((np.abs(X) > width / 2) & (Y > 0.5), 0.5, 0.0)
        stands, gets = reached(height, (0, 20, 80))
        assert stands[0, 112, 80] == gets[0, 112, 80] == fits


def test_low_steps_and_steep_ground():
    assert reached(np.where(np.abs(X) < 0.1, 0.09, 0.0))[1][BEYOND]
    assert not reached(np.where(np.abs(X) < 0.1, 0.11, 0.0))[1][BEYOND]
    assert not reached(0.0 * X, is_steep=(np.abs(X) < 0.1)[None])[1][BEYOND]


def test_levels_are_joined_where_they_are_one_ground():
    lower = np.where(X > 0.0, np.inf, 0.0)
    upper = np.stack([lower, 0.0 * X])
    assert reached(upper)[1][1, 64, 140]
    assert not reached(np.stack([lower, 0.0 * X + 1.0]))[1][1].any()


def test_what_is_closed_and_upper_edges_are_faces():
    height = np.zeros((1, 5, 5))
    height[0, 2, 2:] = 0.2
    height[0, 0, 0] = np.inf
    expected = np.zeros((1, 5, 5), bool)
    expected[0, 2, 2:] = expected[0, 0, 0] = True
    np.testing.assert_array_equal(footprint.faces(height, 0.10), expected)


def test_a_cell_with_a_face_has_one():
    samples = np.zeros((1, 4, 4), bool)
    samples[0, 3, 1] = True
    np.testing.assert_array_equal(footprint.by_cell(samples, 2), [[[False, False], [True, False]]])
