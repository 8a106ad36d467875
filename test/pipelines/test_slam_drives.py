# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several drives of one place, mapped by themselves and made one map."""

import pickle
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import pytest
from localization_bags import PARAMS
from repository import ROOT

from heightmap25d_ros import cli, se3
from heightmap25d_ros.io import decode, map_directory
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.pipelines.slam_drives import (
    DriveTask,
    join_drives,
    joint_report,
    slam_drive,
)
from heightmap25d_ros.pose_interpolation import interpolate

ROOM = ROOT / "bags" / "room_1"


def task(begin, end):
    with Bag(ROOM) as bag:
        part = tuple(bag.start_ns + round(s * 1e9) for s in (begin, end))
    return DriveTask(path=ROOM, params=PARAMS, odom_topic="/odom", stretch=part)


@pytest.fixture(scope="module")
def drives():
    tasks = [task(0.0, 5.0), task(4.0, 8.0)]
    return tasks, [slam_drive(one) for one in tasks]


@pytest.mark.slow
def test_drives_are_joined_where_the_robot_was(drives):
    tasks, mapped = drives
    joint = join_drives(tasks, mapped)
    with Bag(ROOM) as bag:
        poses = [decode.odometry(event.message) for event in bag.events(["/ground_truth"])]
    stamps, true = np.array([p.stamp_ns for p in poses]), np.array([p.T for p in poses])
    steps = [step for trajectory in joint.trajectories for step in trajectory]
    asked = np.array([stamp for stamp, _ in steps]).clip(stamps[0], stamps[-1])
    expected = interpolate(stamps, true, asked)
    found = np.array([pose for _, pose in steps])
    first = se3.inverse(found[0]) @ found, se3.inverse(expected[0]) @ expected
    away = (first[0] - first[1])[:, :2, 3]
    assert np.sqrt((away**2).sum(axis=1).mean()) < 0.05
    report = joint_report(joint, mapped)
    assert report["distance_m"] == pytest.approx(sum(d.report["distance_m"] for d in mapped))
    assert len(report["submaps_m"]) == sum(len(d.report["submaps_m"]) for d in mapped)
    known = joint.mapping.maps()[0].known.sum()
    assert known > max(drive.height_map.known.sum() for drive in mapped)


@pytest.mark.slow
def test_a_saved_map_is_gone_on_from_and_what_has_changed_is_updated(drives, tmp_path):
    (_, task_of_now), (then, now) = drives
    saved, geometry = then.height_map, then.height_map.geometry
    iy, ix = geometry.cell_at((4.7, -0.4))
    shelf = slice(iy - 1, iy + 2), slice(ix - 1, ix + 2)
    assert saved.known[shelf].all()
    assert (saved.height[shelf] < 5).all()
    height = saved.height.copy()
    height[shelf] = 50  # which has been moved away since
    map_directory.save(tmp_path, replace(saved, height=height), layers=then.layers)
    joint = join_drives([task_of_now], [now], tmp_path)
    height_map = joint.mapping.maps()[0]
    area = geometry.cell_center(np.argwhere(np.ones(geometry.shape)))
    before = saved.metres.ravel()
    inside = height_map.geometry.cell_at(area)
    kept = height_map.geometry.contains(inside) & ~np.isnan(before)
    again = height_map.metres[tuple(inside[kept].T)]
    assert np.nanmedian(np.abs(again - before[kept])) < 0.02  # the frame stays
    where = height_map.geometry.cell_at(geometry.cell_center((iy, ix)))
    around = slice(where[0] - 1, where[0] + 2), slice(where[1] - 1, where[1] + 2)
    np.testing.assert_allclose(height_map.metres[around], 0.0, atol=0.05)
    assert height_map.known.sum() > saved.known.sum()


@pytest.mark.slow
def test_another_process_gives_the_same(drives):
    tasks, mapped = drives
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        (again,) = pool.map(slam_drive, tasks[1:])
    assert pickle.dumps(again.poses) == pickle.dumps(pickle.loads(pickle.dumps(mapped[1].poses)))
    np.testing.assert_array_equal(again.height_map.height, mapped[1].height_map.height)
    np.testing.assert_array_equal(again.covariances, mapped[1].covariances)


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        (["--start", "2"], "--start and --duration are for a single bag"),
        (["--jobs", "0"], "0 is not a number from 1 on"),
    ],
)
def test_options_that_do_not_go_together_are_refused(tmp_path, capsys, options, fault):
    arguments = ["slam", str(ROOM), str(ROOM), "-o", str(tmp_path / "out"), *options]
    try:
        status = cli.main(arguments)
    except SystemExit as exit:
        status = exit.code
    assert status == 2
    assert fault in capsys.readouterr().err
