# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The Dockerfile and docs/ubuntu.md against manifests and requirements; neither is built here."""

import re
import shlex
from fnmatch import fnmatch

import pytest
from catkin_pkg.package import parse_package
from repository import ROOT

DOCKERFILE = (ROOT / "Dockerfile").read_text()
PAGE = (ROOT / "docs" / "ubuntu.md").read_text()
MANIFESTS = {"src": ROOT, "src/heightmap25d_ros/heightmap25d_msgs": ROOT / "heightmap25d_msgs"}


def instructions(name):
    """Words of each instruction of a kind, continued lines joined."""
    lines = re.sub(r"\\\n", " ", DOCKERFILE).splitlines()
    return [shlex.split(line)[1:] for line in lines if line.startswith(f"{name} ")]


def commands(lines, *first):
    """Words of those commands of some lines that begin with given ones."""
    parts = [part for line in lines for part in line.split("&&")]
    found = [shlex.split(part, comments=True) for part in parts]
    return [words for words in found if words[: len(first)] == list(first)]


def commands_of_dockerfile(*first):
    return commands([" ".join(words) for words in instructions("RUN")], *first)


def commands_of_page(*first):
    blocks = "".join(re.findall(r"^```sh\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL))
    return commands(blocks.replace("<this repository>", "X").splitlines(), *first)


def after(words, option):
    """The words between an option and the next one."""
    rest = words[words.index(option) + 1 :]
    return rest[: next((i for i, word in enumerate(rest) if word.startswith("-")), len(rest))]


def required():
    """What the package imports besides ROS: the names in requirements/runtime.txt."""
    lines = (ROOT / "requirements" / "runtime.txt").read_text().splitlines()
    return {match[0] for line in lines if (match := re.match(r"[\w-]+", line))}


def keys():
    """What rosdep is asked for."""
    packages = [parse_package(str(folder)) for folder in MANIFESTS.values()]
    return {dependency.name for package in packages for dependency in package.exec_depends}


@pytest.mark.parametrize("found", [commands_of_dockerfile, commands_of_page])
def test_apt_and_pip_bring_all_that_is_required(found):
    (rosdep,), (pip,) = found("rosdep", "install"), found("pip3", "install")
    skipped = after(rosdep, "--skip-keys")
    assert set(skipped) <= keys()
    assert after(rosdep, "--from-paths") == list(MANIFESTS)
    by_rosdep = {key for key in keys() - set(skipped) if key.startswith("python3-")}
    by_pip = after(pip, "--constraint")[1:]
    named = {f"python3-{name.removeprefix('py')}": name for name in required()}
    assert {name for key, name in named.items() if key not in by_rosdep} == set(by_pip)
    pins = (ROOT / "requirements" / "pins.txt").read_text()
    assert all(re.search(rf"^{name}==", pins, re.MULTILINE) for name in by_pip)
    assert after(pip, "--constraint")[0] == "src/heightmap25d_ros/requirements/pins.txt"
    (build,) = found("colcon", "build")
    assert after(build, "--base-paths") == list(MANIFESTS)


def test_what_pip_installs_on_python_3_12_leaves_the_numpy_of_ubuntu():
    pins = (ROOT / "requirements" / "pins.txt").read_text()
    assert "numpy==1.26.4 ; python_full_version == '3.12.*'" in pins


def test_all_that_is_copied_is_there_and_not_ignored():
    ignored = [
        line
        for line in (ROOT / ".dockerignore").read_text().splitlines()
        if line and not line.startswith("#")
    ]
    needed = ["setup.py", "setup.cfg", "resource", "scripts/heightmap25d", "config", "launch"]
    sources = [source for *sources, _ in instructions("COPY") for source in sources]
    assert sources[-1] == "."
    for source in [*sources[:-1], *needed]:
        assert (ROOT / source).exists()
        assert not any(fnmatch(source.split("/")[0], pattern) for pattern in ignored)
    assert {".venv", "build", "install"} <= set(ignored)  # made for another machine


def test_the_page_says_that_nothing_of_it_is_built_by_the_project():
    assert "have been built" in " ".join(PAGE.replace("\n>", "").split())
    assert instructions("FROM") == [["ros:jazzy-ros-base"]]
