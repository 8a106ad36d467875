# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lines and planes: exact where there is no noise, and with it as uncertain as they say."""

from __future__ import annotations

import numpy as np
import pytest

from heightmap25d_ros.localization.ground_planes import fit_planes
from heightmap25d_ros.localization.wall_lines import fit_lines

CELL = 0.125


def places_on_a_line(angle, offset, cells=24, noise=0.0, rng=None):
    """Mean places of the cells that a line through the middle of a square passes."""
    along = np.linspace(-1.5, 1.5, 1000)
    direction, normal = (
        np.array([np.cos(angle), np.sin(angle)]),
        np.array([-np.sin(angle), np.cos(angle)]),
    )
    points = along[:, None] * direction + offset * normal + 0.5 * cells * CELL
    index = np.floor(points / CELL).astype(int)
    places, is_measured = np.zeros((cells, cells, 2)), np.zeros((cells, cells), bool)
    for ix, iy in np.unique(index[((index >= 0) & (index < cells)).all(axis=1)], axis=0):
        mine = (index == (ix, iy)).all(axis=1)
        shift = 0.0 if rng is None else rng.normal(0.0, noise)
        places[iy, ix], is_measured[iy, ix] = points[mine].mean(axis=0) + shift * normal, True
    return places, is_measured, normal


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.8, 1.5, 2.9])
def test_a_straight_wall_has_its_normal_and_place_exactly(angle):
    places, is_measured, normal = places_on_a_line(angle, 0.04)
    cells, lines = fit_lines(places, is_measured.astype(float), CELL)
    assert not np.isnan(lines).any()
    np.testing.assert_allclose(np.abs(lines[:, :2] @ normal), 1.0, atol=1e-9)
    on_line = places[tuple(cells.T)] + lines[:, 2:3] * lines[:, :2] - 0.5 * 24 * CELL
    np.testing.assert_allclose(on_line @ normal, 0.04, atol=1e-9)


def test_the_variance_of_normals_is_true_within_a_factor_of_two():
    """Against normals fitted to many draws of the same noise."""
    rng = np.random.default_rng(1)
    errors, told = [], []
    for _ in range(120):
        angle = rng.uniform(0.0, np.pi)
        places, is_measured, normal = places_on_a_line(angle, 0.0, noise=0.006, rng=rng)
        cells, lines = fit_lines(places, is_measured.astype(float), CELL)
        middle = np.abs(cells - 11.5).max(axis=1).argmin()
        across = lines[middle, 0] * normal[1] - lines[middle, 1] * normal[0]
        errors.append(across)
        told.append(lines[middle, 3])
    assert 0.5 < np.mean(np.square(errors)) / np.mean(told) < 2.0


def test_scattered_cells_are_on_no_line():
    rng = np.random.default_rng(2)
    is_measured = rng.random((40, 40)) < 0.3
    places = (np.indices((40, 40))[::-1].transpose(1, 2, 0) + rng.random((40, 40, 2))) * CELL
    cells, lines = fit_lines(places, is_measured.astype(float), CELL)
    assert len(cells) == is_measured.sum()
    sure = ~np.isnan(lines[:, 0]) & (lines[:, 3] < np.radians(3.0) ** 2)
    assert sure.mean() < 0.05


def test_a_corner_has_the_lines_of_both_walls():
    places, is_measured = np.zeros((20, 20, 2)), np.zeros((20, 20), bool)
    for k in range(3, 18):
        for iy, ix, x, y in ((3, k, k + 0.5, 3.4), (k, 3, 3.3, k + 0.5)):
            places[iy, ix], is_measured[iy, ix] = (x * CELL, y * CELL), True
    cells, lines = fit_lines(places, is_measured.astype(float), CELL)
    for cell, normal in (((3, 16), (0.0, 1.0)), ((16, 3), (1.0, 0.0))):
        k = int(np.flatnonzero((cells == cell).all(axis=1))[0])
        assert np.abs(lines[k, :2] @ normal) == pytest.approx(1.0, abs=1e-6)


def test_a_plane_has_its_height_and_slopes_exactly():
    y, x = np.indices((12, 12)) * CELL
    heights = 0.5 + 0.1 * x - 0.2 * y
    cells, planes = fit_planes(heights, np.ones((12, 12), bool), CELL)
    assert len(cells) == 144
    np.testing.assert_allclose(planes[:, 0], heights[tuple(cells.T)], atol=1e-12)
    np.testing.assert_allclose(planes[:, 1:3], [[0.1, -0.2]] * 144, atol=1e-10)


def test_the_variance_of_slopes_is_true_within_a_factor_of_two():
    rng = np.random.default_rng(3)
    heights = rng.normal(0.0, 0.01, (400, 40))
    cells, planes = fit_planes(heights, np.ones_like(heights, bool), CELL)
    inner = (cells[:, 0] % 5 == 2) & (cells[:, 1] % 5 == 2)
    true = np.square(planes[inner, 1:3]).mean()
    assert 0.5 < true / planes[inner, 4].mean() < 2.0


def test_ground_that_is_hardly_seen_has_no_plane():
    is_ground = np.zeros((12, 12), bool)
    is_ground[6] = True  # one row: its slope across is not known
    cells, _ = fit_planes(np.zeros((12, 12)), is_ground, CELL)
    assert len(cells) == 0
