# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map of level lasers alone: what stands is occupied, and nothing is free."""

import json

import numpy as np
import pytest
from analytic_worlds import World, box, plane, scan_ranges

from heightmap25d_ros import cli, se3
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.io.decode import Scan
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import ENOUGH_LEVEL_SCANS, Mapping
from heightmap25d_ros.pipelines.scan_queue import Reading

ROOM = World([
    plane(), box((-4, 4), (3, 3.2), 1.0), box((-4, 4), (-3.2, -3), 1.0),
    box((4, 4.2), (-3, 3), 1.0), box((-4.2, -4), (-3, 3), 1.0), box((1, 1.5), (1, 2), 0.8),
])  # fmt: skip
ANGLES = np.linspace(-np.pi, np.pi, 721)
LEVEL, DOWN = ([0.0, 0.0, 0.4, 0.0, pitch, 0.0] for pitch in (0.0, 0.5))
PARAMS = with_values(Params(), {"intake.scan_topics": ["scan"], "mapping.start_radius": 0.5})


def readings(mount, count):
    for number in range(count):
        T = se3.from_xyz_rpy([0.02 * number - 1.0, 0.0, 0.0, 0.0, 0.0, 0.01 * number])
        T_base_sensor = se3.from_xyz_rpy(mount)
        ranges = scan_ranges(ROOM, (T @ T_base_sensor)[None], ANGLES)
        scan = Scan(
            stamp_ns=number * 10**7, frame_id="laser", angle_min=float(ANGLES[0]),
            angle_increment=float(ANGLES[1] - ANGLES[0]), time_increment=0.0, range_min=0.05,
            range_max=30.0, ranges=ranges.astype(np.float32),
        )  # fmt: skip
        yield Reading(
            topic="scan", scan=scan, T_map_base=T[None], T_base_sensor=T_base_sensor[None]
        )


def mapped(*drives):
    mapping = Mapping(PARAMS)
    for mount, count in drives:
        for reading in readings(mount, count):
            mapping.merge(reading)
    return mapping


def at(maps, x, y):
    height_map, obstacles = maps
    return int(obstacles.occupancy[tuple(height_map.geometry.cell_at((x, y)))])


def test_walls_are_occupied_and_ground_is_unknown():
    mapping = mapped((LEVEL, ENOUGH_LEVEL_SCANS))
    maps = mapping.maps()
    assert maps[0].is_level
    assert set(np.unique(maps[1].occupancy)) == {-1, 100}
    assert at(maps, 0.0, 3.05) == 100
    assert at(maps, 1.05, 1.5) == 100
    assert at(maps, 0.5, 0.0) == at(maps, -1.0, 0.0) == -1  # also where the map began
    assert any("level" in notice for notice in mapping.dropped.notices)
    np.testing.assert_array_equal(mapping.obstacles(mapping.area()).occupancy, maps[1].occupancy)


def test_the_first_ground_makes_it_a_map_to_plan_on():
    maps = mapped((LEVEL, ENOUGH_LEVEL_SCANS), (DOWN, 1)).maps()
    assert not maps[0].is_level
    assert at(maps, -1.0, 0.0) == 0


def test_few_scans_tell_nothing():
    assert not mapped((LEVEL, ENOUGH_LEVEL_SCANS - 1)).is_level


def test_the_map_directory_keeps_it_and_is_not_planned_on(tmp_path, capsys):
    height_map, obstacles = mapped((LEVEL, ENOUGH_LEVEL_SCANS)).maps()
    map_directory.save(tmp_path / "map", height_map, obstacles)
    again = map_directory.load(tmp_path / "map").height_map
    assert again.is_level
    known = Mapping(PARAMS)
    known.load(tmp_path / "map")
    assert known.is_level
    np.testing.assert_array_equal(known.maps()[1].occupancy == 100, again.known)
    assert cli.main(["info", str(tmp_path / "map"), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["ground"] == "unknown: made by level lasers"
    assert figures["occupied_cells"] == figures["known_cells"]
    plan = ["plan", str(tmp_path / "map"), "--start", "0,0", "--goal", "1,0", "-o", str(tmp_path)]
    assert cli.main(plan) == 2
    assert "level lasers" in capsys.readouterr().err


@pytest.mark.parametrize("content", [b"x", np.ones(2, bool)])
def test_a_mark_of_another_kind_is_refused(tmp_path, content):
    height_map, _ = mapped((LEVEL, ENOUGH_LEVEL_SCANS)).maps()
    map_directory.save(tmp_path / "map", height_map)
    path = tmp_path / "map" / map_directory.HEIGHT_GRID
    with np.load(path) as archive:
        fields = dict(archive)
    np.savez_compressed(path, **fields | {"level_lasers": content})
    assert cli.main(["info", str(tmp_path / "map")]) == 2
