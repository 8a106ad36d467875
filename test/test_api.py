# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `import heightmap25d_ros as hm` offers: its names, what importing them costs, misuse."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from repository import ROOT

import heightmap25d_ros as hm

SOURCE = ROOT / "heightmap25d_ros" / "__init__.py"
HEAVY = ("numba", "matplotlib", "scipy", "numpy", "rosbags", "yaml", "tqdm")
FLAT = hm.HeightMap.from_metres(np.zeros((32, 64)))
SCAN = hm.Scan(angle_min=0.0, angle_increment=0.01, ranges=[2.0, 2.0])


def for_type_checkers() -> dict[str, tuple[str, str]]:
    """Module and name there of each name that is imported for type checkers only."""
    (block,) = (
        node
        for node in ast.parse(SOURCE.read_text()).body
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    )
    return {
        alias.asname or alias.name: (str(node.module), alias.name)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def loaded_by(statement: str) -> set[str]:
    """The heavy packages, and the modules of this one, that a statement loads."""
    script = f"{statement}\nimport sys\nprint(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], check=True, capture_output=True, text=True
    )
    own = "heightmap25d_ros."
    return {m for m in done.stdout.split() if m in HEAVY or m.startswith(own)}


def test_names_are_the_same_for_type_checkers() -> None:
    assert sorted(for_type_checkers()) == sorted(hm.__all__)


@pytest.mark.parametrize("name", hm.__all__)
def test_name_is_what_type_checkers_see(name: str) -> None:
    module, there = for_type_checkers()[name]
    found = import_module(module)
    expected = (
        getattr(found, there) if hasattr(found, there) else import_module(f"{module}.{there}")
    )
    assert getattr(hm, name) is expected
    assert getattr(hm, name).__doc__


def test_names_are_listed_and_others_are_refused() -> None:
    assert set(hm.__all__) <= set(dir(hm))
    assert len(hm.__all__) == len(set(hm.__all__))
    with pytest.raises(AttributeError, match="'heightmap25d_ros' has no attribute 'Heightgrid'"):
        _ = hm.Heightgrid


def test_import_loads_nothing() -> None:
    assert loaded_by("import heightmap25d_ros") == set()


def test_names_load_what_they_need_only() -> None:
    assert "numba" not in loaded_by("from heightmap25d_ros import Bag, HeightMap, Params, Scan")
    everything_but_pictures = set(hm.__all__) - {"map_figures"}
    names = ", ".join(sorted(everything_but_pictures))
    assert "matplotlib" not in loaded_by(f"from heightmap25d_ros import {names}")


@pytest.mark.parametrize("chosen", [None, "3"])
def test_blas_has_one_thread_unless_another_number_is_chosen(chosen: str | None) -> None:
    """With several, one bag would become another map on each number of cores."""
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    if chosen is not None:
        environment["OPENBLAS_NUM_THREADS"] = chosen
    code = "import heightmap25d_ros, os; print(os.environ['OPENBLAS_NUM_THREADS'])"
    command = [sys.executable, "-c", code]
    told = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert told.stdout.strip() == (chosen or "1")


@pytest.mark.parametrize(
    "room",
    [
        "grid", "mapping", "terrain", "planning", "localization", "io", "viz", "evaluation",
        "params", "pipelines",
    ],
)  # fmt: skip
def test_docstring_of_a_room_lists_its_modules(room: str) -> None:
    folder = SOURCE.parent / room
    docstring = ast.get_docstring(ast.parse((folder / "__init__.py").read_text()))
    modules = {path.stem for path in folder.glob("*.py") if not path.stem.startswith("_")}
    assert modules <= set(re.findall(r"`(\w+)`", docstring))


def test_defaults_are_those_of_the_parameters() -> None:
    params = hm.Params()
    grid = hm.HeightGrid()
    assert grid.geometry == hm.HeightGrid(params.grid).geometry
    assert hm.Mapper(grid).params == params.mapper
    assert grid.read().probability_threshold == params.mapper.probability_threshold
    assert FLAT.probability_threshold == params.mapper.probability_threshold
    one, other = (
        hm.to_obstacle_map(FLAT, *settings) for settings in ((), (params.traversability,))
    )
    np.testing.assert_array_equal(one.cost, other.cost)


def test_scan_merges_as_its_beams_do() -> None:
    T_base_laser = hm.se3.from_xyz_rpy([0.0, 0.0, 0.4, 0.0, 0.2, 0.0])
    poses = hm.se3.from_xyz_rpy([[0.0, 0.0, 0.0, 0.0, 0.0, yaw] for yaw in (0.0, 0.1)])
    by_scan, by_beams = hm.Mapper(hm.HeightGrid()), hm.Mapper(hm.HeightGrid())
    assert by_scan.add_scan(SCAN, poses, T_base_laser).hits == 2
    beams = hm.beams(SCAN, poses, [T_base_laser], lone_return=hm.Params().mapper.lone_return)
    by_beams.integrate(beams)
    one, other = by_scan.grid.read(), by_beams.grid.read()
    assert one.geometry == other.geometry
    np.testing.assert_array_equal(one.height, other.height)
    np.testing.assert_array_equal(one.probability, other.probability)


def test_map_of_an_array_is_what_the_array_says() -> None:
    metres = [[0.1, np.nan, -2.005], [0.0, 0.004, 3.0]]
    height_map = hm.HeightMap.from_metres(metres, resolution=0.5, origin=(1.0, -1.0))
    assert height_map.height.tolist() == [[10, 0, -200], [0, 0, 300]]
    assert height_map.known.tolist() == [[True, False, True], [True, True, True]]
    assert height_map.geometry.cell_center((1, 2)).tolist() == [2.25, -0.25]


def test_places_may_be_sequences() -> None:
    planner = hm.Planner.from_height_map(FLAT)
    plan = planner.plan((1.0, 2.0), np.array([7.0, 2.0, 1.0]))
    same = planner.plan(hm.Pose2D(1.0, 2.0), hm.Pose2D(7.0, 2.0, 1.0))
    np.testing.assert_array_equal(plan.poses, same.poses)
    np.testing.assert_allclose(plan.poses[-1, :2, 3], (7.0, 2.0), atol=1e-9)


@pytest.mark.parametrize(
    ("misuse", "complaint"),
    [
        (lambda: hm.HeightMap.from_metres([0.0, 1.0]), r"metres: shape \(2,\)"),
        (lambda: hm.HeightMap.from_metres([[400.0]]), r"metres: a height is beyond \+-327 m"),
        (lambda: hm.HeightMap.from_metres([[0.0]], resolution=0.0), "resolution: 0 m"),
        (lambda: hm.HeightMap.from_metres([[0.0]], origin=(0.0, np.nan)), "origin: "),
        (
            lambda: hm.HeightMap(
                geometry=FLAT.geometry, height=FLAT.height[1:], probability=FLAT.probability
            ),
            r"height: shape \(31, 64\), the geometry's is \(32, 64\)",
        ),
        (lambda: hm.Scan(angle_min=0, angle_increment=1, ranges=[[1]]), r"ranges: shape \(1, 1\)"),
        (lambda: hm.beams(SCAN, np.eye(3), np.eye(4)), r"T_map_base: shape \(3, 3\)"),
        (lambda: hm.beams(SCAN, np.eye(4), [np.eye(4)] * 3), r"T_base_sensor: shape \(3, 4, 4\)"),
        (lambda: hm.Planner.from_height_map(FLAT).plan((1.0,), (2.0, 2.0)), "start: "),
        (lambda: hm.Planner.from_height_map(FLAT).plan((1.0, 1.0), (np.inf, 2.0)), "goal: "),
        (lambda: hm.Localizer().begin_at([0.0, 0.0, 0.0]), "xyz_yaw: "),
    ],
)  # fmt: skip
def test_misuse_is_refused_by_the_name_of_the_argument(misuse, complaint) -> None:
    with pytest.raises(ValueError, match=complaint):
        misuse()


def test_beams_that_do_not_go_together_are_refused() -> None:
    beams = hm.beams(SCAN, np.eye(4), np.eye(4))
    short = type(beams)(
        origins=beams.origins, ends=beams.ends, is_hit=beams.is_hit[1:], is_lone=beams.is_lone
    )
    with pytest.raises(ValueError, match=r"beams: origins and ends need shape \(N, 3\)"):
        hm.Mapper(hm.HeightGrid()).integrate(short)


def test_bad_input_from_outside_is_one_exception(tmp_path: Path) -> None:
    for read in (hm.Bag, hm.load_map, hm.map_bag):
        with pytest.raises(hm.InputError, match="nowhere"):
            read(tmp_path / "nowhere")
