# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from heightmap25d_ros import se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.mapping.sensor_model import beams, lone_returns, no_returns
from heightmap25d_ros.params.sections import SensorParams

LEVEL = se3.from_xyz_rpy([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
UP = SensorParams(max_height=100.0, min_height=-100.0)


def scan(ranges, **changes):
    values = {
        "stamp_ns": 10**9,
        "frame_id": "laser",
        "angle_min": 0.0,
        "angle_increment": np.pi / 2,
        "time_increment": 0.0,
        "range_min": 0.1,
        "range_max": 80.0,
    }
    return Scan(ranges=np.asarray(ranges, np.float32), **(values | changes))


def test_beams_point_forward_left_and_back():
    result = beams(scan([1.0, 2.0, 3.0]), LEVEL, LEVEL, UP)
    np.testing.assert_allclose(result.ends, [(1, 0, 0), (0, 2, 0), (-3, 0, 0)], atol=1e-12)
    assert result.is_hit.all()


def test_a_laser_pitched_down_30_degrees_meets_the_ground_at_twice_its_height():
    mount = se3.from_xyz_rpy([[0.3, 0.0, 0.6, 0.0, np.radians(30), 0.0]])
    result = beams(scan([1.2]), LEVEL, mount, UP)
    np.testing.assert_allclose(result.origins, [(0.3, 0, 0.6)])
    np.testing.assert_allclose(result.ends, [(0.3 + 1.2 * np.cos(np.pi / 6), 0, 0)], atol=1e-7)


def test_each_beam_leaves_from_where_the_robot_was_at_its_time():
    poses = se3.from_xyz_rpy([[x, 0, 0, 0, 0, 0] for x in (0.0, 0.5, 1.0)])
    result = beams(scan([1.0, 1.0, 1.0], time_increment=0.1), poses, LEVEL, UP)
    np.testing.assert_allclose(result.origins[:, 0], [0, 0.5, 1.0])
    np.testing.assert_allclose(result.ends[:, :2], [(1, 0), (0.5, 1), (0, 0)], atol=1e-12)


def test_returns_from_the_robots_own_body_make_no_beam():
    """Ahead, left and back, at a laser 0.4 m up and 0.3 m ahead."""
    mount = se3.from_xyz_rpy([[0.3, 0.0, 0.4, 0.0, 0.0, 0.0]])
    turned = se3.from_xyz_rpy([[5.0, 1.0, 0.0, 0.0, 0.0, 2.0]])  # the box turns with the robot
    body = dataclasses.replace(UP, body_box=(0.35, -0.3, 0.8, -0.35, 0.3, 0.0))
    for ranges, kept in (
        ([0.04, 0.29, 0.6], 0),
        ([0.06, 0.31, 0.7], 3),
        ([0.04, np.inf, 0.6], 1),
        ([0.06, 0.29, 0.6], 1),
    ):
        assert len(beams(scan(ranges, range_min=0.01), turned, mount, body).ends) == kept, ranges
    above = se3.from_xyz_rpy([[0.0, 0.0, 0.81, 0.0, 0.0, 0.0]])
    assert len(beams(scan([0.2] * 3), LEVEL, above, body).ends) == 3


def test_a_body_box_needs_two_corners():
    with pytest.raises(InputError, match=r"sensor\.body_box: 3 numbers; needs six"):
        SensorParams(body_box=(1.0, 2.0, 3.0))


def test_beam_stamps_follow_the_time_increment():
    assert scan([1, 1, 1], time_increment=1e-3).beam_stamps_ns().tolist() == [
        10**9, 10**9 + 10**6, 10**9 + 2 * 10**6,
    ]  # fmt: skip
    assert scan([1, 1, 1]).beam_stamps_ns().tolist() == [10**9]


def test_rep_117_values():
    """+inf clears to the configured range, what is no measurement makes no beam."""
    ranges = [np.inf, np.nan, -np.inf, 0.05, 90.0, 0.0, 5.0]
    given_scan = scan(ranges, angle_increment=0.01)
    result = beams(given_scan, LEVEL, LEVEL, SensorParams(clearing_range=7.0))
    lengths = np.linalg.norm(result.ends - result.origins, axis=1)
    np.testing.assert_allclose(lengths, [7.0, 5.0], rtol=1e-6)
    assert result.is_hit.tolist() == [False, True]


def test_no_return_clears_no_farther_than_the_laser_sees():
    result = beams(scan([np.inf], range_max=4.0), LEVEL, LEVEL, SensorParams(clearing_range=7.0))
    np.testing.assert_allclose(result.ends, [(4, 0, 0)])


def test_no_return_is_none_beside_one_where_the_laser_sees_without_limit():
    given_scan = scan([np.inf, 5.0, 5.0], angle_increment=0.001, range_max=np.inf)
    result = beams(given_scan, LEVEL, LEVEL, UP, lone_return=0.15)
    assert result.is_hit.tolist() == [False, True, True]
    assert not result.is_lone.any()


ODD = [0.0, 0.05, 0.1, 5.0, 79.9, 80.0, 81.0, np.inf, np.nan, -np.inf]


@pytest.mark.parametrize(
    ("convention", "misses", "returns"),
    [
        ("rep117", [7], [2, 3, 4, 5]),
        ("zero", [0, 7], [2, 3, 4, 5]),
        ("range_max", [5, 6, 7], [2, 3, 4]),
        ("out_of_range", [0, 1, 2, 5, 6, 7], [3, 4]),
    ],
)
def test_a_parameter_says_what_means_no_return(convention, misses, returns):
    params = SensorParams(no_return=convention, clearing_range=7.0, max_range=200.0, max_height=9.0)
    given_scan = scan(ODD, angle_increment=0.01)
    assert np.flatnonzero(no_returns(given_scan, convention)).tolist() == misses
    result = beams(given_scan, LEVEL, LEVEL, params)
    assert np.count_nonzero(~result.is_hit) == len(misses)
    lengths = np.linalg.norm(result.ends - result.origins, axis=1)
    np.testing.assert_allclose(lengths[~result.is_hit], 7.0)
    np.testing.assert_allclose(lengths[result.is_hit], np.float32([ODD[i] for i in returns]))


def test_no_return_at_a_range_max_that_is_no_float32():
    """4.1 is a little more as float32 than as float64."""
    for stored in (4.1, float(np.float32(4.1))):
        given_scan = scan([4.1], range_max=stored)
        assert no_returns(given_scan, "range_max").all()


@pytest.mark.parametrize("range_min", [0.0, 0.1])
def test_a_post_between_zeros_is_a_post(range_min):
    """Zeros measured nothing, also where the laser says that it measures from 0 on."""
    given_scan = scan([0.0, 0.0, 3.0, 0.0, 0.0], range_min=range_min, angle_increment=0.01)
    result = beams(given_scan, LEVEL, LEVEL, SensorParams(), lone_return=0.15)
    assert (result.is_hit.tolist(), result.is_lone.tolist()) == ([True], [False])


@pytest.mark.parametrize("pitch", [0.0, 0.4])
def test_no_return_clears_only_above_the_ground_under_the_robot(pitch):
    """30 degrees down and 0.6 m up the plane of base_link is 1.2 m away, and none upwards."""
    base = se3.from_xyz_rpy([[5.0, 2.0, 3.0, 0.0, pitch, 1.0]])
    for down, length in ((30, 1.2), (0, 7.0), (-30, 7.0)):
        mount = se3.from_xyz_rpy([[0.3, 0.0, 0.6, 0.0, np.radians(down), 0.0]])
        result = beams(scan([np.inf]), base, mount, SensorParams(clearing_range=7.0))
        assert np.linalg.norm(result.ends - result.origins) == pytest.approx(length)


def test_no_return_to_a_laser_below_the_base_clears_nothing_downwards():
    mount = se3.from_xyz_rpy([[0.0, 0.0, -0.1, 0.0, 0.5, 0.0]])
    assert len(beams(scan([np.inf]), LEVEL, mount, SensorParams()).ends) == 0


def test_returns_from_the_robots_own_body_are_ignored():
    result = beams(scan([0.6, 0.9]), LEVEL, LEVEL, SensorParams(min_range=0.8))
    np.testing.assert_allclose(result.ends, [(0, 0.9, 0)], atol=1e-7)


def test_returns_beyond_max_range_clear_up_to_there():
    result = beams(scan([50.0]), LEVEL, LEVEL, SensorParams(max_range=30.0))
    np.testing.assert_allclose(result.ends, [(30, 0, 0)])
    assert not result.is_hit.any()


def test_the_height_window_is_measured_from_the_base_and_not_from_the_laser():
    base = se3.from_xyz_rpy([[0, 0, 10.0, 0, 0, 0]])
    mount = se3.from_xyz_rpy([[0, 0, 1.0, 0, -np.pi / 2, 0]])  # straight up
    params = SensorParams(max_height=2.0)
    for distance, is_hit in ((0.9, True), (1.1, False)):
        result = beams(scan([distance]), base, mount, params)
        np.testing.assert_allclose(result.ends, [(0, 0, 11.0 + distance)], atol=1e-6)
        assert result.is_hit.tolist() == [is_hit]


def test_a_scan_without_any_measurement_gives_no_beams():
    result = beams(scan([np.nan, np.nan]), LEVEL, LEVEL, UP)
    assert result.ends.shape == result.origins.shape == (0, 3)


def test_nan_that_signals_is_ignored_as_any_other():
    ranges = np.array([0x7F800001, 0x40000000], np.uint32).view(np.float32)
    result = beams(scan(ranges), LEVEL, LEVEL, UP)
    np.testing.assert_allclose(result.ends[result.is_hit], [[0.0, 2.0, 0.0]], atol=1e-12)


@given(
    pose=st.lists(st.floats(-3, 3), min_size=6, max_size=6),
    mount=st.lists(st.floats(-3, 3), min_size=6, max_size=6),
    ranges=st.lists(st.floats(0.2, 20), min_size=1, max_size=9),
)
def test_a_beam_is_as_long_as_its_range_and_never_hits_nan(pose, mount, ranges):
    result = beams(scan(ranges), se3.from_xyz_rpy([pose]), se3.from_xyz_rpy([mount]), UP)
    lengths = np.linalg.norm(result.ends - result.origins, axis=1)
    assert lengths == pytest.approx(ranges, rel=1e-5)
    assert np.isfinite(result.ends).all()


def lone(ranges, distance=0.15):
    ranges = np.asarray(ranges, float)
    is_return = np.isfinite(ranges)
    return np.flatnonzero(lone_returns(ranges, is_return, distance)).tolist()


def test_a_return_between_two_surfaces_is_alone():
    assert lone([2.0, 2.0, 3.1, 5.0, 5.0]) == [2]
    assert lone([5.0, 5.0, 1.2, 5.0, 5.0]) == [2]
    assert lone([np.inf, np.inf, 1.2, np.inf, np.inf]) == [2]


def test_a_depth_step_and_its_two_sides_are_not_alone():
    assert lone([2.0, 2.0, 2.0, 5.0, 5.0, 5.0]) == []


def test_a_neighbour_that_measured_nothing_says_nothing():
    assert lone([1.2]) == []
    assert lone([np.nan, 1.2, np.nan]) == []


def test_without_a_distance_nothing_is_alone():
    assert lone([2.0, 2.0, 3.1, 5.0, 5.0], distance=0.0) == []


@given(tilt=st.floats(0.0, 1.5), noise=st.integers(0, 2**32 - 1))
def test_no_beam_on_a_straight_wall_is_alone_however_grazing(tilt, noise):
    """A wall 1 m away, seen up to 12 m along it, with 1 cm of noise.

    Farther along, neighbouring beams end metres apart and the noise of a line through two of
    them, 2 cm here, reaches the 0.15 m.
    """
    angles = np.radians(np.arange(-90, 90.5, 0.5))
    with np.errstate(divide="ignore"):
        ranges = 1.0 / np.cos(angles - tilt)
    ranges[(ranges < 0) | (ranges > 12)] = np.nan
    ranges += np.random.default_rng(noise).normal(0, 0.01, len(ranges))
    assert lone(ranges) == []


def test_beams_know_which_returns_are_alone():
    ranges = [2.0, 2.0, np.nan, 3.0, 5.0, 5.0]
    result = beams(scan(ranges, angle_increment=0.01), LEVEL, LEVEL, UP, lone_return=0.15)
    assert result.is_lone.tolist() == [False, False, True, False, False]
