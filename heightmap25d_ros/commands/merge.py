# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d merge``: one map of several saved maps of one place."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from heightmap25d_ros import se3
from heightmap25d_ros.commands.common import (
    Figures,
    add_command,
    cell_counts,
    check_output,
    read_params,
    require_map,
)
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io import (
    atomic_directory,
    layers_file,
    map_directory,
    merge_file,
    slam_file,
)
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.slam.map_merge import Merged, merge_maps, register_all
from heightmap25d_ros.slam.map_registration import MapRegistration, RegisteredMap
from heightmap25d_ros.terrain.traversability import to_obstacle_map
from heightmap25d_ros.viz import merge_figures


def add_to(commands: Any) -> None:
    """Add ``merge``."""
    command = add_command(commands, "merge", _merge)
    command.add_argument("maps", type=Path, nargs="+", metavar="MAP",
                         help="map directory; the frame is that of the first one")  # fmt: skip
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help="map directory to write")  # fmt: skip


def _merge(options: argparse.Namespace) -> Figures:
    """Merge saved maps of one place, whatever their frames are.

    Each map is searched in what is merged already; it must overlap with it, with walls or steps
    that both show. A map that fits nowhere, or in several places, is refused, and nothing is
    written. Besides the map directory: merge.json, and overlap.png.
    """
    if len(options.maps) < 2:
        raise InputError(f"{options.maps[0]}: is a single map, there is nothing to merge")
    settings = read_params(options)
    check_output(options.output)
    maps = _loaded(options.maps, settings)
    names = [str(path) for path in options.maps]
    found = register_all(maps, names, settings)
    merged = merge_maps(maps, [r.T_fixed_moving for r in found], settings)
    report = _report(options.maps, found, merged)
    obstacles = to_obstacle_map(merged.height_map, settings.traversability)
    frame = settings.mapping.map_frame
    map_directory.save(options.output, merged.height_map, obstacles, frame, (), merged.layers)
    with atomic_directory.adding(options.output) as new:
        merge_file.write(options.output, report, into=new)
        merge_figures.overlap(new / "overlap.png", merged, names)
    return {
        "map": str(options.output),
        "merged": {source.pop("map"): source for source in report["maps"]},
        "common_cells": report["common_cells"],
        "differing_cells": report["differing_cells"],
        "has_layers": merged.layers is not None,
        **cell_counts(merged.height_map, obstacles),
        "sha256": map_directory.digest(options.output),
    }


def _loaded(paths: list[Path], settings: Params) -> list[RegisteredMap]:
    maps: list[RegisteredMap] = []
    threshold, frame = settings.mapper.probability_threshold, settings.mapping.map_frame
    for path in paths:
        require_map(path)
        height_map = map_directory.load_in(path, threshold, frame)
        maps.append(RegisteredMap(height_map, layers_file.load(path, height_map), settings))
        resolution, first = (m.height_map.geometry.resolution for m in (maps[-1], maps[0]))
        if resolution != first:
            raise InputError(f"{path}: resolution is {resolution:g} m, of {paths[0]} {first:g} m")
    return maps


def placing(found: MapRegistration, *, is_first: bool) -> dict[str, float]:
    """Where a map lies in the first one, and how well it fits, for a report."""
    x, y, z, _, _, yaw = (round(float(n), 4) for n in se3.to_xyz_rpy(found.T_fixed_moving))
    pose = {"x_m": x, "y_m": y, "z_m": z, "yaw_rad": yaw}
    if is_first:
        return pose
    return pose | {
        "score": round(found.score), "agreeing": round(found.agreeing, 3),
        "residual_m": round(found.residual, 4),
    }  # fmt: skip


def _report(paths: list[Path], found: list[MapRegistration], merged: Merged) -> dict[str, Any]:
    """What merge.json tells."""
    maps = [
        {
            "map": str(path), "poses": "known" if slam_file.load(path) is None else "estimated",
            **placing(registration, is_first=not number),
        } for number, (path, registration) in enumerate(zip(paths, found, strict=True))
    ]  # fmt: skip
    return {
        "poses": "estimated" if any(m["poses"] == "estimated" for m in maps) else "known",
        "common_cells": int((merged.known_by > 1).sum()),
        "differing_cells": int(merged.differs.sum()),
        "maps": maps,
    }
