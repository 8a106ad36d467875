# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map of 4000 x 4000 cells that comes again with a few cells changed, until it can be planned on.

    python benchmarks/changed_maps.py [SIDE]

Without ROS: what `planning` does with the content of the message. The whole map is converted at
once, as the command line does, and by `KeptPlanner`, which keeps the graph; then a patch of 24 x 24
cells is another one in each map, as after a moment of driving. Each in a process of its own: the
peak of its memory is over the two maps that are compared.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from terrains import rolling_terrain

from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.path_requests import KeptPlanner
from heightmap25d_ros.planning.boundary import Boundary
from heightmap25d_ros.planning.graph import transition_graph

SIDE = 4000
PATCH = 24
MAPS = 10


def measure(side: int = SIDE) -> dict[str, float]:
    """CPU [s] and memory [MB]."""
    return {
        f"{name}: {figure}": value
        for name in ("whole", "kept")
        for figure, value in _alone(name, side).items()
    }


def _alone(name: str, side: int) -> dict[str, float]:
    command = [sys.executable, __file__, str(side), name]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return dict(json.loads(done.stdout))


def _whole(side: int) -> dict[str, float]:
    params, maps = Params(), (rolling_terrain(64), rolling_terrain(side))
    transition_graph(maps[0], params.traversability, params.planner)  # compiled
    before, cpu = _begun(), time.process_time()
    transition_graph(maps[1], params.traversability, params.planner)
    return {"CPU [s]": time.process_time() - cpu, "memory [MB]": _peak() - before}


def _kept(side: int) -> dict[str, float]:
    kept, height_map = KeptPlanner(Params(), Boundary.of([])), rolling_terrain(side)
    for small in (rolling_terrain(64), rolling_terrain(64)):  # compiled
        _convert(kept, small)
    before = _begun()
    first = _convert(kept, height_map)
    memory, seconds = _peak() - before, []
    rng = np.random.default_rng(3)
    for iy, ix in rng.integers(0, side - PATCH, (MAPS, 2)):
        height = height_map.height.copy()
        height[iy : iy + PATCH, ix : ix + PATCH] += rng.integers(0, 3, (PATCH, PATCH), np.int16)
        height_map = replace(height_map, height=height)
        seconds.append(_convert(kept, height_map))
    return {
        "first map, CPU [s]": first,
        "first map, memory [MB]": memory,
        "next map, CPU [s]": float(np.median(seconds)),
        "memory [MB]": _peak() - before,
    }


def _convert(kept: KeptPlanner, height_map: HeightMap) -> float:
    cpu = time.process_time()
    with kept.over(height_map):
        return time.process_time() - cpu


def _begun() -> float:
    """Forget the peak of the memory until now; what is resident [MB]."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return _resident("VmRSS")


def _peak() -> float:
    return _resident("VmHWM")


def _resident(name: str) -> float:
    """Resident memory [MB], now or at its peak."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith(name))
    return int(line.split()[1]) * 1024e-6


if __name__ == "__main__":
    side = int(sys.argv[1]) if len(sys.argv) > 1 else SIDE
    if len(sys.argv) > 2:
        print(json.dumps({"whole": _whole, "kept": _kept}[sys.argv[2]](side)))
    else:
        for figure, value in measure(side).items():
            print(f"{figure:30} {value:,.4g}")
