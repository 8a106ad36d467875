# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d merge``: what it writes, and what it refuses in one line."""

import json
import re

import numpy as np
import pytest

from heightmap25d_ros import cli
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import map_directory, merge_file


def room(shift=0.0, boxes=True):
    """A room of 7 x 6 m with a wall around it and boxes in it, in a frame that is shifted."""
    metres = np.zeros((48, 56))
    metres[[0, -1]] = metres[:, [0, -1]] = 1.0
    if boxes:
        metres[6:10, 8:20] = metres[30:42, 12:15] = metres[20:26, 38:50] = 0.6
    metres = np.pad(metres, 4, constant_values=np.nan)
    return HeightMap.from_metres(metres, origin=(shift, -3.0))


@pytest.fixture
def maps(tmp_path):
    map_directory.save(tmp_path / "a", room())
    map_directory.save(tmp_path / "b", room(20.0))
    map_directory.save(tmp_path / "bare", room(boxes=False))
    map_directory.save(tmp_path / "flat", HeightMap.from_metres(np.zeros((40, 40))))
    coarse = HeightMap.from_metres(np.zeros((40, 40)), resolution=0.25)
    map_directory.save(tmp_path / "coarse", coarse)
    return tmp_path


def merge(maps, *names, out="out"):
    return cli.main(["merge", *(str(maps / n) for n in names), "-o", str(maps / out), "--json"])


@pytest.mark.slow
def test_two_maps_become_one_that_tells_of_both(maps, capsys):
    assert merge(maps, "a", "b") == 0
    figures = json.loads(capsys.readouterr().out)
    second = figures["merged"][str(maps / "b")]
    assert second["x_m"] == pytest.approx(-20.0, abs=0.05)
    assert second["yaw_rad"] == pytest.approx(0.0, abs=0.01)
    merged = map_directory.load(maps / "out").height_map
    assert merged.metres[12, 14] == pytest.approx(0.6)
    assert (maps / "out" / "overlap.png").stat().st_size > 5_000
    assert cli.main(["info", str(maps / "out"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["merged"] == figures["merged"]
    assert told["poses"] == "known"
    first = {p.name: p.read_bytes() for p in (maps / "out").iterdir()}
    assert merge(maps, "a", "b", out="again") == 0
    assert {p.name: p.read_bytes() for p in (maps / "again").iterdir()} == first


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "fault"),
    [
        (("a", "flat"), "flat: not merged with .*a: no place where they fit"),
        (("bare", "bare"), "bare: not merged with .*: several places where they fit: x"),
        (("a", "coarse"), "coarse: resolution is 0.25 m"),
        (("a",), "a: is a single map"),
    ],
)
def test_what_cannot_be_merged_is_refused_in_one_line(maps, capsys, names, fault):
    assert merge(maps, *names) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert re.search(fault, told)
    assert not (maps / "out").exists()


def test_a_report_of_another_kind_is_refused_by_name(maps, capsys):
    merge_file.write(maps / "a", {"maps": [1], "poses": "known", "differing_cells": 0})
    assert cli.main(["info", str(maps / "a")]) == 2
    assert "maps holds what is no map" in capsys.readouterr().err
