# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the Tab key offers for ``heightmap25d``."""

import shlex
import subprocess
import sys
from itertools import count, takewhile

import argcomplete
import pytest

from heightmap25d_ros import cli
from heightmap25d_ros.commands import SUMMARIES


def offered(line):
    """What argcomplete offers at the end of a line that begins after ``heightmap25d``."""
    finder = argcomplete.CompletionFinder(cli._parser())
    found = takewhile(bool, (finder.rl_complete(line, index) for index in count()))
    return {words.split()[-1] for words in found}


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("ma", {"map"}),
        ("re", {"render", "replay"}),
        ("map --initial", {"--initial-map"}),
        ("map bag -o out --update-rule ", {"candidate", "paper"}),
        ("bringup --nodes pl", {"planning"}),
    ],
)
def test_commands_options_and_choices_are_offered(line, words):
    assert words <= offered(line)
    if line[-1] != " ":
        assert words == offered(line)


def test_directories_are_offered(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bag_of_today").mkdir()
    assert offered("map bag_") == {"bag_of_today/"}


@pytest.mark.slow
def test_in_bash_as_the_readme_says():
    line = "heightmap25d map --upd"
    script = f"""
        eval "$(register-python-argcomplete heightmap25d)"
        COMP_WORDS=({line}) COMP_CWORD=2 COMP_LINE={shlex.quote(line)} COMP_POINT={len(line)}
        COMP_TYPE=9
        "$(complete -p heightmap25d | sed 's/.*-F \\([^ ]*\\).*/\\1/')" heightmap25d --upd map
        echo "${{COMPREPLY[@]}}"
    """
    run = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert (run.stdout.strip(), run.returncode) == ("--update-rule", 0), run.stderr


def test_help_imports_no_command():
    """It comes at once: numpy and numba alone take half a second."""
    script = (
        "import sys; from heightmap25d_ros import cli\n"
        "try: cli.main(['--help'])\n"
        "except SystemExit: print(*sys.modules, sep='\\n')"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    shown, _, modules = run.stdout.rpartition("-o out/pictures\n")
    assert all(f"\n    {name} " in shown for name in SUMMARIES)
    assert not {"numpy", "numba", "matplotlib", "yaml"} & set(modules.split())
