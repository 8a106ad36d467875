# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d slam`` on a recorded lap whose odometry drifts."""

import csv
import json

import numpy as np
import pytest
from repository import ROOT

from heightmap25d_ros import cli, se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import decode, slam_file
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.io.trajectory import read_tum
from heightmap25d_ros.pose_interpolation import interpolate

ROOM = ROOT / "bags" / "room_1"
PART = ["--duration", "18"]


def slam(out, *options):
    assert cli.main(["slam", str(ROOM), "-o", str(out), "--json", *options]) == 0
    return out


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    return slam(tmp_path_factory.mktemp("slam") / "map", *PART)


def planar_errors(found):
    """Distances [m] of a trajectory from the truth, both seen from where they begin."""
    with Bag(ROOM) as bag:
        events = bag.events(["/ground_truth"])
        poses = [decode.odometry(event.message) for event in events]
    stamps = np.rint(found[:, 0] * 1e9).astype(np.int64)
    known = np.array([pose.stamp_ns for pose in poses])
    true = interpolate(known, np.array([p.T for p in poses]), stamps.clip(known[0], known[-1]))
    mine = se3.from_quaternion(found[:, 1:4], found[:, 4:])
    apart = se3.inverse(se3.inverse(mine[0]) @ mine) @ (se3.inverse(true[0]) @ true)
    return np.linalg.norm(apart[:, :2, 3], axis=1)


@pytest.mark.slow
def test_a_lap_is_mapped_within_centimetres(mapped):
    errors = planar_errors(read_tum(mapped / "trajectory.tum"))
    assert np.sqrt(np.mean(errors**2)) < 0.05
    assert errors.max() < 0.12


@pytest.mark.slow
def test_the_map_says_how_it_was_made(mapped, capsys):
    report = slam_file.load(mapped)
    assert report["poses"] == "estimated"
    assert report["unobserved_m"] < 0.1 * report["distance_m"]
    with (mapped / slam_file.COVARIANCE).open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(read_tum(mapped / "trajectory.tum"))
    assert 0.0 < float(rows[-1]["xx"]) < 0.1**2
    capsys.readouterr()
    assert cli.main(["info", str(mapped), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["poses"] == "estimated"


@pytest.mark.slow
def test_the_same_bag_gives_the_same_bytes(tmp_path):
    one, other = (slam(tmp_path / name, "--duration", "6") for name in "ab")
    assert len(list(one.iterdir())) > 3
    for path in sorted(one.iterdir()):
        assert path.read_bytes() == (other / path.name).read_bytes(), path.name


def test_a_report_of_another_map_is_none(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "height_grid.npz").write_bytes(name.encode())
    report = {
        "poses": "estimated", "distance_m": 8.0, "unobserved_m": 0.0, "disagreed_m": 0.0,
        "submaps_m": [[0.0, 0.0], [4.0, 0.0]],
        "loops": [{"first": 0, "second": 1, "outcome": "closed"}],
    }  # fmt: skip
    slam_file.write(tmp_path / "a", report)
    ((first, second),) = slam_file.closed_loops(slam_file.load(tmp_path / "a"))
    np.testing.assert_array_equal([first, second], report["submaps_m"])
    assert slam_file.load(tmp_path / "a")["poses"] == "estimated"
    assert slam_file.load(tmp_path / "b") is None
    (tmp_path / "b" / "slam.json").write_text((tmp_path / "a" / "slam.json").read_text())
    assert slam_file.load(tmp_path / "b") is None


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"format_version": 2}, "format_version"),
        ({"loops": {}}, "loops"),
        ({"loops": [{}]}, "loops"),
        ({"distance_m": "far"}, "distance_m"),
    ],
)
def test_a_damaged_report_is_refused_by_name(tmp_path, changes, fault):
    (tmp_path / "height_grid.npz").write_bytes(b"")
    report = {
        "poses": "estimated", "distance_m": 8.0, "unobserved_m": 0.0, "disagreed_m": 0.0,
        "submaps_m": [], "loops": [],
    }  # fmt: skip
    slam_file.write(tmp_path, report | changes)
    with pytest.raises(InputError, match=fault):
        slam_file.load(tmp_path)


@pytest.mark.slow
def test_the_drive_is_drawn(mapped, tmp_path):
    assert cli.main(["render", str(mapped), "-o", str(tmp_path)]) == 0
    assert (tmp_path / "drive.png").stat().st_size > 10_000
