# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""heightmap25d view: what the recordings hold that it writes for the viewer."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest
from repository import BAGS

from heightmap25d_ros import cli

RAMP = BAGS / "ramp"

needs_rerun = pytest.mark.skipif(
    importlib.util.find_spec("rerun") is None,
    reason="rerun is missing: pip install -r requirements/view.txt",
)


def printed(recording: Path) -> str:
    """What rerun itself reads of a recording."""
    return subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "print", recording],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip


def test_without_rerun_it_says_how_to_get_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.delitem(sys.modules, "heightmap25d_ros.scene_3d", raising=False)
    assert cli.main(["view", str(RAMP)]) == 2
    said = capsys.readouterr().err
    assert said == "heightmap25d: view needs rerun: pip install -r requirements/view.txt\n"


@needs_rerun
def test_bag_becomes_a_recording_along_its_time(tmp_path, capsys):
    recording = tmp_path / "ramp.rrd"
    assert cli.main(["view", str(RAMP), "--save", str(recording)]) == 0
    assert str(recording) in capsys.readouterr().out
    text = printed(recording)
    for name in ("/map/blocks", "/map/obstacles", "/map/frontier", "/trajectory", "/robot"):
        assert name in text
    # A map every two seconds, and one at the end.
    maps = re.findall(r"with (\d+) rows .* - /map/blocks", text)
    assert sum(map(int, maps)) == 15


@needs_rerun
def test_map_becomes_a_recording_without_time(tmp_path, capsys):
    recording = tmp_path / "map.rrd"
    assert cli.main(["map", str(RAMP), "-o", str(tmp_path / "map")]) == 0
    assert cli.main(["view", str(tmp_path / "map"), "--save", str(recording)]) == 0
    text = printed(recording)
    for name in ("/map/blocks", "/map/obstacles", "/map/frontier", "/trajectory"):
        assert name in text
    assert "/robot" not in text


@needs_rerun
@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["nowhere"], "nowhere"),
        ([str(RAMP), "--save", "no/such/directory/ramp.rrd"], "no/such/directory"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(arguments, complaint, capsys):
    assert cli.main(["view", *arguments]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert complaint in said
