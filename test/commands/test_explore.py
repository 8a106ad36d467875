# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d explore``, for a few simulated seconds."""

import json

import pytest

from heightmap25d_ros.cli import main
from heightmap25d_ros.io import map_directory, trajectory


def explore(capsys, *arguments):
    status = main(["explore", *map(str, arguments), "--json"])
    shown = capsys.readouterr()
    return status, json.loads(shown.out) if shown.out else shown.err


@pytest.mark.slow
def test_the_same_seed_is_the_same_run(tmp_path, capsys):
    given = "room", "--seed", 3, "--time-limit", 12
    status, found = explore(capsys, *given, "-o", tmp_path / "a")
    again, same = explore(capsys, *given, "-o", tmp_path / "b", "--no-animation")
    assert status == again == 3  # it has not come to its end
    assert (found["end"], found["reason"]) == ("LIMIT", "the limit of 12 s is reached")
    assert found["sha256"] == same["sha256"]
    assert found["distance_m"] == same["distance_m"]
    assert found["contacts"] == 0
    assert found["covered_m2"] > 10.0
    pictures = [(tmp_path / "a" / name).exists() for name in ("exploration.png", "exploration.gif")]
    assert all(pictures)
    assert not (tmp_path / "b" / "exploration.gif").exists()
    assert map_directory.load(tmp_path / "a" / "map").height_map.known.sum() > 1000
    assert len(trajectory.read_tum(tmp_path / "a" / "map" / "trajectory.tum")) > 500


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("nowhere",), "world 'nowhere' is not one of"),
        (("room", "--boundary", "0,0,1,1"), "boundary: 2 corners are no polygon"),
        (("room", "--min-gain", "-1"), "exploration.min_gain: -1 is not within"),
        (("room", "--seed", "-1"), "seed: is not within"),
    ],
)
def test_what_cannot_be_explored_is_told_in_a_line(tmp_path, capsys, arguments, told):
    status, error = explore(capsys, *arguments, "-o", tmp_path)
    assert status == 2
    assert told in error
    assert error.count("\n") == 1
