# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The examples in the docstrings run, and give what they say."""

import doctest
import importlib

import pytest
from repository import BAGS, ROOT

PACKAGE = ROOT / "heightmap25d_ros"
MAPS_A_BAG = "heightmap25d_ros.pipelines.from_bag"
MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for path in sorted(PACKAGE.rglob("*.py"))
    if ">>>" in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize(
    "name",
    [pytest.param(m, marks=[pytest.mark.slow] if m == MAPS_A_BAG else []) for m in MODULES],
)
def test_examples_of_a_module(name, tmp_path, monkeypatch):
    (tmp_path / "bags").symlink_to(BAGS)
    monkeypatch.chdir(tmp_path)  # some write files
    result = doctest.testmod(importlib.import_module(name))
    assert result.attempted > 0
    assert result.failed == 0
