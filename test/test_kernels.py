# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The cache of kernels, in a small package of the same name."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from repository import ROOT

pytestmark = pytest.mark.slow  # each process compiles anew

NAME = "heightmap25d_ros"
CONSTANTS = "SCALE = {scale}\n"
CALLED = f"""
from {NAME}.kernels import inlined_kernel
from {NAME}.constants import (
    SCALE,
)

@inlined_kernel
def scaled(x):
    return SCALE * x {{offset}}
"""
CALLER = f"""
from {NAME} import called
from {NAME}.called import scaled
from {NAME}.kernels import kernel

@kernel
def twice(x):
    return 2 * scaled(x)
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    folder = tmp_path / NAME
    folder.mkdir()
    (folder / "__init__.py").touch()
    shutil.copy(ROOT / NAME / "kernels.py", folder)
    (folder / "constants.py").write_text(CONSTANTS.format(scale=3))
    (folder / "called.py").write_text(CALLED.format(offset=""))
    (folder / "caller.py").write_text(CALLER)
    return folder


def twice_of_5(package: Path, **environment: str) -> tuple[int, int]:
    """What another process gets, and how many kernels it had to compile."""
    script = f"from {NAME}.caller import twice\nprint(twice(5), len(twice.stats.cache_misses))"
    done = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"PYTHONPATH": str(package.parent)} | environment,
        cwd=package.parent, check=True, capture_output=True, text=True,
    )  # fmt: skip
    result, compiled = map(int, done.stdout.split())
    return result, compiled


def test_edit_of_what_a_kernel_calls_takes_effect(package: Path) -> None:
    assert twice_of_5(package) == (30, 1)
    assert twice_of_5(package) == (30, 0)
    (package / "called.py").write_text(CALLED.format(offset="+ 1"))
    assert twice_of_5(package) == (32, 1)


def test_edit_of_a_constant_two_modules_away_takes_effect(package: Path) -> None:
    assert twice_of_5(package) == (30, 1)
    (package / "constants.py").write_text(CONSTANTS.format(scale=4))
    assert twice_of_5(package) == (40, 1)


def test_edit_of_the_names_of_the_package_compiles_nothing(package: Path) -> None:
    assert twice_of_5(package) == (30, 1)
    (package / "__init__.py").write_text(f"from {NAME}.constants import SCALE\n")
    assert twice_of_5(package) == (30, 0)


def test_cache_goes_where_numba_is_told(package: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    assert twice_of_5(package, NUMBA_CACHE_DIR=str(cache)) == (30, 1)
    assert list(cache.rglob("*.nbi"))
    assert not list(package.rglob("*.nbi"))
    assert twice_of_5(package, NUMBA_CACHE_DIR=str(cache)) == (30, 0)


def test_works_where_nothing_can_be_written(package: Path, tmp_path: Path) -> None:
    in_the_way = tmp_path / "file"
    in_the_way.touch()
    (package / "__pycache__").touch()  # a file: no directory can be made, whoever runs the test
    for _ in range(2):
        nowhere = {"HOME": str(in_the_way), "XDG_CACHE_HOME": str(in_the_way)}
        assert twice_of_5(package, PYTHONDONTWRITEBYTECODE="1", **nowhere) == (30, 1)
