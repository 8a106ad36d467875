# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds through queue and pipelines: a turning lidar over a floor with a block, and bad clouds.

The robot turns on the spot at 1 rad/s; a point is only in its place if its beam has its own pose.
"""

import json
from functools import cache

import numpy as np
import pytest
from bag_writer import laser_scan, odometry, point_cloud, tf_message, write_bag

import heightmap25d_ros as hm
from heightmap25d_ros import cli, se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params import sources
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import with_sources
from heightmap25d_ros.pipelines.scan_queue import ScanQueue
from heightmap25d_ros.pipelines.self_check import Problem

BEGIN = 1_700_000_000 * 10**9
MS = 10**6
MOUNT = (0.2, 0.0, 0.7, 0.0, 0.0, 0.0)
PARAMS = with_values(
    Params(), {"intake.cloud_topics": ["points"], "intake.cloud_mounts": list(MOUNT)}
)
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<u4"), ("ring", "<u2")])
RINGS, COLUMNS = 24, 400
BLOCK = (2.0, 4.0, -1.0, 1.0, 0.35)  # x from and to, y from and to, top [m]


def pose(seconds):
    return se3.from_xyz_rpy([0.0, 0.0, 0.0, 0.0, 0.0, seconds])


def _range(origin, direction):
    """To the block or the floor, whichever comes first; infinite: neither."""
    x0, x1, y0, y1, top = BLOCK
    low, high = np.array([x0, y0, -1.0]), np.array([x1, y1, top])
    with np.errstate(divide="ignore"):
        ends = np.sort([(low - origin) / direction, (high - origin) / direction], axis=0)
    entered, left = ends[0].max(), ends[1].min()
    floor = -origin[2] / direction[2] if direction[2] < 0.0 else np.inf
    return min(entered if 0.0 < entered <= left else np.inf, floor)


def sweep(index):
    """Message of a sweep of 0.1 s, each column from its own pose."""
    return point_cloud(BEGIN + 100 * index * MS, swept(index))


@cache
def swept(index):
    start = 0.1 * index
    points = np.zeros((COLUMNS, RINGS), POINT)
    azimuths = np.arange(COLUMNS) * (2 * np.pi / COLUMNS)
    elevations = np.radians(np.linspace(-30.0, 5.0, RINGS))
    for column, azimuth in enumerate(azimuths):
        offset = 0.1 * column / COLUMNS
        T = pose(start + offset) @ se3.from_xyz_rpy(MOUNT)
        for ring, elevation in enumerate(elevations):
            ray = np.array(
                [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth),
                 np.sin(elevation)]
            )  # fmt: skip
            reach = _range(T[:3, 3], T[:3, :3] @ ray)
            if reach < 25.0:
                points[column, ring] = (*(reach * ray), round(offset * 1e9), ring)
    points = points.reshape(-1)
    return points[points["x"] != 0.0]


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A bag of three sweeps and no laser: what a robot with a lidar records."""
    mount = BEGIN, "base_link", "lidar", MOUNT[:3], (0.0, 0.0, 0.0, 1.0)
    events = [("/tf_static", BEGIN, tf_message(mount))]
    for milliseconds in range(0, 400, 20):
        T = pose(milliseconds * 1e-3)
        stamp = BEGIN + milliseconds * MS
        message = odometry(stamp, T[:3, 3], se3.to_quaternion(T))
        events.append(("/odom", stamp, message))
    events += [
        ("/lidar/points", BEGIN + (index + 1) * 100 * MS, sweep(index)) for index in range(3)
    ]
    return write_bag(tmp_path_factory.mktemp("bags") / "lidar", sorted(events, key=lambda e: e[1]))


def test_a_turning_lidar_maps_floor_and_block_where_they_are(drive):
    height_map = hm.map_bag(drive)
    known = height_map.known
    iy, ix = np.nonzero(known)
    x, y = height_map.geometry.cell_center(np.stack([iy, ix], axis=1)).T
    x0, x1, y0, y1, top = BLOCK
    half = height_map.geometry.resolution
    is_inside = (x > x0 + half) & (x < x1 - half) & (y > y0 + half) & (y < y1 - half)
    is_outside = (x < x0 - half) | (x > x1 + half) | (y < y0 - half) | (y > y1 + half)
    heights = height_map.metres[iy, ix]
    assert is_inside.sum() >= 20
    assert is_outside.sum() >= 1000
    np.testing.assert_allclose(heights[is_inside], top, atol=0.011)
    np.testing.assert_allclose(heights[is_outside], 0.0, atol=0.011)


def test_the_command_line_takes_the_clouds_of_a_bag_without_lasers(drive, tmp_path, capsys):
    command = ["map", str(drive), "-o", str(tmp_path / "map"), "--json"]
    assert cli.main(command) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["merged"]["scans"] == 3
    assert not figures["dropped"]
    assert figures["clouds"] == {
        "/lidar/points": "neighbours in rings (ring); time of each point: t, nanoseconds after the "
        "stamp of the header"
    }
    assert cli.main([*command, "--cloud-topic", "/lidar/points"]) == 0
    assert json.loads(capsys.readouterr().out)["sha256"] == figures["sha256"]
    assert cli.main([*command, "--cloud-topic", "/odom"]) == 2
    assert "/odom is a nav_msgs/msg/Odometry, not a sensor_msgs/msg/PointCloud2" in (
        capsys.readouterr().err
    )


def test_which_topics_of_a_bag_are_used(drive, tmp_path):
    both = write_bag(
        tmp_path / "both",
        [("/scan", BEGIN, laser_scan(BEGIN)), ("/points", BEGIN, sweep(0))],
    )
    with Bag(drive) as lidar, Bag(both) as bag:
        assert with_sources(Params(), [lidar]).intake.source_topics == ("/lidar/points",)
        assert with_sources(Params(), [bag]).intake.source_topics == ("/scan",)
        named = with_sources(Params(), [bag], ["/scan"], ["/points"]).intake
        assert (named.scan_topics, named.cloud_topics) == (("/scan",), ("/points",))
        assert with_sources(PARAMS, [bag]).intake.source_topics == ("/points",)


def test_where_clouds_are_given_alone_no_laser_is_waited_for():
    assert PARAMS.intake.source_topics == ("points",)
    both = {"intake.cloud_topics": ["points"], "intake.scan_topics": ["scan"]}
    assert with_values(Params(), both).intake.source_topics == ("scan", "points")
    with pytest.raises(InputError, match="cloud_mounts: 6 numbers for 2 cloud_topics"):
        with_values(PARAMS, {"intake.cloud_topics": ["points", "more"]})
    with pytest.raises(InputError, match="cloud_topics: a topic is empty or named twice"):
        with_values(Params(), {"intake.cloud_topics": ["points", "points"]})
    with pytest.raises(InputError, match="cloud_topics: scan is in scan_topics too"):
        with_values(Params(), both | {"intake.cloud_topics": ["scan"]})


def test_each_source_has_its_own_ranges_mount_and_decimation():
    """The same sweep from two lidars: of one only what is near is mapped, and every tenth point."""
    own = {
        "intake.cloud_topics": ["points", "/near/points"],
        "sensor.near_points.max_range": 3.0,
        "sensor.near_points.mount": [*MOUNT[:2], MOUNT[2] + 0.1, 0.0, 0.0, 0.0],
        "cloud.near_points.step": 10,
    }
    params = with_values(Params(), {**own, "intake.cloud_mounts": [*MOUNT, *MOUNT]})
    queue = ScanQueue(params.intake, mounts=sources.mounts(params))
    for milliseconds in range(0, 200, 20):
        queue.take_odometry(odometry(BEGIN + milliseconds * MS))
    queue.take_cloud("points", sweep(0))
    near, far = queue.take_cloud("/near/points", sweep(0))
    every, few = far.beams(params), near.beams(params)
    assert len(few.ends) < 0.11 * len(every.ends)
    assert np.linalg.norm(few.ends - few.origins, axis=1).max() <= 3.001
    assert few.origins[:, 2] == pytest.approx(MOUNT[2] + 0.1)
    assert every.origins[:, 2] == pytest.approx(MOUNT[2])
    assert few.is_hit.any()
    assert every.is_hit[np.linalg.norm(every.ends - every.origins, axis=1) > 4.0].any()
    told = with_values(params, {"sensor.nera_points.max_range": 2.0})
    assert any("no topic is nera_points" in notice for notice in Mapping(told).dropped.notices)


def test_a_cloud_waits_for_the_poses_of_its_last_point():
    queue = ScanQueue(PARAMS.intake)
    queue.take_odometry(odometry(BEGIN))
    assert queue.take_cloud("points", sweep(0)) == []
    queue.take_odometry(odometry(BEGIN + 90 * MS))
    (reading,) = queue.take_odometry(odometry(BEGIN + 110 * MS))
    assert reading.T_map_base.shape == (101, 4, 4)
    assert len(reading.beams(PARAMS).ends) == len(reading.scan.points)


def test_clouds_that_are_not_used_are_counted_by_reason():
    mapping = Mapping(PARAMS)
    for milliseconds in range(0, 400, 20):
        mapping.take_odometry(odometry(BEGIN + milliseconds * MS))
    good, later = sweep(0), sweep(2)
    for message in (good, good, later, sweep(1)):
        mapping.take_cloud("points", message)
    for field, change in (("width", 0), ("width", 2**31), ("fields", []), ("point_step", 10)):
        bad = sweep(0)
        setattr(bad, field, change)
        mapping.take_cloud("points", bad)
    assert dict(mapping.dropped) == {
        "cloud: stamp seen before": 1, "cloud: out of order": 1, "cloud: bad width": 2,
        "cloud: bad fields": 2,
    }  # fmt: skip
    assert mapping.dropped.examples["cloud: bad width"].endswith("points are more than 4000000")
    assert Problem.REFUSED in [finding.problem for finding in mapping.problems()]


def test_clouds_without_a_mount_are_named_by_the_self_check():
    mapping = Mapping(with_values(Params(), {"intake.cloud_topics": ["points"]}))
    for milliseconds in range(0, 2000, 20):
        mapping.take_odometry(odometry(BEGIN + milliseconds * MS))
    mapping.take_cloud("points", sweep(0))
    mapping.flush()
    (found,) = (f for f in mapping.problems() if f.problem is Problem.UNKNOWN_MOUNT)
    assert "cloud: " in found.detail
    assert "'lidar'" in found.detail


def test_a_lidar_that_falls_silent_leaves_the_pose_degraded():
    localizer = Localizer(PARAMS)
    for tenths in range(15):
        localizer.pass_time(BEGIN + tenths * 100 * MS)
        localizer.take_odometry(odometry(BEGIN + tenths * 100 * MS))
    assert "nothing from points" in localizer.lapse
