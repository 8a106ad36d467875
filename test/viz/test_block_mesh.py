# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Blocks as they are seen: exact small arrays, and nothing hidden is drawn over what hides it."""

from __future__ import annotations

from math import cos, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from properties import draws

from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.viz import block_mesh

NAN = np.nan


def geometry(shape: tuple[int, int]) -> Geometry:
    return Geometry(resolution=0.5, origin=(10.0, -1.0), shape=shape)


def boxes(faces: block_mesh.Faces) -> set[tuple[tuple[float, float], ...]]:
    """The faces as ((x, x), (y, y), (z, z)), their smallest and largest coordinates."""
    return {
        tuple(zip(corners.min(axis=0).tolist(), corners.max(axis=0).tolist(), strict=True))
        for corners in faces.corners
    }


def test_flat_cells_have_tops_only() -> None:
    metres = np.array([[2.0, 2.0, NAN]])
    assert boxes(block_mesh.faces(geometry((1, 3)), metres, azimuth=-1.0)) == {
        ((10.0, 10.5), (-1.0, -0.5), (2.0, 2.0)),
        ((10.5, 11.0), (-1.0, -0.5), (2.0, 2.0)),
    }


@pytest.mark.parametrize(
    ("azimuth", "side_of_x", "side_of_y"),
    [(0.8, 10.5, -0.5), (2.4, 10.0, -0.5), (-2.4, 10.0, -1.0), (-0.8, 10.5, -1.0)],
)
def test_block_reaches_down_to_its_lowest_neighbour(
    azimuth: float, side_of_x: float, side_of_y: float
) -> None:
    metres = np.array([[3.0, NAN], [NAN, 1.0]])  # the lower one is a diagonal neighbour
    found = boxes(block_mesh.faces(geometry((2, 2)), metres, azimuth))
    assert found == {
        ((10.0, 10.5), (-1.0, -0.5), (3.0, 3.0)),
        ((10.5, 11.0), (-0.5, 0.0), (1.0, 1.0)),
        ((side_of_x, side_of_x), (-1.0, -0.5), (1.0, 3.0)),
        ((10.0, 10.5), (side_of_y, side_of_y), (1.0, 3.0)),
    }


def test_faces_of_a_cell_differ_in_shade_and_neighbours_too() -> None:
    shades = block_mesh.faces(geometry((1, 2)), np.array([[1.0, 0.0]]), azimuth=-0.8).shade
    assert len(shades) == 4
    assert len(set(shades.tolist())) == 4


def projection(azimuth: float, elevation: float) -> np.ndarray:
    """(3, 3): rows are right and up on the picture, and towards the viewer."""
    level = np.array([cos(azimuth), sin(azimuth), 0.0])
    vertical = np.array([0.0, 0.0, 1.0])
    return np.stack(
        [
            np.array([-sin(azimuth), cos(azimuth), 0.0]),
            cos(elevation) * vertical - sin(elevation) * level,
            cos(elevation) * level + sin(elevation) * vertical,
        ]
    )


def depth_at(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(P,): nearness of a projected quadrilateral (4, 3) at points (P, 2); NaN outside of it."""
    edges = np.roll(corners, -1, axis=0) - corners
    offsets = points[:, None] - corners[None, :, :2]
    crosses = edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0]
    inside = (crosses > 1e-6).all(axis=1) | (crosses < -1e-6).all(axis=1)
    plane, *_ = np.linalg.lstsq(np.c_[corners[:, :2], np.ones(4)], corners[:, 2], rcond=None)
    return np.where(inside, points @ plane[:2] + plane[2], NAN)


@draws(60)
@given(
    npst.arrays(float, (4, 5), elements=st.sampled_from([NAN, 0.0, 0.2, 0.7, 2.0])),
    st.floats(-3.1, 3.1),
    st.floats(0.1, 1.4),
    st.randoms(use_true_random=False),
)
def test_what_is_drawn_last_is_nearest(metres, azimuth, elevation, random) -> None:
    faces = block_mesh.faces(geometry((4, 5)), metres, azimuth)
    if not len(faces.corners):
        assert np.isnan(metres).all()
        return
    projected = faces.corners @ projection(azimuth, elevation).T
    low, high = projected.min(axis=(0, 1)), projected.max(axis=(0, 1))
    points = np.array(
        [[random.uniform(low[axis], high[axis]) for axis in (0, 1)] for _ in range(60)]
    )
    depths = np.array([depth_at(points, corners) for corners in projected])
    for at_point in depths.T:
        covering = at_point[~np.isnan(at_point)]
        if len(covering):
            assert covering[-1] >= covering.max() - 1e-6


def test_coarser_keeps_the_highest() -> None:
    height = np.array([[1, 5, 2], [3, -4, 9], [7, 0, 8]], np.int16)
    known = np.array([[1, 0, 1], [1, 1, 0], [0, 0, 0]], bool)
    shown = HeightMap(
        geometry=geometry((3, 3)),
        height=height,
        probability=np.where(known, 60000, 100).astype(np.uint16),
        probability_threshold=0.5,
    )
    assert block_mesh.coarser(shown, 9) is shown
    merged = block_mesh.coarser(shown, 4)
    assert merged.geometry == Geometry(resolution=1.0, origin=(10.0, -1.0), shape=(2, 2))
    np.testing.assert_array_equal(merged.known, [[True, True], [False, False]])
    np.testing.assert_array_equal(merged.height[0], [3, 2])
    assert block_mesh.coarser(shown, 1).height.max() == 3


def test_coarser_of_a_long_map() -> None:
    shown = HeightMap(
        geometry=geometry((1, 1000)),
        height=np.zeros((1, 1000), np.int16),
        probability=np.full((1, 1000), 65535, np.uint16),
        probability_threshold=0.5,
    )
    assert block_mesh.coarser(shown, 100).height.shape == (1, 100)
