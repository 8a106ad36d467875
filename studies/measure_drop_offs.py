# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How early drop-offs are closed, and how much ground is closed that is none.

Usage: python studies/measure_drop_offs.py [--bags DIR] [--seeds N ...] [--mode must|may] [--lidar]

A true rim is a cell of the ground on which the robot drives (connected by steps of at most
max_step) with a neighbour that lies lower by more than that. When the robot first comes within a
metre of it, it is closed where a cell within two cells of it is suspected, or where the step has
been seen. Rims that no return has met by then are out of sight, and so are those that the robot
never comes near to. A suspected cell is wrong where no such rim is within the reach of a mark.
Markdown to the terminal.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from measure_defaults import measure, run
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from heightmap25d_ros.grid.height_map import Area
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import feed, with_sources
from heightmap25d_ros.terrain.traversability import OCCUPIED, to_obstacle_map

WORLDS = ("ramp", "street", "rough", "garage")
NEAR = 1.0  # [m] from a rim
AROUND = 2  # [cells] of a rim in which a mark closes it
REACH = 2.0  # [m] of a mark beyond its rim
EVERY = 8  # scans from one look at the map to the next
SIDES = [(0, 1), (1, 0), (1, 1), (1, -1)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bags", type=Path, metavar="DIR", help="where recordings are, or go to")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--mode", choices=("must", "may"), default="must")
    parser.add_argument("--lidar", action="store_true", help="32 rings in place of the lasers")
    options = parser.parse_args()
    print("| world | rims in sight | suspected | step seen | closed by either | marked cells | "
          "wrong, of traversable cells | goals found without -> with |")  # fmt: skip
    print("|---" * 8 + "|")
    with tempfile.TemporaryDirectory() as scratch:
        bags = options.bags or Path(scratch)
        for world in WORLDS:
            for seed in options.seeds:
                suffix = "_lidar" if options.lidar else ""
                bag = bags / f"{world}{suffix}_{seed}"
                if not bag.exists():
                    sensors = ("--lidar", 32) if options.lidar else ()
                    run("simulate", world, "--seed", seed, "--true-odometry", *sensors, "-o", bag)
                row = drive(bag, options.mode)
                goals = [found(bag, Path(scratch), mode) for mode in ("none", options.mode)]
                print(f"| `{world}`, seed {seed} | {row} | {goals[0]} -> {goals[1]} |", flush=True)


def found(bag: Path, scratch: Path, mode: str) -> str:
    """Goals that are found on the map of the whole drive."""
    file = scratch / "drop_offs.yaml"
    terrain = f"{{drop_offs: {mode}}}"
    file.write_text(f"/**: {{ros__parameters: {{traversability: {terrain}}}}}\n")
    truth = "--odom-topic", "/ground_truth"
    figures = measure(bag, scratch / "map", "--params", file, *truth)["goals found"]
    return f"{figures[0]} of {figures[1]}"


def drive(path: Path, mode: str) -> str:
    """A row of the table."""
    with np.load(path / "truth" / "surface.npz") as truth:
        top = truth["top"].astype(np.float64)
        origin, resolution = truth["origin"], float(truth["resolution"])
    with Bag(path) as bag:
        settings = with_sources(Params(), [bag])
        settings = with_values(settings, {"traversability.drop_offs": mode})
        mapping = Mapping(settings)
        max_step = settings.traversability.max_step
        topics = [*settings.intake.source_topics, "/ground_truth", "/tf_static"]
        rims: NDArray | None = None
        count = 0
        ever = np.zeros(top.shape, bool)
        outcome = np.zeros(top.shape, int)  # bits: in sight, suspected, step seen
        is_done = np.zeros(top.shape, bool)
        x, y = (origin[i] + resolution * (np.arange(top.shape[1 - i]) + 0.5) for i in (0, 1))
        for event in bag.events(topics):
            for reading in feed(mapping, event.topic, event.message, "/ground_truth"):
                position = reading.T_map_base[0, :2, 3]
                if rims is None:
                    ground = connected(top, max_step, cell_of(position, origin, resolution))
                    rims = ground & (lowest_beside(top) < top - max_step - 1e-6)
                count += 1
                near = (x - position[0]) ** 2 + (y[:, None] - position[1]) ** 2 <= NEAR**2
                fresh = near & rims & ~is_done
                if not fresh.any() and count % EVERY:
                    continue
                iy, ix = mapping.grid.geometry.cell_at(origin + 0.5 * resolution)
                area = Area(int(iy), int(ix), *top.shape)
                height_map = mapping.grid.read(settings.mapper.probability_threshold, area)
                ever |= height_map.suspected
                if fresh.any():
                    closed = ndimage.maximum_filter(height_map.suspected, 2 * AROUND + 1)
                    obstacles = to_obstacle_map(height_map, settings.traversability)
                    seen = ndimage.maximum_filter(obstacles.occupancy == OCCUPIED, 3)
                    known = ndimage.maximum_filter(height_map.known, 3)
                    state = known * 1 + closed * 2 + seen * 4
                    outcome[fresh] = state[fresh]
                    is_done |= fresh
    assert rims is not None
    in_sight = outcome[is_done & (outcome & 1 > 0)]
    is_marked, is_seen = in_sight & 2 > 0, in_sight & 4 > 0
    radius = round(REACH / resolution)
    disc = np.hypot(*np.mgrid[-radius : radius + 1, -radius : radius + 1]) <= radius
    highest = ndimage.grey_dilation(np.where(rims, top, -np.inf), footprint=disc)
    wrong = ever & ~(highest > top + max_step)
    share = wrong.sum() / ground.sum()
    total = max(len(in_sight), 1)
    return (
        f"{len(in_sight)} | {is_marked.mean() if total else 0:.1%} | {is_seen.mean():.1%} | "
        f"{(is_marked | is_seen).mean():.1%} | {ever.sum()} | {wrong.sum()}, {share:.2%}"
    )


def cell_of(position: NDArray, origin: NDArray, resolution: float) -> tuple[int, int]:
    x, y = ((position - origin) / resolution).astype(int)
    return int(y), int(x)


def connected(top: NDArray, max_step: float, start: tuple[int, int]) -> NDArray[np.bool_]:
    """The cells that steps of at most so much [m] connect with the start."""
    index = np.arange(top.size).reshape(top.shape)
    ends: list[NDArray] = []
    for dy, dx in SIDES:
        rows, columns = top.shape
        here = (slice(0, rows - dy), slice(max(-dx, 0), columns - max(dx, 0)))
        there = (slice(dy, rows), slice(max(dx, 0), columns + min(dx, 0)))
        is_open = np.abs(top[here] - top[there]) <= max_step + 1e-6
        ends.append(np.stack([index[here][is_open], index[there][is_open]]))
    pairs = np.concatenate(ends, axis=1)
    graph = coo_array((np.ones(pairs.shape[1], bool), tuple(pairs)), shape=(top.size,) * 2)
    _, labels = connected_components(graph, directed=False)
    labels = labels.reshape(top.shape)
    return np.asarray(labels == labels[start])


def lowest_beside(top: NDArray) -> NDArray:
    return np.asarray(ndimage.minimum_filter(top, 3))


if __name__ == "__main__":
    main()
