# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How early drop-offs are closed, and how much ground is closed that is none.

Usage: python studies/measure_drop_offs.py [--seeds N ...] [--mode must|may] [--lidar]
    [--lost bottoms|patches]

A true rim is a cell of the ground on which the robot drives (connected with its start by steps of
at most max_step) with a neighbour that lies lower by more than that. The robot drives straight at
some of them, within 20 degrees, each time with an empty map, from 2.6 m before the rim to 1 m
before it; with the usual noise and true poses. There, a rim is in sight where a return has come
from it. It is closed where a cell within two cells of it is suspected, or where the map shows the
step. A suspected cell is wrong where no true rim above it is within the reach of a mark.

Beams that return nothing: with ``--lost bottoms`` those that end more than `DEEP` below the rim do
not, as from water; with ``--lost patches`` those do not that end in one of the discs of `PATCH`
radius that cover a tenth of the ground, wherever they are: what is marked there is wrong as well.

Goals: those that are found on the map of a whole drive, without and with suspected drop-offs.
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

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.height_map import Area
from heightmap25d_ros.io import decode, point_cloud
from heightmap25d_ros.mapping import sensor_model
from heightmap25d_ros.mapping.cloud import cloud_beams
from heightmap25d_ros.mapping.drop_offs import DropOffs
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.params.sections import Params, TraversabilityParams
from heightmap25d_ros.pose_interpolation import interpolate
from heightmap25d_ros.simulation import messages
from heightmap25d_ros.simulation.cloud_sensors import Lidar
from heightmap25d_ros.simulation.lasers import DOWN, LEVEL, Laser, RangeNoise, take_scan
from heightmap25d_ros.simulation.recording import world_of
from heightmap25d_ros.simulation.scene import Scene
from heightmap25d_ros.terrain.traversability import OCCUPIED, to_obstacle_map

WORLDS = ("ramp", "street", "rough", "garage")
RESOLUTION = 0.125  # [m]
FROM, NEAR = 2.6, 1.0  # [m] from a rim, of an approach
HALF_WIDTH = 0.4  # [m] of the strip that the robot drives on
SPEED = 0.9  # [m/s]
APPROACHES = 12  # in each world
AROUND = 2  # [cells] of a rim in which a mark closes it
REACH = 2.0  # [m] of a mark beyond its rim
DEEP = 0.2  # [m]
PATCH, PATCHES_APART = 0.4, 2.25  # [m] radius of what swallows light, and of its grid
HEADROOM = 1.0  # [m] above the robot's start below which the ground is looked for
SIDES = [(0, 1), (1, 0), (1, 1), (1, -1)]
WHEELS = np.array([(x, y) for x in (-0.25, 0.25) for y in (-0.28, 0.28)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--mode", choices=("must", "may"), default="may")
    parser.add_argument("--lidar", action="store_true", help="32 rings in place of the lasers")
    parser.add_argument("--lost", choices=("bottoms", "patches"), help="beams without return")
    parser.add_argument("--goals", action="store_true", help="goals of a whole drive, too")
    options = parser.parse_args()
    columns = [
        "world", "rims in sight, deep ones", "suspected", "step seen", "closed by either",
        "deep ones closed", "marked cells", "wrong, of traversable cells", "goals without -> with",
    ]  # fmt: skip
    print(f"| {' | '.join(columns)} |")
    print("|---" * len(columns) + "|")
    for world in WORLDS:
        for seed in options.seeds:
            row = approaches(world, seed, options)
            goals = goals_found(world, seed, options.mode) if options.goals else ""
            print(f"| `{world}`, seed {seed} | {row} | {goals} |", flush=True)


def goals_found(world: str, seed: int, mode: str) -> str:
    """Goals that are found on the map of a whole drive, without and with drop-offs."""
    with tempfile.TemporaryDirectory() as scratch:
        bag, file = Path(scratch, "bag"), Path(scratch, "drop_offs.yaml")
        run("simulate", world, "--seed", seed, "--true-odometry", "-o", bag)
        found = []
        for each in ("none", mode):
            terrain = f"{{drop_offs: {each}}}"
            file.write_text(f"/**: {{ros__parameters: {{traversability: {terrain}}}}}\n")
            figures = measure(bag, Path(scratch, "map"), "--params", file)["goals found"]
            found.append(f"{figures[0]} of {figures[1]}")
    return " -> ".join(found)


def approaches(name: str, seed: int, options: argparse.Namespace) -> str:
    """A row of the table."""
    world = world_of(name, seed)
    scene = world.scene()
    origin, top = surface(scene, world.area)
    terrain = TraversabilityParams(drop_offs=options.mode)
    start = cell_of(np.zeros(2), origin)
    ground = connected(top, terrain.max_step, start)
    rims = ground & (ndimage.minimum_filter(top, 3) < top - terrain.max_step - 1e-6)
    radius = round(REACH / RESOLUTION)
    disc = np.hypot(*np.mgrid[-radius : radius + 1, -radius : radius + 1]) <= radius
    highest = ndimage.grey_dilation(np.where(rims, top, -np.inf), footprint=disc)
    rng = np.random.default_rng([seed, 17])
    outcomes, marked, wrong = [], 0, 0
    for iy, ix, heading in chosen(top, ground, rims, origin, rng):
        rim = origin + RESOLUTION * (np.array([ix, iy]) + 0.5)
        grid = approach(scene, rim, heading, top[iy, ix], terrain, options, rng)
        first_y, first_x = (int(i) for i in grid.geometry.cell_at(origin + 0.5 * RESOLUTION))
        height_map = grid.read(area=Area(first_y, first_x, *top.shape))
        beside = np.s_[iy - AROUND : iy + AROUND + 1, ix - AROUND : ix + AROUND + 1]
        obstacles = to_obstacle_map(height_map, terrain)
        is_in_sight = height_map.known[iy - 1 : iy + 2, ix - 1 : ix + 2].any()
        is_marked = height_map.suspected[beside].any()
        is_seen = (obstacles.occupancy[iy - 1 : iy + 2, ix - 1 : ix + 2] == OCCUPIED).any()
        depth = top[iy, ix] - top[iy - 1 : iy + 2, ix - 1 : ix + 2].min()
        if is_in_sight:
            outcomes.append((is_marked, is_seen, is_marked or is_seen, depth > DEEP))
        marked += int(height_map.suspected.sum())
        wrong += int((height_map.suspected & ~(highest > top + terrain.max_step)).sum())
    found = np.array(outcomes, bool).reshape(-1, 4)
    deep = found[found[:, 3]]
    shares = [f"{column.sum()} of {len(found)}" for column in found[:, :3].T]
    return (
        f"{len(found)}, {len(deep)} | {' | '.join(shares)} | {deep[:, 2].sum()} of {len(deep)} | "
        f"{marked} | {wrong}, {wrong / ground.sum():.2%}"
    )


def surface(scene: Scene, area: tuple) -> tuple[NDArray, NDArray]:
    """Corner (2,) [m] and heights (rows, columns) [m]: the lowest sample of each cell's ground."""
    (x0, x1), (y0, y1) = area
    columns, rows = round((x1 - x0) / RESOLUTION), round((y1 - y0) / RESOLUTION)
    x = x0 + RESOLUTION * (np.arange(columns) + 0.5)
    y = y0 + RESOLUTION * (np.arange(rows) + 0.5)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return np.array([x0, y0]), scene.heights(points).reshape(rows, columns)


def cell_of(position: NDArray, origin: NDArray) -> tuple[int, int]:
    x, y = np.floor((position - origin) / RESOLUTION).astype(int)
    return int(y), int(x)


def connected(top: NDArray, max_step: float, start: tuple[int, int]) -> NDArray[np.bool_]:
    """The cells that steps of at most so much [m] connect with the start."""
    index = np.arange(top.size).reshape(top.shape)
    ends: list[NDArray] = []
    rows, columns = top.shape
    for dy, dx in SIDES:
        here = (slice(0, rows - dy), slice(max(-dx, 0), columns - max(dx, 0)))
        there = (slice(dy, rows), slice(max(dx, 0), columns + min(dx, 0)))
        with np.errstate(invalid="ignore"):
            is_open = np.abs(top[here] - top[there]) <= max_step + 1e-6
        ends.append(np.stack([index[here][is_open], index[there][is_open]]))
    pairs = np.concatenate(ends, axis=1)
    graph = coo_array((np.ones(pairs.shape[1], bool), tuple(pairs)), shape=(top.size,) * 2)
    _, labels = connected_components(graph, directed=False)
    labels = labels.reshape(top.shape)
    return np.asarray(labels == labels[start])


def chosen(top, ground, rims, origin, rng):  # -> (iy, ix, heading [rad])
    """Rims that the robot can drive straight at, on ground as wide as itself."""
    candidates = rng.permutation(np.argwhere(rims))
    count = 0
    steps = np.arange(0.0, FROM + 0.3, RESOLUTION / 2)
    across = np.arange(-HALF_WIDTH, HALF_WIDTH + 1e-9, RESOLUTION / 2)
    for iy, ix in candidates:
        if count == APPROACHES or not (3 < iy < top.shape[0] - 4 and 3 < ix < top.shape[1] - 4):
            continue
        around = top[iy - 1 : iy + 2, ix - 1 : ix + 2]
        dy, dx = np.subtract(np.unravel_index(np.argmin(around), (3, 3)), 1)
        heading = np.arctan2(dy, dx) + rng.uniform(-0.35, 0.35)
        ahead = np.array([np.cos(heading), np.sin(heading)])
        aside = np.array([-ahead[1], ahead[0]])
        rim = origin + RESOLUTION * (np.array([ix, iy]) + 0.5)
        strip = rim - (steps[:, None, None] + 0.2) * ahead + across[:, None] * aside
        x, y = np.floor((strip - origin) / RESOLUTION).astype(int).reshape(-1, 2).T
        if x.min() < 0 or y.min() < 0 or y.max() >= top.shape[0] or x.max() >= top.shape[1]:
            continue
        if (ground & ~rims)[y, x].all():
            count += 1
            yield int(iy), int(ix), float(heading)


def approach(scene, rim, heading, height, terrain, options, rng) -> HeightGrid:
    """The map of a drive at a rim (2,) [m], up to `NEAR`."""
    params, grid = Params(), HeightGrid()
    mapper, drop_offs = Mapper(grid), DropOffs(grid, terrain, params.mapper.probability_threshold)
    sensors = [Lidar(rings=32)] if options.lidar else [LEVEL, DOWN]
    lone = params.mapper.lone_return
    below = height + HEADROOM
    for seconds in np.arange(0.0, (FROM - NEAR) / SPEED, 1.0 / sensors[0].rate):
        for sensor in sensors:
            times = sensor.beam_times(seconds)
            stages = np.linspace(times[0], times[-1] + 1e-9, 5)
            poses = np.stack([standing(scene, rim, heading, below, s) for s in stages])
            T = interpolate(ns(stages), poses, ns(times))
            scan = take_scan(sensor, scene, seconds, T, RangeNoise(), rng)
            scan.ranges[lost(scan.ends, height, options.lost)] = np.inf
            message = messages.scan(sensor, scan)
            mount = sensor.T_base_sensor(np.zeros(1))[0]
            if isinstance(sensor, Laser):
                beams = sensor_model.beams(decode.scan(message), T, mount, params.sensor, lone)
            else:
                cloud = point_cloud.cloud(message)
                knots = cloud.beam_stamps_ns() - cloud.stamp_ns + ns(np.array([seconds]))
                T = interpolate(ns(stages), poses, np.clip(knots, *ns(stages)[[0, -1]]))
                beams = cloud_beams(cloud, T, mount, params.sensor, params.cloud, lone)
            mapper.integrate(beams)
            drop_offs.integrate(beams)
    return grid


def lost(ends: NDArray, height: float, what: str | None) -> NDArray[np.bool_]:
    """Which of the true ends (N, 3) [m] of beams return nothing, at a rim of a height [m]."""
    with np.errstate(invalid="ignore"):
        if what == "bottoms":
            return np.asarray(ends[:, 2] < height - DEEP)
        from_middle = ends[:, :2] - PATCHES_APART * np.round(ends[:, :2] / PATCHES_APART)
        return np.asarray((np.hypot(*from_middle.T) < PATCH) & (what == "patches"))


def ns(seconds: NDArray) -> NDArray[np.int64]:
    return np.rint(seconds * 1e9).astype(np.int64)


def standing(scene: Scene, rim, heading: float, below: float, seconds: float) -> NDArray:
    """Pose (4, 4) on the ground at a time [s] of an approach."""
    ahead = np.array([np.cos(heading), np.sin(heading)])
    aside = np.array([-ahead[1], ahead[0]])
    middle = rim - (FROM - SPEED * seconds) * ahead
    contacts = scene.heights(middle + WHEELS @ np.stack([ahead, aside]), below=below)
    along, across = contacts @ WHEELS / (WHEELS**2).sum(axis=0)
    roll, pitch = np.arctan(across), -np.arctan(along)
    return np.asarray(se3.from_xyz_rpy([*middle, contacts.mean(), roll, pitch, heading]))


if __name__ == "__main__":
    main()
