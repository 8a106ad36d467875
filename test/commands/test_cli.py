# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command line, as a user calls it, on the project's bag."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bag_writer import laser_scan, odometry, tf_message, write_bag
from PIL import Image
from repository import ROOT

from heightmap25d_ros import cli
from heightmap25d_ros.io import map_directory, trajectory
from heightmap25d_ros.pipelines.self_check import Observed, findings

RAMP = ROOT / "bags" / "ramp"
TRUTH = RAMP / "truth" / "surface.npz"
SHARED = Path(os.environ.get("HEIGHTMAP25D_SHARED_BAGS", ROOT.parent / "shared" / "bags"))


def run(capsys, *arguments):
    """Exit status, figures, and what was said on standard error."""
    try:
        status = cli.main([str(argument) for argument in (*arguments, "--json")])
    except SystemExit as end:
        status = end.code
    out, err = capsys.readouterr()
    return status, json.loads(out) if status == 0 else None, err


@pytest.fixture(scope="module")
def ramp_map(tmp_path_factory):
    directory = tmp_path_factory.mktemp("maps") / "ramp"
    assert cli.main(["map", str(RAMP), "-o", str(directory)]) == 0
    return directory


@pytest.mark.slow
def test_map_is_deterministic_and_says_what_it_did(capsys, tmp_path, ramp_map):
    status, figures, _ = run(capsys, "map", RAMP, "-o", tmp_path / "again")
    assert status == 0
    assert figures["merged"]["scans"] == 2066
    assert figures["dropped"] == figures["damaged"] == {}
    assert figures["sha256"] == map_directory.digest(ramp_map)
    for name in ("map.pgm", "map.yaml", "trajectory.tum"):
        assert (tmp_path / "again" / name).read_bytes() == (ramp_map / name).read_bytes()
    assert figures["real_time_factor"] > 0
    assert figures["scan_p50_ms"] <= figures["scan_p99_ms"]


@pytest.mark.slow
def test_the_map_of_the_ramp_against_its_truth(capsys, ramp_map):
    """Bounds with room; measured: 0.996, 0.000, 1.000, 0.999."""
    _, figures, _ = run(capsys, "evaluate", ramp_map, "--truth", TRUTH)
    assert figures["coverage"] > 0.99
    assert figures["error_of_seen"]["median_absolute_m"] < 0.01
    assert figures["blocked_transitions"]["precision"] > 0.99
    assert figures["blocked_transitions"]["recall"] > 0.98


@pytest.mark.slow
def test_evaluate_refuses_the_truth_of_another_world(capsys, ramp_map):
    other = ROOT / "bags" / "room_1" / "truth" / "surface.npz"
    status, _, err = run(capsys, "evaluate", ramp_map, "--truth", other)
    assert status == 2
    (line,) = err.splitlines()
    assert "% of its 88" in line
    assert "another world" in line


@pytest.mark.slow
def test_convert_never_replaces_a_map_by_an_empty_one(capsys, tmp_path, ramp_map):
    file = tmp_path / "sure.yaml"
    sure = "mapper: {probability_threshold: 0.99, probability_max: 0.999}"
    file.write_text(f"/**:\n  ros__parameters:\n    {sure}\n")
    digest = map_directory.digest(ramp_map)
    for output in ((), ("-o", tmp_path / "out")):
        status, _, err = run(capsys, "convert", ramp_map, *output, "--params", file)
        assert (status, err.count("\n")) == (2, 1)
        assert "nothing has been mapped" in err
    assert map_directory.digest(ramp_map) == digest
    assert not (tmp_path / "out").exists()


def small_bag(path, *, z=0.01, ranges=(2.0,) * 100, **fields):
    """Two seconds of a robot that stands still, with one laser, tilted so that it sees ground."""
    events = []
    mount = tf_message((0, "base_link", "laser", (0.0, 0.0, 0.5), (0.0, 0.06, 0.0, 0.998)))
    events.append(("/tf_static", 10**9, mount))
    for step in range(100):
        stamp = 10**9 + step * 20_000_000
        events.append(("/odom", stamp, odometry(stamp, (0.0, 0.0, z * (step % 2)))))
        scan = laser_scan(stamp + 1_000_000, ranges, **fields)
        events.append(("/scan", stamp + 1_000_000, scan))
    return write_bag(path, events)


@pytest.mark.parametrize(
    ("fields", "numbers"),
    [
        (
            {"ranges": (4200.0,) * 100},
            "100% of 9900 are beyond range_max, the median is 4200 m against a range_max of 30 m",
        ),
        ({"range_max": 1.0}, "the median is 2 m against a range_max of 1 m"),
        ({"range_min": 0.0, "range_max": 0.0}, "a range_max of 0 m"),
        ({"ranges": (0.0,) * 100}, "100% of 9900 are below range_min"),
        ({"angle_max": 180.0}, "180.5 rad"),
        ({"range_max": np.nan}, "scan: bad range_max (100, the last one: range_max: nan"),
    ],
)
def test_a_map_that_would_be_empty_is_refused_with_the_numbers(capsys, tmp_path, fields, numbers):
    bag = small_bag(tmp_path / "bag", **fields)
    status, _, err = run(capsys, "map", bag, "-o", tmp_path / "out")
    assert (status, err.count("\n")) == (2, 1)
    assert numbers in err
    assert not (tmp_path / "out").exists()


def test_flat_odometry_is_told_in_the_words_of_the_self_check(capsys, tmp_path):
    bag = small_bag(tmp_path / "bag", z=0.0)
    status, figures, err = run(capsys, "map", bag, "-o", tmp_path / "out")
    sentence = str(findings(Observed(scans=100, dropped={}, flat_poses=100))[0])
    assert status == 0
    assert figures["warnings"] == [sentence]
    assert f"warning: {sentence} (see docs/troubleshooting.md)" in err


def test_a_sound_bag_has_no_warnings(capsys, tmp_path):
    status, figures, err = run(capsys, "map", small_bag(tmp_path / "bag"), "-o", tmp_path / "out")
    assert (status, figures["warnings"], err) == (0, [], "")


def test_times_that_do_not_go_together_are_warned_of(capsys, tmp_path):
    bag = small_bag(tmp_path / "bag", time_increment=0.01)
    _, figures, _ = run(capsys, "map", bag, "-o", tmp_path / "out")
    assert "a scan lasts 0.99 s, and the next one comes after 0.02 s" in figures["warnings"][0]


@pytest.mark.slow
def test_the_papers_rule_on_the_ramp(capsys, tmp_path):
    """Measured: 0.990, 0.0065, 1.0, 0.995; grazing beams cost it coverage."""
    run(capsys, "map", RAMP, "-o", tmp_path / "paper", "--update-rule", "paper")
    _, figures, _ = run(capsys, "evaluate", tmp_path / "paper", "--truth", TRUTH)
    assert 0.98 < figures["coverage"] < 0.995
    assert figures["error_of_seen"]["median_absolute_m"] < 0.01


@pytest.mark.slow
def test_the_maps_size_is_the_papers(ramp_map):
    """Fig. 2: 256 x 64 cells with two numbers each, 32,768 of them."""
    height_map = map_directory.load(ramp_map, 0.5).height_map
    assert height_map.height.size + height_map.probability.size == 32_768


def test_scan_topics_of_a_parameter_file_are_those_that_are_mapped(capsys, tmp_path):
    params = tmp_path / "params.yaml"
    params.write_text("/**: {ros__parameters: {intake: {scan_topics: [scan_down]}}}\n")
    _, by_file, _ = run(capsys, "map", RAMP, "-o", tmp_path / "file", "--params", params)
    _, by_option, _ = run(capsys, "map", RAMP, "-o", tmp_path / "o", "--scan-topic", "/scan_down")
    assert by_file["sha256"] == by_option["sha256"]
    params.write_text("/**: {ros__parameters: {intake: {scan_topics: [scan_up]}}}\n")
    status, _, error = run(capsys, "map", RAMP, "-o", tmp_path / "none", "--params", params)
    assert status == 2
    assert "/scan_up" in error


@pytest.mark.slow
def test_one_laser_of_two(capsys, tmp_path):
    _, figures, _ = run(capsys, "map", RAMP, "-o", tmp_path / "level", "--scan-topic", "/scan")
    assert figures["merged"]["scans"] == 1033


@pytest.mark.slow
def test_parameters_of_a_file_count(capsys, tmp_path, ramp_map):
    file = tmp_path / "coarse.yaml"
    file.write_text("/**:\n  ros__parameters:\n    grid.resolution: 0.25\n")
    run(capsys, "map", RAMP, "-o", tmp_path / "coarse", "--params", file)
    assert map_directory.load(tmp_path / "coarse", 0.5).height_map.geometry.resolution == 0.25


@pytest.mark.slow
def test_convert_for_a_robot_that_climbs_more(capsys, tmp_path, ramp_map):
    file = tmp_path / "climber.yaml"
    file.write_text("/**:\n  ros__parameters:\n    traversability.max_step: 0.2\n")
    _, before, _ = run(capsys, "info", ramp_map)
    _, after, _ = run(capsys, "convert", ramp_map, "-o", tmp_path / "out", "--params", file)
    assert after["known_cells"] == before["known_cells"]
    assert after["occupied_cells"] < before["occupied_cells"]
    grid = (tmp_path / "out" / "height_grid.npz").read_bytes()
    assert grid == (ramp_map / "height_grid.npz").read_bytes()


@pytest.mark.slow
def test_render_draws_three_pictures_that_show_something(capsys, tmp_path, ramp_map):
    _, figures, _ = run(capsys, "render", ramp_map, "-o", tmp_path / "pictures")
    assert len(figures["pictures"]) == 3
    for picture in figures["pictures"]:
        assert len(np.unique(np.asarray(Image.open(picture)).reshape(-1, 4), axis=0)) > 3


def test_ctrl_c_while_commands_are_imported_ends_without_a_word():
    script = (
        "import os, signal, time\n"
        "from heightmap25d_ros import cli\n"
        "def interrupted(name):\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "    time.sleep(60)\n"
        "cli.import_module = interrupted\n"
        "cli.main(['info', 'bag'])\n"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (cli.EXIT_INTERRUPTED, b"", b"")


def test_info_of_a_bag(capsys):
    _, figures, _ = run(capsys, "info", RAMP)
    assert figures["/scan_down (sensor_msgs/msg/LaserScan)"] == 1033


@pytest.mark.slow
def test_help_and_plain_figures(capsys, ramp_map):
    with pytest.raises(SystemExit):
        cli.main(["map", "--help"])
    assert "--odom-topic" in capsys.readouterr().out
    assert cli.main(["info", str(ramp_map)]) == 0
    assert "known_cells" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("map", "nowhere", "-o", "out"), "nowhere"),
        (("map", RAMP, "-o", "out", "--odom-topic", "/odo"), "/odo"),
        (("map", RAMP, "-o", "out", "--scan-topic", "/odom"), "/odom is a nav_msgs/msg/Odometry"),
        (("map", RAMP, "-o", "out", "--odom-topic", "/scan"), "/scan is a sensor_msgs/msg/LaserSc"),
        pytest.param(("map", RAMP, "-o", "/proc/out"), "/proc/out", marks=pytest.mark.slow),
        (("map", RAMP, "-o", "out", "--scan-topic", "/scam"), "/scam"),
        (("map", RAMP, "-o", "out", "--params", "none.yaml"), "none.yaml"),
        (("map", RAMP, "-o", "out", "--update-rule", "no"), "--update-rule"),
        (("map", RAMP), "-o"),
        (("render", "nowhere", "-o", "out"), "nowhere"),
        (("evaluate", "nowhere", "--truth", TRUTH), "nowhere"),
        (("info", "nowhere"), "nowhere"),
        (("view", "nowhere"), "nowhere: does not exist"),
        ((), "COMMAND"),
    ],
)
def test_unusable_input_is_one_line_and_status_2(
    capsys, tmp_path, monkeypatch, arguments, complaint
):
    monkeypatch.chdir(tmp_path)
    status, _, err = run(capsys, *arguments)
    assert status == 2
    assert complaint in err.splitlines()[-1]
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_cut_bag_is_mapped_as_far_as_it_goes(capsys, tmp_path):
    cut = tmp_path / "cut"
    shutil.copytree(RAMP, cut, ignore=shutil.ignore_patterns("truth"))
    content = (cut / "ramp.mcap").read_bytes()
    (cut / "ramp.mcap").write_bytes(content[: len(content) // 2])
    status, figures, _ = run(capsys, "map", cut, "-o", tmp_path / "out")
    assert status == 0
    assert 900 < figures["merged"]["scans"] < 1100
    unfinished, counts = figures["warnings"]
    assert f"{cut / 'ramp.mcap'}: unfinished or damaged" in unfinished
    assert f"{cut}: holds " in counts
    assert "metadata.yaml counts 5103" in counts


@pytest.mark.slow
@pytest.mark.skipif(not SHARED.exists(), reason="the real recordings are not here")
def test_the_nodding_laser_sees_the_corridors_floor_and_no_ceiling(capsys, tmp_path):
    """Kurt3D: a floor at 0, flat within centimetres up to 5 m, walls 2.3 m apart."""
    run(capsys, "map", SHARED / "kurt3d_sick_nodding", "-o", tmp_path / "kurt3d",
        "--params", ROOT / "config" / "kurt3d.yaml")  # fmt: skip
    height_map = map_directory.load(tmp_path / "kurt3d", 0.5).height_map
    heights = np.where(height_map.known, height_map.height * 0.01, np.nan)
    (y0, x0), (y1, x1) = height_map.geometry.cell_at([(0.5, -0.5), (5.0, 0.6)])
    floor = heights[y0:y1, x0:x1]
    assert np.isfinite(floor).mean() > 0.9
    assert np.abs(np.nanmedian(floor)) < 0.03
    assert np.nanmax(np.abs(floor)) < 0.10
    assert np.nanmax(heights) < 1.9


@pytest.fixture(scope="module")
def localized(tmp_path_factory):
    """The first half of the lap of bags/room_1, in a map of the same seconds with true poses."""
    directory, bag = tmp_path_factory.mktemp("localized"), ROOT / "bags" / "room_1"
    truth = ["--duration", "16", "--odom-topic", "/ground_truth"]
    assert cli.main(["map", str(bag), "-o", str(directory / "map"), *truth]) == 0
    arguments = [
        "localize",
        str(bag),
        "--map",
        str(directory / "map"),
        "--duration",
        "16",
        "-o",
        str(directory / "out"),
    ]
    assert cli.main(arguments) == 0
    return directory, arguments


@pytest.mark.slow
def test_localize_writes_trajectory_registrations_and_pictures(localized):
    directory, _ = localized
    out = directory / "out"
    rows = trajectory.read_tum(out / "trajectory.tum")
    truth = trajectory.read_tum(directory / "map" / "trajectory.tum")
    assert np.linalg.norm(rows[-1, 1:4] - truth[-1, 1:4]) < 0.05
    lines = (out / "registrations.csv").read_text().splitlines()
    assert lines[0].split(",")[:4] == ["t", "kind", "reason", "state"]
    assert len(lines) > 40  # half a lap
    for name in ("trajectories.png", "errors.png", "score.png"):
        with Image.open(out / name) as picture:
            assert min(picture.size) > 300


@pytest.mark.slow
def test_localize_is_deterministic_and_tells_its_error(capsys, tmp_path, localized):
    directory, arguments = localized
    status, figures, _ = run(capsys, *arguments[:-1], tmp_path)
    assert status == 0
    for name in ("trajectory.tum", "registrations.csv"):
        assert (tmp_path / name).read_bytes() == (directory / "out" / name).read_bytes()
    assert figures["state"] == "TRACKING"
    assert figures["corrected"]["planar_max_m"] < 0.1 < figures["odometry_alone"]["planar_max_m"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [{1: "/nowhere"}, {3: "/nowhere"}, {3: str(RAMP)}],
)
def test_localize_refuses_what_it_cannot_read(capsys, localized, change):
    arguments = dict(enumerate(localized[1])) | change
    status, _, error = run(capsys, *arguments.values())
    assert status == 2
    assert error.count("\n") == 1


@pytest.mark.slow
def test_localize_begins_and_ends_where_it_is_told_to(capsys, localized, tmp_path):
    part = ["--start", "2", "--duration", "1.5"]
    status, _, error = run(capsys, *localized[1][:4], *part, "-o", str(tmp_path))
    assert status == 0, error
    stamps = trajectory.read_tum(tmp_path / "trajectory.tum")[:, 0]
    whole = trajectory.read_tum(localized[0] / "out" / "trajectory.tum")[:, 0]
    assert stamps[0] - whole[0] == pytest.approx(2.0, abs=0.1)
    assert stamps[-1] - stamps[0] == pytest.approx(1.5, abs=0.1)
    status, _, error = run(capsys, *localized[1][:4], "--start", "99", "-o", str(tmp_path))
    assert status == 2
    assert "lasts 33.8 s" in error


@pytest.mark.slow
def test_localize_refuses_a_bad_initial_pose(capsys, localized):
    status, _, error = run(capsys, *localized[1], "--initial", "1,2")
    assert status == 2
    assert "x,y,z,yaw" in error
