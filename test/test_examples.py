# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Each script of examples/, as a newcomer runs it, from a directory of its own."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from math import pi
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from repository import BAGS, ROOT

from heightmap25d_ros.io import map_directory
from heightmap25d_ros.io.trajectory import read_tum

EXAMPLES = ROOT / "examples"
CENTIMETRE = 0.0101
MOST_LINES = 30
"""Of code, without header and blank lines."""


def run(name: str, directory: Path, *arguments: str) -> str:
    """What an example prints; it writes into out/examples of the directory by default."""
    done = subprocess.run(
        [sys.executable, EXAMPLES / f"{name}.py", *arguments],
        cwd=directory, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def height_at(directory: Path, x: float, y: float) -> float:
    """Height [m] of a map directory at a place; NaN where it is unknown."""
    height_map = map_directory.load(directory).height_map
    cell = tuple(height_map.geometry.cell_at((x, y)))
    return height_map.height[cell] / 100 if height_map.known[cell] else np.nan


def test_numpy_scans_to_map(tmp_path: Path) -> None:
    printed = run("numpy_scans_to_map", tmp_path, "elsewhere")
    assert [path.name for path in tmp_path.iterdir()] == ["elsewhere"]
    made = tmp_path / "elsewhere" / "step"
    for x, z in ((1.5, 0.0), (3.9, 0.0), (4.1, 0.30), (4.4, 0.30)):
        assert height_at(made, x, 0.0) == pytest.approx(z, abs=CENTIMETRE)
    assert "x = 4.3 m: 30 cm" in printed
    known = map_directory.load(made).height_map.known
    assert 500 < known.sum() < 0.9 * known.size


@pytest.mark.slow
def test_bag_to_path(tmp_path: Path) -> None:
    printed = run("bag_to_path", tmp_path)
    path = np.loadtxt(tmp_path / "out" / "examples" / "path.txt")
    np.testing.assert_allclose(path[0, :2], (24.0, 0.0), atol=1e-3)
    np.testing.assert_allclose(path[-1, [0, 1]], (4.0, 0.0), atol=1e-3)
    assert np.abs(path[-1, 5]) == pytest.approx(pi, abs=1e-3)
    assert path[-1, 2] - path[0, 2] == pytest.approx(1.5, abs=0.05)  # from the yard to the landing
    assert 20.0 <= float(printed.split(" m long")[0]) < 22.0
    # The pallet of the yard, -1.36 m.
    assert height_at(tmp_path / "out" / "examples" / "ramp", 21.5, -2.0) == pytest.approx(
        -1.36, abs=CENTIMETRE
    )


@pytest.mark.slow
def test_map_to_numpy(tmp_path: Path) -> None:
    run("map_to_numpy", tmp_path)
    with np.load(tmp_path / "out" / "examples" / "ramp.npz") as arrays:
        metres, x, y = arrays["metres"], arrays["x"], arrays["y"]
    with np.load(BAGS / "ramp" / "truth" / "surface.npz") as truth:
        seen, corner = truth["seen"], truth["origin"]
    columns, rows = (
        np.floor((c - o) / 0.125).astype(int) for c, o in zip((x, y), corner, strict=True)
    )
    inside = (rows >= 0) & (rows < seen.shape[0]) & (columns >= 0) & (columns < seen.shape[1])
    error = metres[inside] - seen[rows[inside], columns[inside]]
    assert np.isfinite(error).sum() > 8000
    assert np.nanmedian(np.abs(error)) < 0.01


@pytest.mark.slow
def test_localize_bag(tmp_path: Path) -> None:
    printed = run("localize_bag", tmp_path)
    errors = {name: float(off) for name, off in re.findall(r"(\S+): off by (\S+) m", printed)}
    assert errors["/odom"] > 0.2
    assert errors["localized"] < 0.05
    trajectory = read_tum(tmp_path / "out" / "examples" / "room.tum")
    assert np.ptp(trajectory[:, 0]) == pytest.approx(33.8, abs=0.1)  # the bag's duration
    np.testing.assert_allclose(trajectory[0, 1:4], 0.0, atol=0.02)


@pytest.mark.slow
def test_picture(tmp_path: Path) -> None:
    run("picture", tmp_path)
    for name in ("heights", "obstacles", "blocks"):
        with Image.open(tmp_path / "out" / "examples" / f"{name}.png") as picture:
            assert min(picture.size) > 300
            assert len(picture.convert("RGB").getcolors(1 << 24)) > 10


@pytest.mark.slow
def test_script_of_the_readme(tmp_path: Path) -> None:
    (script,) = re.findall(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(), re.M | re.S)
    (tmp_path / "bags").symlink_to(BAGS)
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    assert re.fullmatch(r"2\d\.\d m long, 1\.5\d m up\n", done.stdout)
    assert height_at(tmp_path / "out" / "ramp", 21.5, -2.0) == pytest.approx(-1.36, abs=CENTIMETRE)


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_example_is_short_and_tested(path: Path) -> None:
    source = path.read_text()
    header = ast.get_docstring(ast.parse(source))
    assert f"Usage: python examples/{path.name} [DIRECTORY]" in header
    code = source.partition('"""\n\n')[2].splitlines()
    assert sum(bool(line.strip()) for line in code) <= MOST_LINES
    assert f"test_{path.stem}" in globals()
