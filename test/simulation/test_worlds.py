# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The analytic worlds against closed form and against marching along the ray."""

from __future__ import annotations

from math import atan, cos, inf, pi, radians, sin, sqrt, tan

import numpy as np
import pytest
from analytic_worlds import Solid, World, box, plane, ramp, scan_ranges
from hypothesis import given
from hypothesis import strategies as st


def ray(world: World, origin: tuple[float, ...], direction: tuple[float, ...]) -> float:
    """Distance along one ray; the direction may have any length."""
    unit = np.array([direction]) / np.linalg.norm(direction)
    return float(world.ranges(np.array([origin]), unit)[0])


def test_wall_at_a_known_distance() -> None:
    world = World([box((3.0, 3.2), (-1.0, 1.0), 2.0)])
    assert ray(world, (0, 0, 1), (1, 0, 0)) == 3.0
    angle = radians(15.0)
    assert ray(world, (0, 0, 1), (cos(angle), sin(angle), 0)) == pytest.approx(3.0 / cos(angle))
    assert ray(world, (0, 0, 1), (3.0, 1.01, 0)) == inf  # past its end
    assert ray(world, (0, 0, 2.01), (1, 0, 0)) == inf  # over its top
    assert ray(world, (0, 0, 3), (1, 0, -1 / 3.1)) == pytest.approx(sqrt(3.1**2 + 1))  # onto it
    assert ray(world, (5, 0, 1), (-1, 0, 0)) == pytest.approx(1.8)  # its other face
    assert ray(world, (5, 0, 1), (1, 0, 0)) == inf  # behind the laser
    assert ray(world, (3.1, 0, 1), (1, 0, 0)) == 0.0  # from inside


def test_pitched_laser_over_flat_ground_draws_a_line_across() -> None:
    height, pitch = 0.6, radians(28.0)
    T = np.eye(4)
    T[:3, 0] = cos(pitch), 0.0, -sin(pitch)
    T[:3, 2] = sin(pitch), 0.0, cos(pitch)
    T[2, 3] = height
    angles = np.radians(np.linspace(-89.0, 89.0, 357))
    ranges = scan_ranges(World([plane()]), T[None], angles)
    np.testing.assert_allclose(ranges, height / (sin(pitch) * np.cos(angles)), rtol=1e-12)
    ahead = ranges * np.cos(angles) * cos(pitch)
    np.testing.assert_allclose(ahead, height / tan(pitch), rtol=1e-12)


def test_plane_at_a_known_pitch() -> None:
    slope = tan(radians(10.0))
    world = World([plane(-1.0, slope=(slope, 0.0))])
    assert ray(world, (0, 0, 0), (0, 0, -1)) == pytest.approx(1.0)
    # Towards the rising ground level: z = 0 where x = 1 / slope, whatever y.
    assert ray(world, (0, 0, 0), (1, 0, 0)) == pytest.approx(1.0 / slope)
    assert ray(world, (0, 0, 0), (1, 1, 0)) == pytest.approx(sqrt(2.0) / slope)
    assert ray(world, (0, 0, 0), (-1, 0, 0)) == inf
    assert ray(world, (0, 0, 0), (1, 0, slope)) == inf  # parallel to it
    perpendicular = (slope, 0.0, -1.0)
    assert ray(world, (0, 0, 0), perpendicular) == pytest.approx(cos(atan(slope)))


def test_ceiling_has_a_bottom() -> None:
    world = World([plane(), box((-inf, inf), (-inf, inf), 2.7, bottom=2.5)])
    assert ray(world, (0, 0, 0.5), (0, 0, 1)) == 2.0
    assert ray(world, (0, 0, 0.5), (0, 0, -1)) == 0.5
    assert world.top(0.0, 0.0) == 2.7


def test_top_surface() -> None:
    world = World([plane(-1.0), ramp((0.0, 2.0), (-1.0, 1.0), (0.0, -1.0)), box((1, 3), (0, 1), 0)])
    x = np.array([0.0, 1.0, 0.5, 1.5, 1.5, 2.5, -0.1])
    y = np.array([0.0, -0.5, 0.5, -0.5, 0.5, -0.5, 0.0])
    expected = [0.0, -0.5, -0.25, -0.75, 0.0, -1.0, -1.0]
    np.testing.assert_allclose(world.top(x, y), expected)
    assert World([]).top(0.0, 0.0) == -inf


def test_top_of_a_cell_is_the_highest_point_in_its_square() -> None:
    up = ramp((0.0, 4.0), (0.0, 1.0), (0.0, 2.0))
    post = box((1.4, 1.5), (0.2, 0.3), 3.0)
    world = World([up, post])
    found = world.cell_top(1.0, (-1.0, 0.0), (2, 6))
    below, above = found
    # Columns -1..0, 0..1, 1..2 with the post, 2..3, 3..4, 4..5: only its edge touches the last.
    np.testing.assert_allclose(below, [-inf, 0.5, 3.0, 1.5, 2.0, -inf])
    np.testing.assert_array_equal(above, -inf)


# Binary fractions, so that edges meet or miss one another exactly.
coordinates = st.integers(-40, 40).map(lambda n: n / 16.0)
sides = st.integers(1, 40).map(lambda n: n / 16.0)
slopes = st.floats(-1.0, 1.0)


@st.composite
def solids(draw: st.DrawFn) -> Solid:
    x, y, top = draw(coordinates), draw(coordinates), draw(coordinates)
    bottom = draw(st.sampled_from([-inf, top - 0.5]))
    extent = (x, x + draw(sides)), (y, y + draw(sides))
    return Solid(*extent, (top, draw(slopes), draw(slopes)), bottom)


def is_inside(solid: Solid, points: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    a, b, c = solid.top
    in_plan = (x >= solid.x[0]) & (x <= solid.x[1]) & (y >= solid.y[0]) & (y <= solid.y[1])
    return in_plan & (z >= solid.bottom) & (z <= a + b * x + c * y)


@given(
    st.lists(solids(), min_size=1, max_size=4),
    st.tuples(*[st.floats(-4.0, 4.0)] * 3),
    st.floats(-pi, pi),
    st.floats(-1.5, 1.5),
)
def test_ray_equals_marching(
    world_solids: list[Solid], origin: tuple[float, ...], azimuth: float, elevation: float
) -> None:
    direction = np.array(
        [cos(elevation) * cos(azimuth), cos(elevation) * sin(azimuth), sin(elevation)]
    )
    found = ray(World(world_solids), origin, tuple(direction))
    step = 1e-3
    along = np.arange(0.0, 12.0, step)
    points = np.array(origin) + along[:, None] * direction
    hits = along[np.logical_or.reduce([is_inside(solid, points) for solid in world_solids])]
    assert not (hits < found - 1e-9).any()  # nothing before it
    if np.isfinite(found) and found < 12.0:
        end = np.array([origin]) + found * direction
        around = end + 1e-9 * np.array(np.meshgrid(*[[-1, 0, 1]] * 3)).reshape(3, -1).T
        assert any(is_inside(solid, around).any() for solid in world_solids)
    elif len(hits):
        pytest.fail("marching meets something that the ray does not")


@given(st.lists(solids(), min_size=1, max_size=3))
def test_top_of_a_cell_equals_dense_sampling(world_solids: list[Solid]) -> None:
    world, resolution, spacing = World(world_solids), 0.5, 1.0 / 64.0
    found = world.cell_top(resolution, (-2.0, -2.0), (8, 8))
    inside = (np.arange(32) + 0.5) * spacing
    y = (-2.0 + resolution * np.arange(8)[:, None] + inside).reshape(8, 1, 32, 1)
    x = (-2.0 + resolution * np.arange(8)[:, None] + inside).reshape(1, 8, 1, 32)
    sampled = world.top(x, y).max(axis=(2, 3))
    np.testing.assert_array_equal(np.isfinite(found), np.isfinite(sampled))
    seen = np.isfinite(found)
    assert (sampled[seen] <= found[seen]).all()
    assert (found[seen] - sampled[seen]).max(initial=0.0) <= 2 * spacing  # slopes of at most 1
