# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""All measurements, as a table with their targets and as out/bench.json: `make bench`."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import tempfile
from importlib.metadata import version
from pathlib import Path

import changed_maps
import clouds
import clouds_node
import conversion
import exploration
import fast_lasers
import localization
import localization_node
import map_updates
import mapping
import memory
import messages
import node
import numba
import numpy as np
import own_map_nodes
import planning
import planning_node

ROOT = Path(__file__).parent.parent
OUT = ROOT / "out" / "bench.json"
PEERS = ("octomap-python", "rosbags", "pyastar2d", "scikit-image", "small_gicp")

# Of a section's figures: at least or at most so much.
TARGETS = {
    ("mapping", "ours / OctoMap"): (">=", 100.0),
    ("mapping", "ours / numpy"): (">=", 15.0),
    ("mapping", "time of ours / time of C"): ("<=", 1.25),
    ("clouds", "default: decode + merge p99 [ms]"): ("<=", 60.0),
    ("clouds", "default: points/s"): (">=", 2.6e6),
    ("conversion", "scipy_max_min_per_step_obstacles"): (">=", 50.0),
    ("conversion", "step_obstacles_per_one_pass"): ("<=", 4.0),
    ("conversion", "convert_per_update_block"): (">=", 80.0),
    ("clouds node", "clouds not merged"): ("<=", 1.0),
    ("clouds node", "messages dropped"): ("<=", 0.0),
    ("node", "nobody listens: scans not merged"): ("<=", 1.0),
    ("node", "nobody listens: messages dropped"): ("<=", 0.0),
    ("node", "four maps at 2 Hz: scans not merged"): ("<=", 1.0),
    ("node", "four maps at 2 Hz: messages dropped"): ("<=", 0.0),
    ("node", "fast lasers: CPU [s per s]"): ("<=", 0.25),
    ("node", "fast lasers: latency p99 [ms]"): ("<=", 60.0),
    ("node", "fast lasers: scans not merged"): ("<=", 1.0),
    ("fast lasers", "CPU [s per s]"): ("<=", 0.25),
    ("fast lasers", "scans not merged"): ("<=", 1.0),
    ("command line", "real_time_factor"): (">=", 80.0),
    ("command line", "scan_p95_ms"): ("<=", 0.3),
    ("memory", "ramp_numbers"): ("<=", 32_768),
    ("memory", "ramp_numbers_3d"): (">=", 262_144),
    **{
        ("planning", f"{kind} {side}: {ratio}"): bound
        for kind in planning.KINDS
        for side in planning.ROUNDS
        for ratio, bound in (
            ("pyastar2d / ours", (">=", 1.5)),
            ("MCP_Geometric / ours", (">=", 8.0)),
            ("ours / C", ("<=", 1.3)),
        )
    },
    ("planning", "median of maps: pyastar2d / ours"): (">=", 2.0),
    ("localization", "numpy / ours"): (">=", 50.0),
    ("localization", "kernel / ours"): (">=", 8.0),
    ("localization", "ICP / ours"): (">=", 10.0),
    ("localization", "ours: median error [m]"): ("<=", 0.03),
    ("localization", "ours: 95 % of errors [m]"): ("<=", 0.06),
    ("localization", "ours: median error of yaw [deg]"): ("<=", 0.2),
    ("localization", "ours: failures"): ("<=", 0.0),
    ("localization node", "not tracking at the end"): ("<=", 0.0),
    ("exploration", "512^2: decision p95 [ms]"): ("<=", 50.0),
    ("exploration", "2048^2: decision p95 [ms]"): ("<=", 250.0),
    ("planning node", "goals without a path"): ("<=", 0.0),
}


def main() -> None:
    figures = {
        "machine": machine(),
        "mapping": mapping.measure(),
        "clouds": clouds.measure(),
        "conversion": conversion.measure(),
        "memory": memory.measure(),
        "planning": planning.measure(),
        "localization": localization.measure(),
        "exploration": exploration.measure(),
        "fast lasers": fast_lasers.measure(),
        "node": node.measure(),
        "clouds node": clouds_node.measure(),
        "planning node": planning_node.measure(),
        "changed maps": changed_maps.measure(),
        "localization node": localization_node.measure(),
        "own-map nodes": own_map_nodes.measure(),
        "map updates": map_updates.measure(),
        "messages": messages.measure(),
        "command line": command_line(),
    }
    OUT.parent.mkdir(exist_ok=True)
    OUT.write_text(json.dumps(figures, indent=2) + "\n")
    for section, values in figures.items():
        print(f"\n{section}")
        for name, value in values.items():
            text = f"{value:,.4g}" if isinstance(value, float) else f"{value}"
            print(f"  {name:48} {text:>16}  {verdict(section, name, value)}")


def verdict(section: str, name: str, value: float) -> str:
    if (section, name) not in TARGETS:
        return ""
    relation, bound = TARGETS[section, name]
    is_met = value >= bound if relation == ">=" else value <= bound
    return f"{relation} {bound:g}: {'met' if is_met else 'MISSED'}"


def machine() -> dict[str, str]:
    info = Path("/proc/cpuinfo").read_text()
    model = next(line for line in info.splitlines() if line.startswith("model name"))
    return {
        "processor": model.partition(":")[2].strip(),
        "cores": str(os.cpu_count()),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "cc": subprocess.check_output(["cc", "--version"], text=True).partition("\n")[0],
        **{package: version(package) for package in PEERS},
    }


def command_line() -> dict[str, float]:
    """`heightmap25d map` on the project's bag."""
    with tempfile.TemporaryDirectory() as directory:
        command = ["heightmap25d", "map", ROOT / "bags" / "ramp", "--json", "-o"]
        done = subprocess.run(
            [*command, Path(directory) / "map"], check=True, capture_output=True, text=True
        )
    figures = json.loads(done.stdout)
    names = ("real_time_factor", "scan_p50_ms", "scan_p95_ms", "scan_p99_ms")
    return {name: float(figures[name]) for name in names}


if __name__ == "__main__":
    main()
