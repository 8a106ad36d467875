# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a killed process leaves, and what of it the next one removes."""

from __future__ import annotations

import fcntl
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from heightmap25d_ros import cli
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.io.atomic_directory import adding, replacing
from heightmap25d_ros.viz import plan_figure

KILLED = """
import os, signal, sys
from pathlib import Path
from heightmap25d_ros.io import atomic_directory
with getattr(atomic_directory, sys.argv[1])(Path(sys.argv[2])) as temporary:
    (temporary / "half").write_text("of it")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def killed(writer: str, directory: Path) -> None:
    done = subprocess.run([sys.executable, "-c", KILLED, writer, str(directory)], check=False)
    assert done.returncode == -signal.SIGKILL


def names(directory: Path) -> list[str]:
    return sorted(path.name for path in directory.iterdir())


def test_the_next_save_removes_what_killed_ones_left(tmp_path: Path) -> None:
    for _ in range(3):
        killed("replacing", tmp_path / "room")
    killed("replacing", tmp_path / "room.1")
    others = (".room.12345678.tm", ".roam.12345678.tmp", ".room.1234567.tmp", "room.12345678.tmp")
    for name in others:
        (tmp_path / name).mkdir()
    (tmp_path / ".room.12345678.tmp").write_text("a file")
    assert len(names(tmp_path)) == 7  # one of each name: they remove one another's
    with replacing(tmp_path / "room") as new:
        (new / "whole").write_text("")
    left = set(names(tmp_path)) - {"room", ".room.12345678.tmp", *others}
    assert [name.startswith(".room.1.") for name in left] == [True]
    assert names(tmp_path / "room") == ["whole"]


def test_who_is_still_saving_is_left_alone(tmp_path: Path) -> None:
    with replacing(tmp_path / "room") as first:
        (first / "first").write_text("")
        with replacing(tmp_path / "room") as second:
            (second / "second").write_text("")
        assert (first / "first").exists()
    assert names(tmp_path) == ["room"]
    assert names(tmp_path / "room") == ["first", "second"]


def test_a_file_system_without_locks_is_written_and_not_swept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed("replacing", tmp_path / "room")

    def fails(descriptor: int, operation: int) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr(fcntl, "flock", fails)
    with replacing(tmp_path / "room") as new:
        (new / "whole").write_text("")
    assert names(tmp_path / "room") == ["whole"]
    assert len(names(tmp_path)) == 2


def test_files_are_added_all_or_none(tmp_path: Path) -> None:
    directory = tmp_path / "a" / "out"
    killed("adding", directory)
    with suppress(ZeroDivisionError), adding(directory) as new:
        (new / "file").write_text("new")
        raise ZeroDivisionError
    assert names(directory) == []  # and what the killed one left is gone
    (directory / "file").write_text("old")
    (directory / "deeper").mkdir()
    with pytest.raises(InputError, match="out: cannot be written: No space"), adding(directory):
        raise OSError(28, "No space left on device")
    assert (directory / "file").read_text() == "old"
    with adding(directory) as new:
        (new / "file").write_text("new")
        (new / "other").write_text("")
    assert names(directory) == ["deeper", "file", "other"]
    assert (directory / "file").read_text() == "new"


def test_a_directory_into_which_nothing_came_is_not_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ZeroDivisionError), adding(tmp_path / "out"):
        raise ZeroDivisionError
    assert names(tmp_path) == []
    with adding(tmp_path / "out") as new:
        (new / "file").write_text("")
    monkeypatch.chdir(tmp_path / "out")
    with adding(Path()) as new:
        (new / "here").write_text("")
    assert names(tmp_path / "out") == ["file", "here"]


def test_a_plan_that_cannot_be_drawn_leaves_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    map_directory.save(tmp_path / "map", HeightMap.from_metres([[0.0] * 64] * 64))
    arguments = ["plan", str(tmp_path / "map"), "--start", "2,2", "-o", str(tmp_path / "out")]
    assert cli.main([*arguments, "--goal", "6,6"]) == 0
    before = (tmp_path / "out" / "plan.tum").read_bytes()

    def fails(path: Path, *_: object) -> None:
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(plan_figure, "draw", fails)
    assert cli.main([*arguments, "--goal", "6,2"]) == 2
    assert (tmp_path / "out" / "plan.tum").read_bytes() == before
    assert names(tmp_path / "out") == ["plan.png", "plan.tum"]
