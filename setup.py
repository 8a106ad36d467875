# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What colcon installs: the Python package, its executables and its shared files."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "heightmap25d_ros"
NODES = (
    "exploration", "localization", "mapping", "markers", "path_follower", "planning", "replay",
    "simulator",
)  # fmt: skip


def shared(folder: str) -> tuple[str, list[str]]:
    """The files of one folder, and where `ros2 launch` and others look for them."""
    files = sorted(str(path) for path in Path(folder).glob("*") if path.is_file())
    return f"share/{NAME}/{folder}", files


setup(
    name=NAME,
    version="0.1.0",
    description="2 1/2-D height maps from planar lasers on a wheeled robot",
    maintainer="heightmap25d_ros authors",
    maintainer_email="heightmap25d@example.org",
    license="Apache-2.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        ("bin", ["scripts/heightmap25d"]),
        shared("config"),
        shared("launch"),
        shared("rviz"),
    ],
    extras_require={
        "simulation": ["mujoco >= 3.5, < 4"],
        "dask": ["distributed >= 2024.8"],
        "geotiff": ["rasterio >= 1.4, < 2"],
        "view": ["rerun-sdk >= 0.23.1, < 0.42"],
        "test": ["pytest"],  # has colcon test run pytest
    },
    python_requires=">=3.10",
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "heightmap25d = heightmap25d_ros.cli:main",
            *(f"{node} = heightmap25d_ros.executables:main" for node in NODES),
        ],
    },
)
