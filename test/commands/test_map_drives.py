# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d map`` of a part of a bag, of several bags, and into an existing map."""

import json

import numpy as np
import pytest
from bag_writer import laser_scan, odometry, tf_message, write_bag

from heightmap25d_ros import cli
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.io.layers_file import LAYERS

START = 1_700_000_000 * 10**9
STEP = 20_000_000  # [ns] from one pose to the next, and from one scan to the next
HALF = 50
ANGLES = -0.5 + 0.1 * np.arange(11)
DOWN = 0.5  # [rad] pitch of /scan_down, 1 m above flat ground
MOUNTS = (
    (0, "base_link", "level", (0.0, 0.0, 0.5), (0.0, 0.0, 0.0, 1.0)),
    (0, "base_link", "down", (0.0, 0.0, 1.0), (0.0, np.sin(DOWN / 2), 0.0, np.cos(DOWN / 2))),
)
GRID = map_directory.HEIGHT_GRID, map_directory.MAP_PGM, map_directory.MAP_YAML


def drive(*, scan_delay=0, frame="odom", steps=2 * HALF, sway=0.001):
    """A robot that drives along x at 1 m/s towards a wall at x = 6 m; its z sways [m]."""
    events = [("/tf_static", START, tf_message(*MOUNTS))]
    ground = 1.0 / (np.sin(DOWN) * np.cos(ANGLES))
    for index in range(steps):
        stamp, x = START + index * STEP, 0.02 * index
        events.append(
            ("/odom", stamp, odometry(stamp, (x, 0.0, sway * (index % 2)), frame_id=frame))
        )
        wall = (6.0 - x) / np.cos(ANGLES)
        # No laser measures the same twice.
        floor = ground * (1.0 + 1e-5 * (index % 2))
        for topic, ranges, laser in (("/scan", wall, "level"), ("/scan_down", floor, "down")):
            scan = laser_scan(stamp + scan_delay, ranges, laser)
            events.append((topic, stamp + scan_delay, scan))
    return events


def run(capsys, *arguments):
    """Exit status, figures, and what was said on standard error."""
    status = cli.main([*map(str, arguments), "--json"])
    out, error = capsys.readouterr()
    return status, json.loads(out) if out else {}, error


def halves(tmp_path, events):
    """The whole drive, and what was recorded before and after half of its time, as bags."""
    cut = START + HALF * STEP
    first = [event for event in events if event[1] < cut]
    second = [event for event in events if event[1] >= cut]
    parts = {"whole": events, "first": first, "second": second}
    return [write_bag(tmp_path / name, part) for name, part in parts.items()]


def assert_same_map(one, other, names=(*GRID, LAYERS)):
    for name in names:
        assert (one / name).read_bytes() == (other / name).read_bytes(), name


def assert_gone_on_from(one, other):
    """The same map; means in its layers, which were stored in between, but for their rounding."""
    assert_same_map(one, other, GRID)
    with np.load(one / LAYERS) as layers, np.load(other / LAYERS) as expected:
        assert layers.files == expected.files
        for name in layers.files:
            if layers[name].dtype == np.float32:
                np.testing.assert_allclose(layers[name], expected[name], rtol=1e-5, atol=1e-6)
            else:
                np.testing.assert_array_equal(layers[name], expected[name])


def test_two_halves_make_the_map_of_the_whole(capsys, tmp_path):
    """Each scan has the stamp of a pose, so that the cut costs none; /tf_static is in one half."""
    whole, first, second = halves(tmp_path, drive())
    status, figures, _ = run(capsys, "map", whole, "-o", tmp_path / "at_once")
    assert (status, figures["merged"]["scans"]) == (0, 200)
    status, again, error = run(capsys, "map", first, second, "-o", tmp_path / "halves")
    assert (status, error) == (0, "")
    assert again["bags"] == [str(first), str(second)]
    assert (again["merged"], again["dropped"]) == (figures["merged"], {})
    assert_same_map(tmp_path / "halves", tmp_path / "at_once")
    poses = (tmp_path / "halves" / map_directory.TRAJECTORY).read_bytes()
    assert poses == (tmp_path / "at_once" / map_directory.TRAJECTORY).read_bytes()


def test_where_bags_meet_a_scan_between_two_poses_is_lost(capsys, tmp_path):
    _, first, second = halves(tmp_path, drive(scan_delay=STEP // 2))
    status, figures, _ = run(capsys, "map", first, second, "-o", tmp_path / "map")
    assert status == 0
    assert figures["merged"]["scans"] == 2 * (2 * HALF - 2)
    assert figures["dropped"] == {"scan: after the odometry": 4}  # two lasers, two ends


def test_a_map_is_gone_on_from(capsys, tmp_path):
    """With the paper's rule the map holds all there is; layers of localization included."""
    whole, first, _ = halves(tmp_path, drive())
    rule = "--update-rule", "paper"
    run(capsys, "map", whole, "-o", tmp_path / "at_once", *rule)
    run(capsys, "map", first, "-o", tmp_path / "first_map", *rule)
    second_drive = [("/tf_static", START, tf_message(*MOUNTS))]
    second_drive += [event for event in drive() if event[1] >= START + HALF * STEP]
    later = write_bag(tmp_path / "later", second_drive)
    initial = "--initial-map", tmp_path / "first_map"
    status, figures, error = run(capsys, "map", later, "-o", tmp_path / "both", *initial, *rule)
    assert (status, figures["merged"]["scans"], error) == (0, 100, "")
    assert_gone_on_from(tmp_path / "both", tmp_path / "at_once")
    params = tmp_path / "params.yaml"
    mapping = f"mapping: {{map_directory: {tmp_path}, initial_map: first_map}}"
    params.write_text(f"/**: {{ros__parameters: {{{mapping}}}}}\n")
    run(capsys, "map", later, "-o", tmp_path / "by_file", "--params", params, *rule)
    assert_gone_on_from(tmp_path / "by_file", tmp_path / "at_once")


def test_convert_keeps_the_layers(capsys, tmp_path):
    bag = write_bag(tmp_path / "bag", drive(steps=10))
    run(capsys, "map", bag, "-o", tmp_path / "map")
    assert run(capsys, "convert", tmp_path / "map", "-o", tmp_path / "anew")[0] == 0
    assert_same_map(tmp_path / "anew", tmp_path / "map")


def test_a_map_without_layers_stays_without(capsys, tmp_path):
    bag = write_bag(tmp_path / "bag", drive())
    map_directory.save(tmp_path / "old", HeightMap.from_metres(np.full((16, 16), 0.25)))
    status, figures, error = run(
        capsys, "map", bag, "-o", tmp_path / "new", "--initial-map", tmp_path / "old"
    )
    sentence = "the loaded map has no localization layers: it gets none"
    assert (status, figures["warnings"]) == (0, [sentence])
    assert sentence in error
    assert not (tmp_path / "new" / LAYERS).exists()
    height_map = map_directory.load(tmp_path / "new").height_map
    iy, ix = height_map.geometry.cell_at((0.3, 0.3))  # behind the view of both lasers
    assert height_map.height[iy, ix] == 25


@pytest.mark.parametrize(
    ("resolution", "frame", "complaint"),
    [
        (0.25, "map", "resolution is 0.25 m, the grid's 0.125 m"),
        (0.125, "site", "frame_id is 'site', not 'map'"),
    ],
)
def test_a_map_of_other_cells_or_of_another_frame_is_refused(
    capsys, tmp_path, resolution, frame, complaint
):
    bag = write_bag(tmp_path / "bag", drive(steps=4))
    height_map = HeightMap.from_metres([[0.0, 0.5]], resolution=resolution)
    map_directory.save(tmp_path / "old", height_map, frame_id=frame)
    status, _, error = run(
        capsys, "map", bag, "-o", tmp_path / "new", "--initial-map", tmp_path / "old"
    )
    assert (status, error) == (2, f"heightmap25d: {tmp_path / 'old'}: {complaint}\n")
    assert not (tmp_path / "new").exists()


def test_bags_with_poses_in_two_frames_are_refused(capsys, tmp_path):
    one = write_bag(tmp_path / "one", drive(steps=4))
    other = write_bag(tmp_path / "other", drive(steps=4, frame="world"))
    status, _, error = run(capsys, "map", one, other, "-o", tmp_path / "map")
    expected = f"{other}: its poses are in 'world', those of the bag before it in 'odom'"
    assert (status, error) == (2, f"heightmap25d: {expected}\n")


def test_a_bag_of_which_nothing_is_mapped_is_named(capsys, tmp_path):
    good = write_bag(tmp_path / "good", drive(steps=4))
    silent = [event for event in drive(steps=4) if event[0] != "/odom"]
    poses = [
        event for event in drive(steps=80) if event[0] == "/odom" and event[1] > START + 70 * STEP
    ]
    bad = write_bag(tmp_path / "bad", silent + poses)
    status, _, error = run(capsys, "map", good, bad, "-o", tmp_path / "map")
    assert (status, error.count("\n")) == (2, 1)
    assert error.startswith(f"heightmap25d: {bad}: ")
    assert "scan: before the odometry (8)" in error
    assert not (tmp_path / "map").exists()


def test_a_drive_may_begin_where_the_one_before_began(capsys, tmp_path):
    """The robot was carried back to the origin; its poses are known, so that this is no jump."""
    bag = write_bag(tmp_path / "bag", drive())
    run(capsys, "map", bag, "-o", tmp_path / "once")
    status, figures, error = run(capsys, "map", bag, bag, "-o", tmp_path / "twice")
    assert (status, error, figures["dropped"]) == (0, "", {})
    assert figures["merged"]["scans"] == 400
    once, twice = (map_directory.load(tmp_path / name).height_map for name in ("once", "twice"))
    np.testing.assert_array_equal(once.height[once.known], twice.height[once.known])


def test_a_stretch_of_a_bag_as_replay_plays_it(capsys, tmp_path):
    """Seconds from the first message on; static transforms hold all the same."""
    bag = write_bag(tmp_path / "bag", drive())
    first, stop = START + 25 * STEP, START + 75 * STEP
    events = [e for e in drive() if first <= e[1] < stop or e[0] == "/tf_static"]
    part = write_bag(tmp_path / "part", events)
    run(capsys, "map", part, "-o", tmp_path / "expected")
    status, figures, _ = run(
        capsys, "map", bag, "-o", tmp_path / "map", "--start", 0.5, "--duration", 1.0
    )
    assert (status, figures["merged"]["scans"]) == (0, 100)
    assert_same_map(tmp_path / "map", tmp_path / "expected")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("bag", "--start", 3), "--start 3: "),
        (("bag", "bag", "--start", 1), "--start and --duration are for a single bag"),
        (("bag", "bag", "--duration", 1), "--start and --duration are for a single bag"),
        (("bag", "--initial-map", "bag"), "is a bag, not a map directory"),
        (("bag", "--initial-map", "nowhere"), "nowhere: does not exist"),
    ],
)
def test_what_cannot_be_mapped_is_one_line(capsys, tmp_path, monkeypatch, arguments, complaint):
    monkeypatch.chdir(tmp_path)
    write_bag(tmp_path / "bag", drive(steps=4))
    status, _, error = run(capsys, "map", *arguments, "-o", "map")
    assert (status, error.count("\n")) == (2, 1)
    assert complaint in error
    assert not (tmp_path / "map").exists()


@pytest.mark.parametrize("number", ["-1", "nan", "inf", "soon"])
def test_times_are_numbers_from_0_on(capsys, tmp_path, number):
    with pytest.raises(SystemExit) as end:
        cli.main(["map", "bag", "-o", "map", f"--start={number}"])
    assert end.value.code == 2
    assert "--start" in capsys.readouterr().err.splitlines()[-1]


def test_a_file_that_names_the_default_topic_names_it(capsys, tmp_path):
    bag = write_bag(tmp_path / "bag", drive())
    params = tmp_path / "params.yaml"
    for values, scans in (("{scan_topics: [scan]}", 100), ("{wait_limit: 1.0}", 200)):
        params.write_text(f"/**: {{ros__parameters: {{intake: {values}}}}}\n")
        status, figures, _ = run(capsys, "map", bag, "-o", tmp_path / "map", "--params", params)
        assert (status, figures["merged"]["scans"]) == (0, scans)
    topic = "--scan-topic", "/scan_down"  # an option outdoes a file
    params.write_text("/**: {ros__parameters: {intake: {scan_topics: [scan]}}}\n")
    _, figures, _ = run(capsys, "map", bag, "-o", tmp_path / "map", "--params", params, *topic)
    _, expected, _ = run(capsys, "map", bag, "-o", tmp_path / "down", *topic)
    assert figures["sha256"] == expected["sha256"]


def test_localize_says_what_was_wrong_with_a_drive(capsys, tmp_path):
    bag = write_bag(tmp_path / "bag", drive(sway=0.0))
    _, mapped, _ = run(capsys, "map", bag, "-o", tmp_path / "map")
    status, figures, error = run(
        capsys, "localize", bag, "--map", tmp_path / "map", "-o", tmp_path / "out"
    )
    assert (status, figures["warnings"]) == (0, mapped["warnings"])
    assert "the odometry is flat: z, roll and pitch were exactly 0" in error
    assert figures["damaged"] == figures["other_types"] == {}
