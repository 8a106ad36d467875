# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's figures: what docs/paper.md tells is what its commands give."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from repository import ROOT

LARGEST_PICTURE = 400_000  # bytes

needs_octomap = pytest.mark.skipif(
    importlib.util.find_spec("pyoctomap") is None,
    reason="pyoctomap is missing: pip install -r requirements/bench.txt",
)


def paper_figures(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, ROOT / "studies" / "paper_figures.py", *map(str, arguments)],
        env={**os.environ, **environment}, capture_output=True, text=True, check=False,
    )  # fmt: skip


def figures(name: str, directory: Path) -> dict[str, Any]:
    done = paper_figures(name, directory)
    assert done.returncode == 0, done.stderr
    for picture in directory.iterdir():
        assert picture.stat().st_size < LARGEST_PICTURE
        with Image.open(picture) as opened:
            assert min(opened.size) > 250
    return json.loads(done.stdout)


@pytest.mark.slow
@needs_octomap
def test_figure_1_an_obstacle_that_the_evidence_grid_hides(tmp_path: Path) -> None:
    given = figures("fig1", tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"paper_fig1.png"}
    # From 0.03 m to 0.18 m: the cells 0 .. 0.1 and 0.1 .. 0.2, whose centres are 0.1 m apart.
    assert given["3-D step [m]"] == pytest.approx(0.10)
    assert not given["3-D blocked"]
    assert given["2 1/2-D step [m]"] == pytest.approx(0.15)
    assert given["2 1/2-D blocked"]
    # The highest whole centimetre below 1 x 0.125 m, 2 x 0.1 m, 3 x 0.05 m, and the climb itself.
    assert given["highest hidden box [m]"] == pytest.approx(
        {"3-D, 0.125 m": 0.12, "3-D, 0.1 m": 0.19, "3-D, 0.05 m": 0.14, "2½-D": 0.10}
    )
    # 0.15 m stays within two layers of 0.1 m from the lower half of a layer, and only from there.
    assert given["share of ground heights that hide the box"] == pytest.approx(
        {"3-D, 0.125 m": 0.0, "3-D, 0.1 m": 0.5, "3-D, 0.05 m": 0.0, "2½-D": 0.0}
    )


@pytest.mark.slow
@needs_octomap
def test_figure_2_the_ramp(tmp_path: Path) -> None:
    given = figures("fig2", tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {
        "paper_fig2_profile.png",
        *(f"paper_fig2{part}.png" for part in ("b", "c", "d", "d_evidence_grid")),
    }
    assert given["cells"] == [256, 64]
    assert given["numbers in the 2 1/2-D map"] == 32_768
    assert given["numbers in a 3-D grid of 16 layers"] == 262_144

    ramp = given["on the ramp"]
    cells, rows, steps = 96 * 22, 22, 12  # 12 m x 2.75 m, which goes down 12 layers
    assert 0.95 * cells < ramp["cells"] <= cells  # 2064
    # Across a straight step each row has one transition and two rows have two more.
    straight = steps * (rows + 2 * (rows - 1))
    assert 0.8 * straight < ramp["3-D"]["blocked"] < 1.2 * straight  # 701 of 7889, straight: 768
    assert ramp["true"]["blocked"] == ramp["2 1/2-D"]["blocked"] == 0
    assert ramp["2 1/2-D"]["error max [m]"] < 0.03  # 0.014
    assert ramp["3-D"]["error max [m]"] > 0.06  # 0.078: half a layer, and the slope in a cell


@pytest.mark.slow
def test_without_octomap_one_line_says_what_to_install(tmp_path: Path) -> None:
    (tmp_path / "pyoctomap.py").write_text("raise ImportError")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = paper_figures("fig1", tmp_path, PYTHONPATH=path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "paper_figures: pyoctomap is missing: pip install -r requirements/bench.txt\n"
    )


@pytest.mark.slow
def test_another_figure_is_refused() -> None:
    done = paper_figures("fig9")
    assert done.returncode == 2
    assert done.stderr.startswith("usage:")
