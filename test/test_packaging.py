# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The package as a package: its manifests, its executables, the order of its modules."""

from __future__ import annotations

import ast
import os
import re
import sys
from importlib.metadata import distribution
from pathlib import Path

import pytest
from ament_index_python import get_package_prefix
from catkin_pkg.package import Package, parse_package

ROOT = Path(__file__).resolve().parent.parent
NAME = "heightmap25d_ros"
EXECUTABLES = {
    "driver", "heightmap25d", "localization", "mapping", "markers", "planning", "replay",
    "simulator",
}  # fmt: skip

# A module imports only modules before it; those of nodes/ and simulation/ also one another.
ORDER = [
    "errors", "se3", "params", "parameter_file",
    "grid", "sensor",
    "mapper", "terrain", "footprint", "traversability",
    "intrinsics", "planner", "gaps", "transition_costs", "path", "standing", "surface_poses",
    "footprint_check", "route",
    "messages", "transforms", "intake", "message_intake", "mapping", "planning", "self_check",
    "matching", "short_term", "registration", "paper_registration", "relocalization",
    "health", "pose_filter", "tracking", "localization",
    "bag", "atomic_directory", "map_io", "block_view", "render", "plan_view",
    "localization_pictures",
    "display", "triangle_list", "scene_3d",
    "evaluation", "reachability", "drivability", "trajectory_error",
    "simulation",
    "commands", "cli", "nodes",
]  # fmt: skip

# rosdep's name of what is imported under another name; rosbags and the extras, mujoco and rerun,
# have none, llvmlite comes with numba, and grid_map_msgs is used where it is.
ROSDEP_KEYS = {
    "grid_map_msgs": None,
    "llvmlite": None,
    "matplotlib": "python3-matplotlib",
    "mpl_toolkits": "python3-matplotlib",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "mujoco": None,
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
        for folder in ("benchmarks", "launch", "scripts", "test")
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
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
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
    assert package.version == manifest().version == distribution(NAME).version


def test_messages_depend_on_what_their_fields_use() -> None:
    folder = ROOT / "heightmap25d_msgs"
    used = {
        package
        for path in (*folder.glob("msg/*.msg"), *folder.glob("srv/*.srv"))
        for package in re.findall(r"^(\w+)/\w+", path.read_text(), re.MULTILINE)
    }
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


@pytest.mark.parametrize("path", MODULES, ids=short)
def test_imports_point_one_way(path: Path) -> None:
    module = path.relative_to(ROOT / NAME).with_suffix("").parts[0]
    own = {name.split(".")[1] for name in imports(path) if name.startswith(f"{NAME}.")}
    if module == "__init__":
        assert own == set()
        return
    allowed = set(ORDER[: ORDER.index(module)]) - {"cli"}
    if path.parent.name == module:  # a folder's modules may import one another
        allowed.add(module)
    assert own <= allowed


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
