# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Beams of clouds: against those of planar scans, the algebra of poses, and exact small arrays."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros import se3
from heightmap25d_ros.mapping.cloud import KNOT_NS, Cloud, cloud_beams
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.mapping.sensor_model import beams, lone_returns
from heightmap25d_ros.params.sections import CloudParams, SensorParams

UP = SensorParams(max_height=100.0, min_height=-100.0)
MOUNT = se3.from_xyz_rpy([0.3, 0.1, 0.6, 0.02, 0.3, -0.4])
POSE = se3.from_xyz_rpy([5.0, -2.0, 1.0, 0.1, -0.2, 2.0])


def cloud(points, **changes):
    return Cloud(points=np.asarray(points, np.float32).reshape(-1, 3), **changes)


def one_line(ranges, step=0.01):
    """A level fan of so many ranges; without return: NaN."""
    angles = step * np.arange(len(ranges))
    fan = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(ranges))], axis=1)
    return np.asarray(ranges)[:, None] * fan


ranges_of_scans = st.lists(
    st.sampled_from([0.05, 0.4, 2.0, 2.1, 2.3, 5.0, 9.0, 29.9, 35.0, np.nan]), min_size=1
)


@draws(80)
@given(ranges_of_scans, st.sampled_from([0.0, 0.15, 1.0]))
def test_a_cloud_of_one_line_has_the_beams_of_the_same_scan(ranges, lone_return):
    """But for points without return, which have no direction."""
    sensor = SensorParams(min_range=0.1, body_box=(0.0, -1.0, 0.0, 0.8, 1.0, 1.0))
    ranges = np.array(ranges, np.float32)
    scan = Scan(
        angle_min=0.0, angle_increment=0.01, ranges=np.where(np.isnan(ranges), np.inf, ranges)
    )
    expected = beams(scan, POSE, MOUNT, sensor, lone_return)
    is_return = np.isfinite(scan.ranges)[_kept(scan, sensor)]
    lines = np.zeros(len(ranges), np.uint16)
    found = cloud_beams(
        cloud(one_line(ranges), lines=lines), POSE, MOUNT, sensor, lone_return=lone_return
    )
    np.testing.assert_allclose(found.origins, expected.origins[is_return], atol=1e-12)
    np.testing.assert_allclose(found.ends, expected.ends[is_return], atol=1e-5)
    np.testing.assert_array_equal(found.is_hit, expected.is_hit[is_return])
    # A return that is not used, too near or of the body, contradicts nobody in a scan.
    if not (ranges < 0.8).any():
        np.testing.assert_array_equal(found.is_lone, expected.is_lone[is_return])


def _kept(scan, sensor):
    """Which of the scan's ranges have a beam."""
    single = [
        len(
            beams(
                dataclasses.replace(scan, ranges=scan.ranges[i : i + 1], angle_min=0.01 * i),
                POSE, MOUNT, sensor,
            ).ends
        )
        for i in range(len(scan.ranges))
    ]  # fmt: skip
    return np.array(single, bool)


def test_each_point_leaves_from_where_the_sensor_was_at_its_time():
    """A robot that drives at 2 m/s and turns at 3 rad/s, against the pose at each exact time."""
    rng = np.random.default_rng(3)
    offsets = np.sort(rng.integers(-20_000_000, 80_000_000, 300))
    points = rng.uniform(-20.0, 20.0, (300, 3)).astype(np.float32)
    swept = cloud(points, offsets_ns=offsets, stamp_ns=10**18)

    def poses(seconds):
        drive = [(2.0 * t, 0.1, 0.0, 0.1 * t, -0.2 * t, 3.0 * t) for t in seconds]
        return se3.from_xyz_rpy(np.array(drive))

    knots = (swept.beam_stamps_ns() - 10**18) * 1e-9
    assert np.diff(swept.beam_stamps_ns()).max() <= KNOT_NS
    wide = dataclasses.replace(UP, max_range=100.0)
    found = cloud_beams(swept, poses(knots), MOUNT, wide)
    exact = poses(offsets * 1e-9) @ MOUNT
    np.testing.assert_allclose(found.origins, exact[:, :3, 3], atol=1e-5)
    ends = np.einsum("nij,nj->ni", exact[:, :3, :3], points) + exact[:, :3, 3]
    np.testing.assert_allclose(found.ends, ends, atol=1e-4)


def test_windows_of_range_and_height():
    sensor = SensorParams(min_range=1.0, max_range=10.0, min_height=-1.0, max_height=1.5)
    points = [(0.9, 0, 0), (5, 0, 0), (20, 0, 0), (5, 0, 1.0), (5, 0, -2.0)]
    level = se3.from_xyz_rpy([0.0, 0.0, 0.6, 0.0, 0.0, 0.0])
    found = cloud_beams(cloud(points), np.eye(4), level, sensor)
    assert found.is_hit.tolist() == [True, False, False, False]
    np.testing.assert_allclose(found.ends[1], (10.0, 0.0, 0.6))


def test_nothing_comes_of_what_is_not_finite():
    points = [(np.nan, 0, 0), (np.inf, 1, 0), (0, 0, 0), (1, -np.inf, np.nan), (3e38, 3e38, 0)]
    found = cloud_beams(cloud(points), POSE, MOUNT, UP)
    assert len(found.ends) == 1, "very far away, and clears up to max_range"
    assert not found.is_hit.any()
    np.testing.assert_allclose(np.linalg.norm(found.ends - found.origins, axis=1), UP.max_range)


def test_points_farther_than_any_number_of_meters_do_no_harm():
    """Whose products float32 does not hold."""
    points = np.array([[1.0, 0.0, 0.0], [1.0, 0.1, 0.0], [1e30, -1e25, 3e38], [1.0, 0.2, 0.0]])
    lines = np.zeros(4, np.uint16)
    result = cloud_beams(
        cloud(points, lines=lines, has_gaps=True), np.eye(4), np.eye(4), UP, lone_return=0.1
    )
    assert np.isfinite(result.ends).all()
    assert result.is_hit.sum() == 3


@draws(60)
@given(st.lists(st.sampled_from([2.0, 2.1, 2.2, 2.5, 4.0, np.nan]), min_size=3, max_size=12))
def test_lone_returns_are_those_of_the_same_scan(ranges):
    ranges = np.array(ranges)
    is_return = np.isfinite(ranges)
    expected = lone_returns(np.where(is_return, ranges, np.inf), is_return, 0.15)[is_return]
    lines = np.full(len(ranges), 3, np.uint16)
    in_rows = cloud_beams(cloud(one_line(ranges), lines=lines), POSE, MOUNT, UP, lone_return=0.15)
    np.testing.assert_array_equal(in_rows.is_lone, expected)


def test_a_return_left_out_between_two_is_a_gap_in_the_line():
    """Two surfaces, and a phantom between them with nothing on both of its sides."""
    ranges = np.array([2.0] * 8 + [np.nan, 3.0, np.nan] + [5.0] * 8)
    is_return = np.isfinite(ranges)
    points = one_line(ranges)[is_return]
    dense = cloud(points, lines=np.zeros(len(points), np.uint16), has_gaps=True)
    found = cloud_beams(dense, POSE, MOUNT, UP, lone_return=0.15)
    assert np.flatnonzero(found.is_lone).tolist() == [8]
    ending = cloud(points[:9], lines=np.zeros(9, np.uint16), has_gaps=True)
    assert np.flatnonzero(cloud_beams(ending, POSE, MOUNT, UP, lone_return=0.15).is_lone) == [8]


def test_points_of_rings_that_alternate_are_neighbours_in_their_own_ring():
    near, far = one_line([2.0] * 6), one_line([9.0] * 6)
    points = np.stack([near, far], axis=1).reshape(-1, 3)
    lines = np.tile([0, 1], 6).astype(np.uint16)
    alternating = cloud(points, lines=lines, has_gaps=True)
    assert not cloud_beams(alternating, POSE, MOUNT, UP, lone_return=0.15).is_lone.any()
    wrong = cloud(points, lines=np.zeros(12, np.uint16))
    assert cloud_beams(wrong, POSE, MOUNT, UP, lone_return=0.15).is_lone.all()


def test_every_third_point_of_each_line():
    lines = np.array([0, 1] * 6, np.uint16)
    points = np.stack([np.arange(1.0, 13.0), lines, np.zeros(12)], axis=1)
    kept = cloud_beams(cloud(points, lines=lines), np.eye(4), np.eye(4), UP, CloudParams(step=3))
    np.testing.assert_array_equal(kept.ends[:, :2], [(1, 0), (2, 1), (7, 0), (8, 1)])
    alone = cloud_beams(cloud(points), np.eye(4), np.eye(4), UP, CloudParams(step=5))
    np.testing.assert_array_equal(alone.ends[:, 0], [1, 6, 11])


@draws(40)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.1, 0.7, 3.0]))
def test_one_return_of_each_voxel(seed, size):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-4.0, 4.0, (200, 3)).astype(np.float32)
    places = np.floor(points / np.float64(size)).astype(int)
    _, first = np.unique(places, axis=0, return_index=True)
    found = cloud_beams(cloud(points), np.eye(4), np.eye(4), UP, CloudParams(voxel_size=size))
    np.testing.assert_allclose(found.ends, points[np.sort(first)], atol=1e-6)


def test_arrays_must_go_together():
    with pytest.raises(ValueError, match=r"points: shape \(2, 2\), not \(N, 3\)"):
        Cloud(points=np.zeros((2, 2), np.float32))
    with pytest.raises(ValueError, match="lines: shape"):
        cloud(np.ones((2, 3)), lines=np.zeros(3, np.uint16))
    with pytest.raises(ValueError, match="T_map_base: shape"):
        cloud_beams(cloud(np.ones((4, 3))), np.zeros((3, 4, 4)), MOUNT)
