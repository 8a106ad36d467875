# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds in files of others: each format by hand, and a folder with poses as a bag that maps."""

import json

import numpy as np
import pytest

from heightmap25d_ros import se3
from heightmap25d_ros.cli import main
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import cloud_files, cloud_sequence, map_directory

POINTS = np.array([[1.0, -2.0, 0.5], [3.25, 0.0, -1.0]], np.float32)
VERTICES = (
    "ply\nformat {} 1.0\ncomment by hand\nelement vertex 2\nproperty uchar red\n"
    "property double x\nproperty double y\nproperty float z\nelement face 0\n"
    "property list uchar int vertex_indices\nend_header\n"
)
PCD = "VERSION .7\nFIELDS rgb x y z _\nSIZE 4 4 4 4 1\nTYPE U F F F U\nCOUNT 1 1 1 1 3\n"
PCD += "WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA {}\n"


def vertices(order):
    kinds = [("red", "u1"), ("x", order + "f8"), ("y", order + "f8"), ("z", order + "f4")]
    return np.array([(7, *point) for point in POINTS.tolist()], kinds).tobytes()


def text(before, after):
    rows = [[*before, *map(float, point), *after] for point in POINTS]
    return "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()


records = np.array(
    [(9, *point, (0, 0, 0)) for point in POINTS.tolist()],
    [("rgb", "<u4"), ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("_", "u1", 3)],
)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.bin", np.column_stack([POINTS, [0.5, 0.25]]).astype("<f4").tobytes()),
        ("ascii.ply", VERTICES.format("ascii").encode() + text([7], [])),
        ("little.ply", VERTICES.format("binary_little_endian").encode() + vertices("<")),
        ("big.ply", VERTICES.format("binary_big_endian").encode() + vertices(">")),
        ("ascii.pcd", PCD.format("ascii").encode() + text([9], [0, 0, 0])),
        ("binary.pcd", PCD.format("binary").encode() + records.tobytes()),
        ("a.3d", b"200 50 100 7\n0 -100 325 7\n"),
    ],
)
def test_every_format_gives_the_same_points(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    np.testing.assert_array_equal(cloud_files.read(tmp_path / name), POINTS)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.bin", b"1234567", "7 bytes are not four float32 a point"),
        ("a.bin", b"", "0 points; a cloud has 1 to"),
        ("a.las", b"", "ends in none of .bin, .pcd, .ply, .3d"),
        ("a.pcd", PCD.format("binary_compressed").encode(), "pcl_convert_pcd_ascii_binary"),
        ("a.pcd", PCD.format("binary").encode() + b"12", "a.pcd: is damaged"),
        ("a.pcd", b"VERSION .7\n", "has no line DATA"),
        ("a.ply", VERTICES.format("ascii").encode(), "0 lines for 2 points"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nend_header\n", "'x' is not in list"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message):
        cloud_files.read(tmp_path / name)


def floor(T_map_sensor):
    """A floor at z = 0 with a block, as a sensor sees it that floats above it."""
    x, y = np.meshgrid(np.arange(-4.0, 4.0, 0.1) + 0.03, np.arange(-3.0, 3.0, 0.1) + 0.03)
    z = np.where((x > 1.0) & (x < 2.0) & (np.abs(y) < 0.5), 0.4, 0.0)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return se3.transform_points(se3.inverse(T_map_sensor), points)


def test_a_sequence_of_kitti_becomes_a_bag_that_maps(tmp_path, capsys):
    """Poses of a camera that looks along x, with z ahead and y down."""
    mount = [0.1, 0.0, 1.5, 0.0, 0.0, 0.0]
    T_camera_lidar = np.array([[0, -1, 0, 0.0], [0, 0, -1, -0.1], [1, 0, 0, -0.3], [0, 0, 0, 1.0]])
    bases = [se3.from_xyz_rpy([0.5 * i, 0.0, 0.0, 0.0, 0.0, 0.2 * i]) for i in range(5)]
    first = se3.inverse(bases[0] @ se3.from_xyz_rpy(mount))
    scans, lines = tmp_path / "velodyne", []
    scans.mkdir()
    for index, T in enumerate(bases):
        sensor = T @ se3.from_xyz_rpy(mount)
        points = np.column_stack([floor(sensor), np.zeros(4800)])
        points.astype("<f4").tofile(scans / f"{index:06}.bin")
        camera = T_camera_lidar @ first @ sensor @ se3.inverse(T_camera_lidar)
        lines.append(" ".join(map(str, camera[:3].reshape(-1))))
    (tmp_path / "poses.txt").write_text("\n".join(lines))
    (tmp_path / "calib.txt").write_text(
        "P0: 1 2\nTr: " + " ".join(map(str, T_camera_lidar[:3].reshape(-1))) + "\n"
    )
    (tmp_path / "times.txt").write_text("".join(f"{1000 + 0.1 * i}\n" for i in range(5)))
    command = ["import", str(scans), "-o", str(tmp_path / "bag")]
    command += ["--poses", str(tmp_path / "poses.txt"), "--times", str(tmp_path / "times.txt")]
    command += ["--calib", str(tmp_path / "calib.txt"), "--mount", ",".join(map(str, mount))]
    assert main([*command, "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert (figures["clouds"], figures["points"], figures["duration_s"]) == (5, 24000, 0.4)
    assert main(command) == 2
    assert "bag: exists already" in capsys.readouterr().err
    assert main(["map", str(tmp_path / "bag"), "-o", str(tmp_path / "map"), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["merged"]["scans"] == 5
    assert not figures["dropped"]
    height_map = map_directory.load(tmp_path / "map", 0.5).height_map
    # The frame is that of the first pose of the lidar, 1.5 m above the floor.
    for x, expected in ((1.3, -1.1), (0.0, -1.5), (3.0, -1.5)):
        cell = tuple(height_map.geometry.cell_at((x, 0.0)))
        assert height_map.metres[cell] == pytest.approx(expected, abs=0.011)


def test_poses_of_3dtk_are_turned_to_ours(tmp_path):
    """A .pose and a .frames of the same place: 2 m ahead, 1 m left, turned to the left by 90."""
    pose = tmp_path / "scan000.pose"
    for index in (0, 1):
        (tmp_path / f"scan{index:03}.3d").write_bytes(b"0 0 100\n")
    pose.write_text("-100 0 200\n0 -90 0\n")
    turn = "0 0 1 0 0 1 0 0 -1 0 0 0 -100 0 200 1"
    (tmp_path / "scan001.frames").write_text(f"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 2\n{turn} 2\n")
    sequence = cloud_sequence.read(tmp_path)
    expected = se3.from_xyz_rpy([2.0, 1.0, 0.0, 0.0, 0.0, np.pi / 2])
    np.testing.assert_allclose(sequence.T_map_sensor, [expected, expected], atol=1e-9)
    assert np.diff(sequence.stamps_ns) == [100_000_000]
    pose.unlink()
    with pytest.raises(InputError, match=r"neither scan000.frames nor scan000.pose is beside it"):
        cloud_sequence.read(tmp_path)


def test_times_poses_and_clouds_have_to_go_together(tmp_path):
    scans = tmp_path / "scans"
    scans.mkdir()
    with pytest.raises(InputError, match="no file in it ends in"):
        cloud_sequence.read(scans)
    for name in ("a.bin", "b.bin"):
        (scans / name).write_bytes(bytes(16))
    poses, times = tmp_path / "poses", tmp_path / "times"
    poses.write_text("1.5 0 0 0 0 0 0 1\n2.5 9 0 0 0 0 0 1\n")
    assert cloud_sequence.read(scans, poses).stamps_ns.tolist() == [15 * 10**8, 25 * 10**8]
    times.write_text("2\n1\n")
    with pytest.raises(InputError, match="times: time 2 is not later"):
        cloud_sequence.read(scans, poses, times)
    poses.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    with pytest.raises(InputError, match="poses: 1 for the 2 clouds of"):
        cloud_sequence.read(scans, poses)
    poses.write_text("1 0 0 0 0 1 0 0 0 0 -1 0\n" * 2)
    with pytest.raises(InputError, match="poses: pose 1 is none of a body on Earth"):
        cloud_sequence.read(scans, poses)
    (scans / "c.ply").write_bytes(b"")
    with pytest.raises(InputError, match=r"files of several kinds, .bin, .ply"):
        cloud_sequence.read(scans, poses)
