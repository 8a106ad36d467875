# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The table of docs/defaults.md again, for robots with a 3-D lidar or a depth camera instead.

Usage: python studies/measure_clouds.py [--bags DIR] [--seeds N ...] [--camera-seeds N ...]

The same worlds, true poses, default parameters; nothing was chosen on any of these recordings.
With --bags, recordings that are in DIR are taken and the others made there. Markdown to the
terminal.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from measure_defaults import TARGETS, WORLDS, measure, run, text, worst

SENSORS = {"lidar": ("--lidar", 32), "camera": ("--depth-camera",)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bags", type=Path, metavar="DIR", help="where recordings are, or go to")
    parser.add_argument("--seeds", type=int, nargs="*", default=[1, 2, 3], help="with the lidar")
    parser.add_argument("--camera-seeds", type=int, nargs="*", default=[1], help="with the camera")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        bags = options.bags or Path(scratch, "bags")
        bags.mkdir(parents=True, exist_ok=True)
        for sensor, seeds in (("lidar", options.seeds), ("camera", options.camera_seeds)):
            if seeds:
                print(f"\n{sensor}, seeds {', '.join(map(str, seeds))}: the worst of them\n")
                table(bags, Path(scratch, "maps"), sensor, seeds)
    return 0


def table(bags: Path, maps: Path, sensor: str, seeds: list[int]) -> None:
    print(f"| world | {' | '.join(TARGETS)} |")
    print("|---" * (len(TARGETS) + 1) + "|")
    for world in WORLDS:
        figures = []
        for seed in seeds:
            bag = bags / f"{world}_{sensor}_{seed}"
            if not bag.exists():
                run("simulate", world, "--seed", seed, "--true-odometry", *SENSORS[sensor],
                    "-o", bag)  # fmt: skip
            figures.append(measure(bag, maps / bag.name))
        cells = [text(name, worst(name, [f[name] for f in figures])) for name in TARGETS]
        print(f"| `{world}` | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    sys.exit(main())
