# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How much memory a map takes, ours and OctoMap's, and the paper's own count of numbers.

    python benchmarks/memory.py

Resident memory is what the kernel says, each map in a process of its own: the growth from an
empty map to that of the whole stream, and to that of two scans 5 km apart.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import octomap
import stream

from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import GridParams, MapperParams, Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import feed

RAMP = Path(__file__).parent.parent / "bags" / "ramp"
PAPER_LAYERS = 16  # of the coarse evidence grid that the paper compares with
NUMBERS_PER_CELL = 2  # height and probability


def measure() -> dict[str, float]:
    """Bytes, numbers and cells."""
    ours, octree = _alone("ours"), _alone("octomap")
    return {
        **ours,
        **_alone("literal"),
        **octree,
        "octomap_bytes_per_m2": octree["octomap_bytes"] / ours["observed_m2"],
        "octomap_bytes_per_ours": octree["octomap_bytes"] / ours["resident_bytes"],
        **_alone("far"),
        **count_numbers(),
    }


def _alone(name: str) -> dict[str, float]:
    """What one of the measurements below prints in a process of its own."""
    done = subprocess.run(
        [sys.executable, __file__, name], check=True, stdout=subprocess.PIPE, text=True
    )
    return dict(json.loads(done.stdout))


def _ours(prefix: str = "", **rule: str) -> dict[str, float]:
    scans = stream.beams(stream.record())
    params = Params(mapper=MapperParams(**rule))
    _mapper(params).integrate(scans[0])
    before = _resident()
    mapper = _mapper(params)
    for beams in scans:
        mapper.integrate(beams)
    resident = _resident() - before
    cells = int((mapper.grid.probability.read(mapper.grid.observed_area()) > 0).sum())
    square_metres = cells * params.grid.resolution**2
    return {
        f"{prefix}observed_cells": cells,
        f"{prefix}observed_m2": square_metres,
        f"{prefix}resident_bytes": resident,
        f"{prefix}bytes_per_cell": resident / cells,
        f"{prefix}bytes_per_m2": resident / square_metres,
    }


def _octomap() -> dict[str, float]:
    scans = stream.beams(stream.record())
    octomap.OcTree(0.125).insertPointCloud(scans[0].ends[:1], scans[0].origins[0])
    before = _resident()
    tree = octomap.OcTree(0.125)
    for beams in scans:
        tree.insertPointCloud(beams.ends[beams.is_hit], beams.origins[0])
    return {
        "octomap_resident_bytes": _resident() - before,
        "octomap_bytes": tree.memoryUsage(),
        "octomap_nodes": tree.size(),
    }


def _far() -> dict[str, float]:
    """A grid of 4 km x 4 km, before and after two scans in opposite corners of it."""
    scan = stream.beams(stream.record(1))[0]
    params = Params(grid=GridParams(extent=4096.0))
    _mapper(params).integrate(scan)
    reserved, resident = _reserved(), _resident()
    mapper = _mapper(params)
    reserved, empty = _reserved() - reserved, _resident() - resident
    for offset in (-1950.0, 1950.0):
        mapper.integrate(_moved(scan, offset))
    rows, columns = mapper.grid.observed_area().shape
    return {
        "far_side_m": min(rows, columns) * mapper.grid.geometry.resolution,
        "far_reserved_bytes": reserved,
        "far_resident_empty_bytes": empty,
        "far_resident_bytes": _resident() - resident,
    }


def count_numbers() -> dict[str, float]:
    """The map of bags/ramp counted as the paper counts its own: numbers in the whole rectangle.

    The 3-D grid has the paper's 16 layers; of cubes as wide as the cells, what lies between the
    lowest and the highest height of the map takes as many as are counted here.
    """
    with Bag(RAMP) as bag:
        mapping = Mapping(with_values(Params(), {"intake.scan_topics": bag.scan_topics()}))
        for event in bag.events(["/tf_static", "/odom", *bag.scan_topics()]):
            feed(mapping, event.topic, event.message)
        mapping.flush()
    height_map, _ = mapping.maps()
    rows, columns = height_map.geometry.shape
    metres = np.ptp(height_map.height[height_map.known]) * 0.01
    return {
        "ramp_columns": columns,
        "ramp_rows": rows,
        "ramp_numbers": rows * columns * NUMBERS_PER_CELL,
        "ramp_numbers_3d": rows * columns * PAPER_LAYERS,
        "ramp_layers_of_cubes": int(np.ceil(metres / height_map.geometry.resolution)),
    }


def _mapper(params: Params) -> Mapper:
    return Mapper(HeightGrid(params.grid), params.sensor, params.mapper)


def _moved(beams: Beams, offset: float) -> Beams:
    shift = np.array([offset, offset, 0.0])
    return replace(beams, origins=beams.origins + shift, ends=beams.ends + shift)


def _resident() -> int:
    return _status("VmRSS")


def _reserved() -> int:
    return _status("VmSize")


def _status(field: str) -> int:
    """A field of this process's status in bytes."""
    text = Path("/proc/self/status").read_text()
    return 1024 * int(re.findall(rf"{field}:\s+(\d+) kB", text)[0])


if __name__ == "__main__":
    parts = {
        "ours": _ours,
        "literal": lambda: _ours("literal_", update_rule="paper"),
        "octomap": _octomap,
        "far": _far,
    }
    if len(sys.argv) > 1:
        print(json.dumps(parts[sys.argv[1]]()))
    else:
        for name, value in measure().items():
            print(f"{name:<34} {value:>16,.1f}")
