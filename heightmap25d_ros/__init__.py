# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A 2 1/2-D map for ROS 2: a height and a probability per cell (Fong et al., 2003).

``import heightmap25d_ros as hm`` offers what a Python script needs:

- the map: `HeightGrid` grows, `HeightMap` is a dense rectangle of it
- mapping: `Mapper` merges a `Scan`, or the `beams` that one consists of
- obstacles: `to_obstacle_map`
- planning: `Planner` and `Pose2D`
- localization: `Localizer`
- recorded bags: `Bag` reads one, `map_bag` and `localize_bag` process one
- map directories: `load_map` and `save_map`
- pictures: `map_figures`
- `Params` for all parameters, `se3` for poses, `InputError` for bad input from outside

The scripts in ``examples/`` use them. Everything else is imported from its module, for instance
``from heightmap25d_ros.terrain.steps import transitions``; the docstring of each package lists its
modules.

A name is imported when it is first used, so that ``import heightmap25d_ros`` itself loads neither
numba nor matplotlib.

Examples
--------
>>> import heightmap25d_ros as hm
>>> height_map = hm.HeightMap.from_metres([[0.0, 0.0, 0.5]])
>>> hm.to_obstacle_map(height_map).occupancy
array([[  0,   0, 100]], dtype=int8)
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

# Several threads of BLAS round otherwise on each number of cores, and maps of one bag would differ;
# they also wait for work at full load, at matrices that one of them solves as fast. This is read
# when NumPy is imported; afterwards it would reach child processes alone.
if "numpy" not in sys.modules:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if TYPE_CHECKING:
    from heightmap25d_ros import se3
    from heightmap25d_ros.errors import InputError
    from heightmap25d_ros.grid.height_grid import HeightGrid
    from heightmap25d_ros.grid.height_map import HeightMap
    from heightmap25d_ros.io.bag import Bag
    from heightmap25d_ros.io.map_directory import load as load_map
    from heightmap25d_ros.io.map_directory import save as save_map
    from heightmap25d_ros.mapping.mapper import Mapper
    from heightmap25d_ros.mapping.scan import Scan
    from heightmap25d_ros.mapping.sensor_model import beams
    from heightmap25d_ros.params.sections import Params
    from heightmap25d_ros.pipelines.from_bag import localize_bag, map_bag
    from heightmap25d_ros.pipelines.localization import Localizer
    from heightmap25d_ros.planning.plan import Pose2D
    from heightmap25d_ros.planning.planner import Planner
    from heightmap25d_ros.terrain.traversability import to_obstacle_map
    from heightmap25d_ros.viz import map_figures

__all__ = [
    "Bag",
    "HeightGrid",
    "HeightMap",
    "InputError",
    "Localizer",
    "Mapper",
    "Params",
    "Planner",
    "Pose2D",
    "Scan",
    "beams",
    "load_map",
    "localize_bag",
    "map_bag",
    "map_figures",
    "save_map",
    "se3",
    "to_obstacle_map",
]

# Module of each name, and what it is called there; modules themselves have no second part.
_SOURCES = {
    "Bag": "io.bag:Bag",
    "HeightGrid": "grid.height_grid:HeightGrid",
    "HeightMap": "grid.height_map:HeightMap",
    "InputError": "errors:InputError",
    "Localizer": "pipelines.localization:Localizer",
    "Mapper": "mapping.mapper:Mapper",
    "Params": "params.sections:Params",
    "Planner": "planning.planner:Planner",
    "Pose2D": "planning.plan:Pose2D",
    "Scan": "mapping.scan:Scan",
    "beams": "mapping.sensor_model:beams",
    "load_map": "io.map_directory:load",
    "localize_bag": "pipelines.from_bag:localize_bag",
    "map_bag": "pipelines.from_bag:map_bag",
    "map_figures": "viz.map_figures",
    "save_map": "io.map_directory:save",
    "se3": "se3",
    "to_obstacle_map": "terrain.traversability:to_obstacle_map",
}


def __getattr__(name: str) -> Any:
    """Import a name of this package when it is first used."""
    if name not in _SOURCES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, attribute = _SOURCES[name].partition(":")
    value: Any = import_module(f"{__name__}.{module}")
    if attribute:
        value = getattr(value, attribute)
    globals()[name] = value  # the next use finds it without coming here
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
