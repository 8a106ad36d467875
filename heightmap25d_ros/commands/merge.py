# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d merge``: one map of several saved maps of one place."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

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
from heightmap25d_ros.slam.map_merge import Merged, merge_maps
from heightmap25d_ros.slam.map_registration import (
    MapRegistration,
    Outcome,
    RegisteredMap,
    register_maps,
)
from heightmap25d_ros.terrain.traversability import to_obstacle_map
from heightmap25d_ros.viz import merge_figures

_MOST_TOLD = 4  # places of an ambiguous map


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
    found = _registered(options.maps, maps, settings)
    merged = merge_maps(maps, [r.T_fixed_moving for r in found], settings)
    report = _report(options.maps, found, merged)
    obstacles = to_obstacle_map(merged.height_map, settings.traversability)
    frame = settings.mapping.map_frame
    map_directory.save(options.output, merged.height_map, obstacles, frame, (), merged.layers)
    with atomic_directory.adding(options.output) as new:
        merge_file.write(options.output, report, into=new)
        merge_figures.overlap(new / "overlap.png", merged, [str(path) for path in options.maps])
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


def _registered(
    paths: list[Path], maps: list[RegisteredMap], settings: Params
) -> list[MapRegistration]:
    """Where each map lies in the first one; one that fits nowhere waits for what others show."""
    found = {0: MapRegistration(outcome=Outcome.REGISTERED, T_fixed_moving=np.eye(4))}
    whole = maps[0]
    while len(found) < len(maps):
        refused: dict[int, MapRegistration] = {}
        for number in (n for n in range(len(maps)) if n not in found):
            result = register_maps(whole, maps[number], settings)
            if result.outcome is Outcome.REGISTERED:
                found[number] = result
                placed = sorted(found)
                merged = merge_maps(
                    [maps[n] for n in placed], [found[n].T_fixed_moving for n in placed], settings
                )
                whole = RegisteredMap(merged.height_map, merged.layers, settings)
                break
            refused[number] = result
        else:
            number, result = next(iter(refused.items()))
            others = ", ".join(str(paths[n]) for n in sorted(found))
            raise InputError(f"{paths[number]}: not merged with {others}: {_told(result)}")
    return [found[number] for number in range(len(maps))]


def _told(refused: MapRegistration) -> str:
    """Why a map was not registered."""
    if refused.outcome is Outcome.NO_PLACE:
        return f"{refused.outcome.value}, overlap with walls or steps is needed"
    places = [se3.to_xyz_rpy(T) for T in (refused.T_fixed_moving, *refused.rivals)]
    told = "; ".join(
        f"x {p[0]:.1f} m, y {p[1]:.1f} m, yaw {p[5]:.2f} rad" for p in places[:_MOST_TOLD]
    )
    return f"{refused.outcome.value}: {told}{'; ...' if len(places) > _MOST_TOLD else ''}"


def _report(paths: list[Path], found: list[MapRegistration], merged: Merged) -> dict[str, Any]:
    """What merge.json tells."""
    maps: list[dict[str, Any]] = []
    for path, registration in zip(paths, found, strict=True):
        pose = se3.to_xyz_rpy(registration.T_fixed_moving)
        x, y, z, _, _, yaw = (round(float(n), 4) for n in pose)
        told = {
            "map": str(path), "poses": "known" if slam_file.load(path) is None else "estimated",
            "x_m": x, "y_m": y, "z_m": z, "yaw_rad": yaw,
        }  # fmt: skip
        if maps:
            told["score"] = round(registration.score)
            told["agreeing"] = round(registration.agreeing, 3)
            told["residual_m"] = round(registration.residual, 4)
        maps.append(told)
    return {
        "poses": "estimated" if any(m["poses"] == "estimated" for m in maps) else "known",
        "common_cells": int((merged.known_by > 1).sum()),
        "differing_cells": int(merged.differs.sum()),
        "maps": maps,
    }
