# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from literal_traversability import LiteralTerrain
from properties import draws
from scipy import ndimage

from heightmap25d_ros.grid.height_map import HEIGHT_LIMIT
from heightmap25d_ros.terrain.ground_plane import CHUNK, footprint, inflate, planes
from heightmap25d_ros.terrain.steps import cropped, padded_surface, transitions


def planes_of(height, known=None, radius_squared=16, max_step=10):
    """(gradient, roughness) of a dense map."""
    height = np.asarray(height, np.int16)
    known = np.ones(height.shape, bool) if known is None else known
    disc = footprint(radius_squared)
    margin = max(disc.radius, 1)
    surface = padded_surface(height, known, margin)
    blocked, _ = transitions(surface, max_step)
    gradient, roughness = planes(surface, blocked, disc, max_step)
    return np.hypot(*(cropped(part, margin) for part in gradient)), cropped(roughness, margin)


def assert_as_defined(height, known, radius_squared, max_step, cells):
    literal = LiteralTerrain.of(height, known, max_step, radius_squared)
    gradient, roughness = planes_of(height, known, radius_squared, max_step)
    assert (gradient[~known] == 0).all()
    assert (roughness[~known] == 0).all()
    for cell in map(tuple, cells):
        expected_gradient, expected_roughness, is_undecided = literal.plane(cell)
        if not is_undecided:
            assert gradient[cell] == pytest.approx(expected_gradient, rel=1e-5, abs=1e-5)
            assert roughness[cell] == pytest.approx(expected_roughness, rel=1e-5, abs=1e-4)


@given(
    seed=st.integers(0, 2**32 - 1),
    radius_squared=st.sampled_from([0, 1, 2, 5, 10, 16]),
    max_step=st.sampled_from([1, 4, 10, 40]),
    share_known=st.sampled_from([0.3, 0.7, 1.0]),
)
@draws(150)
def test_planes_by_the_definition(seed, radius_squared, max_step, share_known):
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, 13, 2))
    y, x = np.indices(shape)
    slope = rng.uniform(-8, 8, 2)
    height = slope[0] * x + slope[1] * y + rng.integers(-3, 4, shape)
    height += 30 * (x + y > rng.integers(20)) - 100 * (y > rng.integers(20))
    height = height.astype(np.int16)
    known = rng.random(shape) < share_known
    assert_as_defined(height, known, radius_squared, max_step, np.argwhere(known))


def test_sums_beyond_32_bits():
    rng = np.random.default_rng(5)
    height = rng.integers(-HEIGHT_LIMIT, HEIGHT_LIMIT + 1, (60, 60)).astype(np.int16)
    # Sums of squares beyond 2**36.
    height[:, :40] = 900 * np.arange(40) - 17000 + rng.integers(-40, 41, (60, 40))
    known = rng.random((60, 60)) < 0.95
    cells = [cell for cell in rng.integers(0, 60, (12, 2)) if known[tuple(cell)]]
    assert_as_defined(height, known, 400, 1000, cells)


@pytest.mark.parametrize("radius_squared", [1, 2, 9, 16, 100])
@pytest.mark.parametrize(("per_x", "per_y"), [(0, 0), (3, 0), (-2, 5), (4, 4)])
def test_an_inclined_plane_up_to_its_edges(radius_squared, per_x, per_y):
    y, x = np.indices((23, 2 * CHUNK + 31))
    gradient, roughness = planes_of(per_x * (x % 300) + per_y * y, None, radius_squared)
    inside = (x % 300 > 10) & (x % 300 < 289)  # where x % 300 jumps, two planes end
    np.testing.assert_allclose(gradient[inside], np.hypot(per_x, per_y), atol=1e-5)
    np.testing.assert_allclose(roughness[inside], 0, atol=1e-4)


@pytest.mark.parametrize("height", [15, 30, 200, -200])
@pytest.mark.parametrize("angle", [0.0, 0.3, 0.785])
def test_level_ground_beside_an_edge_is_level(height, angle):
    y, x = np.indices((40, 40))
    is_other = (x - 20) * np.cos(angle) + (y - 20) * np.sin(angle) > 0.1
    gradient, roughness = planes_of(np.where(is_other, height, 0))
    assert (gradient == 0).all()
    assert (roughness == 0).all()


def test_ground_behind_a_thin_wall_does_not_count():
    height = np.broadcast_to(np.maximum(8 * (np.arange(21) - 10), 0), (21, 21)).copy()
    height[:, 10] = 100
    assert (planes_of(height)[0][:, :10] == 0).all()


def test_a_slope_with_gaps_of_unknown_rows_is_seen():
    y = np.indices((30, 30))[0]
    known = y % 3 == 0
    gradient, _ = planes_of(7 * y, known)
    np.testing.assert_allclose(gradient[::3, 1:-1], 7, atol=1e-5)


def test_a_single_line_of_cells_has_a_gradient_along_it_only():
    y, x = np.indices((21, 21))
    gradient, _ = planes_of(6 * x + 9 * y, y == 10)
    np.testing.assert_allclose(gradient[10, 1:-1], 6, atol=1e-5)
    diagonal, _ = planes_of(3 * x + 4 * y, y == x)
    inside = np.arange(4, 17)
    np.testing.assert_allclose(diagonal[inside, inside], 7 / np.sqrt(2), atol=1e-5)


def test_few_cells_have_no_gradient():
    height, known = np.zeros((15, 15)), np.zeros((15, 15), bool)
    height[7, 8], height[8, 7] = 9, 9
    known[7:9, 7:9] = True
    gradient, roughness = planes_of(height, known)
    assert (gradient == 0).all()
    # Two cells at 0, two at 9 cm: 4.5 cm from their mean.
    np.testing.assert_allclose(roughness[known], 4.5, atol=1e-6)


def test_roughness_is_what_noise_was_added():
    rng = np.random.default_rng(2)
    y, x = np.indices((100, 100))
    _, roughness = planes_of(np.rint(2.7 * x - 1.3 * y + rng.normal(0, 2, x.shape)))
    # 49 cells less the 3 numbers of a plane; and 1/12 of rounding.
    expected = np.sqrt((2**2 + 1 / 12) * 46 / 49)
    assert roughness[4:-4, 4:-4].mean() == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("radius_squared", [0, 1, 2, 16, 37])
def test_a_footprint_is_the_cells_within_the_radius(radius_squared):
    disc = footprint(radius_squared)
    span = range(-10, 11)
    expected = {(y, x) for y in span for x in span if y * y + x * x <= radius_squared}
    assert set(map(tuple, disc.offsets.tolist())) == expected
    assert len(disc.offsets) == len(expected)
    assert disc.radius == max(y for y, _ in expected)


@given(seed=st.integers(0, 2**32 - 1), radius_squared=st.sampled_from([0, 1, 4, 16, 50]))
def test_inflation_as_distance_transform(seed, radius_squared):
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, 90, 2))
    cost = rng.choice(np.array([-1, 0, 40, 100], np.int8), shape, p=[0.2, 0.5, 0.29, 0.01])
    inflated = inflate(cost, footprint(radius_squared), occupied=100, inflated=99)
    is_near = np.zeros(shape, bool)
    if (cost == 100).any():
        is_near = ndimage.distance_transform_edt(cost != 100) <= np.sqrt(radius_squared) + 1e-9
    expected = np.where(is_near & (cost >= 0) & (cost < 100), 99, cost)
    assert (inflated == expected).all()
