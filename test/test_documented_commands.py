# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every command of the documentation: the cheap ones are run, of the others the options hold."""

import importlib
import re
import shlex
import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path

import pytest
import yaml
from PIL import Image
from repository import ROOT

from heightmap25d_ros import cli
from heightmap25d_ros.nodes import replay
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.files import read_yaml
from heightmap25d_ros.params.sections import Params

PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), ROOT / "bags" / "README.md"])
CHEAP = {"info", "map", "convert", "evaluate", "render", "plan"}
# Of the machine, or of ROS workspaces elsewhere: nothing of ours to be held against.
FOREIGN = {
    "cd", "colcon", "docker", "export", "git", "grep", "pip3", "python3", "rm", "rosdep", "sudo",
    "uv",
}  # fmt: skip


def commands(page):
    """Words of each command of a page's sh blocks, indented blocks and inline ros2 commands."""
    text = page.read_text().replace("\\\n", " ")
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    without_fences = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    indented = re.findall(r"^ {4}([a-z].*)$", without_fences, re.MULTILINE)
    inline = re.findall(r"`((?:ros2|rviz2) [^`]*)`", without_fences)
    for line in [*(line for block in blocks for line in block.splitlines()), *indented, *inline]:
        for part in re.split(r"&&|\|", line.partition("  #")[0].replace("<this repository>", "X")):
            words = shlex.split(part, comments=True)
            if words:
                yield words


def check_ros_arguments(words):
    given = [words[i + 1] for i, word in enumerate(words) if word == "-p"]
    pairs = [text.split(":=", 1) for text in given]
    with_values(Params(), {name: yaml.safe_load(value) for name, value in pairs})


def check_node(name, words):
    assert (
        name in distribution("heightmap25d_ros").entry_points.select(group="console_scripts").names
    )
    if name == "replay":
        replay._parser().parse_args(words)
    else:
        assert words == [] or words[0] == "--ros-args"
        check_ros_arguments(words)


def check_ros2(words):
    if words[:2] == ["run", "heightmap25d_ros"]:
        check_node(words[2], words[3:])
    elif words[:2] == ["service", "call"]:
        package, _, name = words[3].split("/")
        request = getattr(importlib.import_module(f"{package}.srv"), name).Request
        request(**yaml.safe_load(words[4]))
    elif words[:2] == ["action", "send_goal"]:
        package, _, name = words[-2].split("/")
        goal = getattr(importlib.import_module(f"{package}.action"), name).Goal
        goal(**yaml.safe_load(words[-1]))
    elif words[:2] == ["launch", "heightmap25d_ros"]:
        assert (ROOT / "launch" / words[2]).exists()
    elif words[0] not in {"bag", "lifecycle", "node", "param", "security", "topic", "run"}:
        pytest.fail(f"ros2 {' '.join(words)}: not known to this test")


def check_python(words):
    if words[:2] == ["-m", "pip"]:
        return
    if words[:2] == ["-m", "pytest"]:
        assert (ROOT / words[2]).exists()
    elif words[0] == "-m":
        module = words[1].removeprefix("heightmap25d_ros.nodes.")
        check_node(module, words[2:])
    else:
        source = (ROOT / words[0]).read_text()
        assert all(word in source for word in words[1:] if word.startswith("--"))


def check(words):
    first, rest = words[0], words[1:]
    if first == "heightmap25d":
        cli._parser().parse_args(rest)
    elif first == "ros2":
        check_ros2(rest)
    elif first == "python":
        check_python(rest)
    elif first == "make":
        assert re.search(rf"^{rest[0]}:", (ROOT / "Makefile").read_text(), re.MULTILINE)
    elif first == "rviz2":
        assert (ROOT / rest[1]).exists()
    elif first == "source":
        assert (ROOT / rest[0]).exists()
    elif first == "pip":
        files = [rest[i + 1] for i, word in enumerate(rest) if word == "-r"]
        assert all((ROOT / file).exists() for file in files)
    else:
        assert first in FOREIGN


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_have_the_options_that_there_are(page):
    for words in commands(page):
        try:
            check(words)
        except SystemExit:
            pytest.fail(" ".join(words))


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_cheap_commands_do_what_they_say(page, tmp_path, monkeypatch, capsys):
    """Those on a bag of the ramp, and on what was made of it, in the order of the page."""
    monkeypatch.chdir(tmp_path)
    for name in ("bags", "config"):
        (tmp_path / name).symlink_to(ROOT / name)
    for words in commands(page):
        is_cheap = words[0] == "heightmap25d" and words[1] in CHEAP
        if is_cheap and Path(words[2]).exists() and "ramp" in str(words):
            assert cli.main(words[1:]) == 0, (words, capsys.readouterr().err)


@pytest.mark.slow
def test_pictures_of_the_tuning_page_are_those_of_the_script(tmp_path):
    script = ROOT / "studies" / "tuning_pictures.py"
    subprocess.run(
        [sys.executable, script, tmp_path, "climb_weight"], check=True, capture_output=True
    )
    with Image.open(tmp_path / "tuning_climb_weight.png") as picture:
        assert min(picture.size) > 400
    wrong = subprocess.run(
        [sys.executable, script, tmp_path, "bogus"], capture_output=True, text=True, check=False
    )
    assert wrong.returncode == 2
    names = wrong.stderr.partition("there are ")[2].strip().split(", ")
    page = (ROOT / "docs" / "tuning.md").read_text()
    assert sorted(names) == sorted(re.findall(r"\(tuning_(\w+)\.png\)", page))


def test_blocks_of_yaml_are_yaml_and_ours_hold_known_parameters(tmp_path):
    for page in PAGES:
        for block in re.findall(r"^```yaml\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL):
            if "/**" in yaml.safe_load(block):
                path = tmp_path / "block.yaml"
                path.write_text(block)
                read_yaml(path, "mapping")


def test_pages_link_to_what_there_is():
    for page in PAGES:
        for link in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
            if not link.startswith("http"):
                assert (page.parent / link).exists(), f"{page.name}: {link}"
