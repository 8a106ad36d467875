# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files of others: YAML that is none or too much, and what is no file."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from properties import draws

from heightmap25d_ros import cli, input_files
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.evaluation.truth import read_truth
from heightmap25d_ros.input_files import read_yaml
from heightmap25d_ros.io import map_directory, trajectory
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.files import read_yaml as read_params

LAUGHS = "\n".join(
    ["a0: &a0 [x, x]", *(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}, *a{i - 1}]" for i in range(1, 40))]
)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (LAUGHS, "more than 40000 values"),
        ("a: &a [*a]", "within what it stands for"),
        ("a: &a {b: [*a]}", "within what it stands for"),
        ("[" * 100_000, "nested more than 20 deep"),
        ("{a: " * 100_000, "nested more than 20 deep"),
        ("- " * 100_000, "nested more than 20 deep"),
        ("\n".join(" " * i + "a:" for i in range(100)), "nested more than 20 deep"),
        ("[" + "1," * 100_000 + "]", "more than 40000 values"),
        ("a: 1\na: 2", "a is there twice"),
        ("? [1]\n: 2", "a key is not a word"),
        ("a: " + "1:" * 100_000 + "1", "without quotes"),
        ("a: " + "7" * 5000, "without quotes"),
        ("a: !!int '" + "1:" * 5000 + "1'", "without quotes"),
        ("a: 2020-99-99", "month"),
        ("a: !!python/object/apply:os.system [ls]", "could not determine a constructor"),
        ("a: \0", "control characters"),
        ("a: [", "expected"),
        ("#" * (1 << 21), "more than 1 MiB"),
    ],
)
def test_yaml_that_is_refused_in_one_line_and_at_once(
    tmp_path: Path, text: str, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=reason) as refusal:
        read_yaml(path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert "\n" not in str(refusal.value)
    assert cli.main(["map", "nowhere", "-o", "out", "--params", str(path)]) == 2
    assert cli.main(["convert", "nowhere", "--params", str(path)]) == 2


def test_a_param_file_with_an_absurd_number(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    for name, number in (
        ("grid: {resolution", "1" + "0" * 390), ("short_term: {maps", "-" + "9" * 390),
        ("grid: {resolution", "1.0e+999"), ("grid: {resolution", ".nan"),
        ("sensor: {body_box", f"[{'9' * 390}]"),
    ):  # fmt: skip
        path.write_text(f"/**: {{ros__parameters: {{{name}: {number}}}}}}}")
        with pytest.raises(InputError, match="parameter ") as refusal:
            read_params(path, "mapping")
        assert len(str(refusal.value)) < 500


def test_aliases_and_long_texts_are_read(tmp_path: Path) -> None:
    path = tmp_path / "some.yaml"
    content = [1.5, None, {"deep": [True, "x" * 10_000]}]
    path.write_text(yaml.safe_dump({"one": content, "other": content, "date": "2020-01-01"}))
    assert "&id" in path.read_text()
    assert read_yaml(path) == {"one": content, "other": content, "date": "2020-01-01"}


values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63) | st.text(max_size=20)
    | st.floats(allow_nan=False),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=30,
)  # fmt: skip


@draws(100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(values)
def test_sound_yaml_is_what_the_safe_loader_reads(tmp_path: Path, value: object) -> None:
    path = tmp_path / "some.yaml"
    text = yaml.safe_dump(value, allow_unicode=True)
    path.write_text(text)
    # Not the value: PyYAML writes some line separators so that they are read as spaces.
    assert read_yaml(path) == yaml.safe_load(text)


@draws(300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(alphabet="a1:-[]{}&*!?|>'\"#, \n\t.", max_size=40))
def test_any_text_is_read_or_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "some.yaml"
    path.write_text(text)
    with suppress(InputError):
        read_yaml(path)


def test_the_largest_yaml_takes_less_than_its_millions_would(tmp_path: Path) -> None:
    """The limits bound the time: against the same machine reading a small part of them."""
    small, large = tmp_path / "small.yaml", tmp_path / "large.yaml"
    small.write_text("[" + "1," * 4_000 + "]")
    large.write_text("[" + "1," * 400_000 + "]")

    def seconds(path: Path) -> float:
        began = time.perf_counter()
        with suppress(InputError):
            read_yaml(path)
        return time.perf_counter() - began

    assert min(seconds(large) for _ in range(3)) < 20 * min(seconds(small) for _ in range(3))


def test_a_fifo_or_a_device_is_no_file(tmp_path: Path) -> None:
    """Reading would never end, or never begin."""
    maps = tmp_path / "map"
    maps.mkdir()
    for name in ("height_grid.npz", "params.yaml", "bag.mcap", "bag.db3", "bag.bag"):
        os.mkfifo(maps / name)
    (tmp_path / "zeros").symlink_to("/dev/zero")
    for read in (
        lambda: read_yaml(maps / "params.yaml"),
        lambda: read_yaml(tmp_path / "zeros"),
        lambda: map_directory.load(maps),
        lambda: trajectory.read_tum(tmp_path / "zeros"),
        lambda: read_truth(maps / "height_grid.npz"),
        lambda: Bag(maps / "bag.mcap"),
        lambda: Bag(maps / "bag.db3"),
        lambda: Bag(maps / "bag.bag"),
    ):
        with pytest.raises(InputError, match="neither a file nor a directory"):
            read()
    assert cli.main(["info", str(maps / "bag.mcap")]) == 2
    assert cli.main(["plan", str(maps), "--start", "0,0", "--goal", "1,1", "-o", "out"]) == 2


def test_what_is_not_there_is_left_to_who_opens_it(tmp_path: Path) -> None:
    input_files.require_file(tmp_path / "nothing")
    input_files.require_file(tmp_path)
    with pytest.raises(InputError, match="No such file"):
        read_yaml(tmp_path / "nothing")
    with pytest.raises(InputError, match="directory"):
        read_yaml(tmp_path)
