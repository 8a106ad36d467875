# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The package as a package: its manifests, its executables, the order of its modules."""

from __future__ import annotations

import ast
import os
import re
import sys
from graphlib import TopologicalSorter
from importlib.metadata import distribution
from pathlib import Path

import pytest
from ament_index_python import get_package_prefix
from catkin_pkg.package import Package, parse_package
from repository import ROOT

from heightmap25d_ros.version import VERSION

NAME = "heightmap25d_ros"
EXECUTABLES = {
    "exploration", "heightmap25d", "localization", "mapping", "markers", "path_follower",
    "planning", "replay", "simulator",
}  # fmt: skip

# From the ground up: a room imports the storeys below its own, and the rooms before it in its own.
STOREYS = [
    [
        "version",
        "errors",
        "arrays",
        "kernels",
        "se3",
        "pose_interpolation",
        "memory",
        "input_files",
        "params",
        "grid",
    ],
    ["mapping", "terrain", "planning", "localization", "slam", "exploration", "control"],
    ["io", "viz", "evaluation", "pipelines"],
    ["simulation", "commands", "cli", "nodes", "executables"],
]
ROOMS = [room for storey in STOREYS for room in storey]

# rosdep's name of what is imported under another name; rosbags and the extras, distributed, mujoco,
# rasterio and rerun, have none, llvmlite comes with numba, lz4 and zstd (backports, or compression
# from Python 3.14 on) with rosbags; grid_map_msgs, map_msgs and nav2_msgs are used where they are.
ROSDEP_KEYS = {
    "argcomplete": "python3-argcomplete",
    "backports": None,
    "compression": None,
    "distributed": None,
    "grid_map_msgs": None,
    "llvmlite": None,
    "lz4": None,
    "map_msgs": None,
    "matplotlib": "python3-matplotlib",
    "mpl_toolkits": "python3-matplotlib",
    "nav2_msgs": None,
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "mujoco": None,
    "rasterio": None,
    "rerun": None,
    "rosbags": None,
    "scipy": "python3-scipy",
    "tqdm": "python3-tqdm",
    "yaml": "python3-yaml",
}

MODULES = sorted((ROOT / NAME).rglob("*.py"))
PYTHON_FILES = [
    *MODULES,
    ROOT / "setup.py",
    *(
        path
        for folder in ("benchmarks", "examples", "launch", "scripts", "studies", "test")
        for path in sorted((ROOT / folder).rglob("*.py"))
    ),
]


def short(path: Path) -> str:
    return str(path.relative_to(ROOT))


def imports(path: Path) -> set[str]:
    """Absolute names of all that a file imports, at whatever depth it does so."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{short(path)}:{node.lineno}: relative import"
            found |= {str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def manifest(folder: Path = ROOT) -> Package:
    warnings: list[str] = []
    package = parse_package(str(folder), warnings=warnings)
    assert warnings == []
    return package


def run_dependencies(package: Package) -> set[str]:
    return {dependency.name for dependency in package.exec_depends}


@pytest.mark.parametrize(
    ("folder", "build_type"), [(".", "ament_python"), ("heightmap25d_msgs", "ament_cmake")]
)
def test_manifest_is_valid(folder: str, build_type: str) -> None:
    package = manifest(ROOT / folder)
    assert package.package_format == 3
    assert package.get_build_type() == build_type
    assert package.licenses == ["Apache-2.0"]
    assert package.version == manifest().version == distribution(NAME).version == VERSION


def test_messages_depend_on_what_their_fields_use() -> None:
    folder = ROOT / "heightmap25d_msgs"
    used = {
        package
        for path in sorted(folder.glob("*/*.*"))
        for package in re.findall(r"^(\w+)/\w+", path.read_text(), re.MULTILINE)
    } - {folder.name}
    used |= {"action_msgs"} if any(folder.glob("action/*.action")) else set()
    package = manifest(folder)
    assert {d.name for d in package.build_depends} == used | {"rosidl_default_generators"}
    assert run_dependencies(package) == used | {"rosidl_default_runtime"}
    assert [group.name for group in package.member_of_groups] == ["rosidl_interface_packages"]


def test_manifest_names_all_that_is_imported() -> None:
    imported = {name.partition(".")[0] for path in MODULES for name in imports(path)}
    imported -= {NAME, *sys.stdlib_module_names}
    needed = {ROSDEP_KEYS.get(name, name) for name in imported} - {None}
    assert needed <= run_dependencies(manifest())


def test_requirements_and_manifest_agree() -> None:
    lines = (ROOT / "requirements" / "runtime.txt").read_text().splitlines()
    required = {match[0] for line in lines if (match := re.match(r"[\w-]+", line))}
    keys = {f"python3-{name.removeprefix('py')}" for name in required - {"rosbags"}}
    assert keys == {name for name in run_dependencies(manifest()) if name.startswith("python3-")}


def test_every_executable_is_where_ros2_run_looks() -> None:
    folder = Path(get_package_prefix(NAME)) / "lib" / NAME
    found = {path.name for path in folder.iterdir() if os.access(path, os.X_OK) and path.is_file()}
    assert found == EXECUTABLES


@pytest.mark.parametrize("name", sorted(EXECUTABLES))
def test_executable_imports(name: str) -> None:
    (entry_point,) = distribution(NAME).entry_points.select(group="console_scripts", name=name)
    assert callable(entry_point.load())


def room_of(module: str) -> str:
    return module.split(".")[1]


@pytest.mark.parametrize(
    "path", [p for p in MODULES if p.parent != ROOT / NAME or p.stem != "__init__"], ids=short
)
def test_imports_point_down_the_storeys(path: Path) -> None:
    room = path.relative_to(ROOT / NAME).with_suffix("").parts[0]
    own = {room_of(name) for name in imports(path) if name.startswith(f"{NAME}.")}
    assert own - {room} <= set(ROOMS[: ROOMS.index(room)])


def test_the_readme_tells_where_each_room_is() -> None:
    table = (ROOT / "README.md").read_text().split("## Where things are")[1].split("\n## ")[0]
    told = set(re.findall(r"`(\w+)(?:/|\.py)`", table))
    assert set(ROOMS) <= told


def test_no_module_imports_itself_by_way_of_others() -> None:
    def dotted(path: Path) -> str:
        return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")

    # The package itself imports a name when it is used: see test_api.py.
    modules = {
        dotted(path): imports(path) for path in MODULES if path != ROOT / NAME / "__init__.py"
    }
    graph = {name: [n for n in found if n in modules] for name, found in modules.items()}
    tuple(TopologicalSorter(graph).static_order())  # raises where there is a circle


def test_private_modules_stay_in_their_room() -> None:
    for path in MODULES:
        room = path.relative_to(ROOT / NAME).parts[0]
        for name in imports(path):
            is_private = name.startswith(f"{NAME}.") and any(
                p.startswith("_") for p in name.split(".")
            )
            assert not is_private or room_of(name) == room, path


def test_no_two_test_files_have_the_same_name() -> None:
    """pytest imports them by their names alone, and refuses the second one."""
    names = [path.name for path in (ROOT / "test").rglob("test_*.py")]
    assert sorted(set(names)) == sorted(names)


@pytest.mark.parametrize("path", [p for p in MODULES if p.parent.name != "nodes"], ids=short)
def test_ros_is_imported_below_nodes_only(path: Path) -> None:
    ros = {name for name in run_dependencies(manifest()) if not name.startswith("python3-")}
    assert not ros & {name.partition(".")[0] for name in imports(path)}


@pytest.mark.parametrize("path", PYTHON_FILES, ids=short)
def test_file_names_its_licence(path: Path) -> None:
    lines = [line for line in path.read_text().splitlines()[:3] if not line.startswith("#!")]
    assert lines[:2] == [
        "# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors",
        "# SPDX-License-Identifier: Apache-2.0",
    ]
