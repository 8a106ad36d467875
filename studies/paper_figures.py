# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures 1 and 2 of the paper with this package: pictures into docs/, numbers to the terminal.

Usage: python studies/paper_figures.py fig1|fig2 [DIRECTORY]

docs/paper.md tells what they show. Needs pyoctomap (requirements/bench.txt).
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import paper_pictures
from evidence_grid import EvidenceGrid
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.errors import InputError
from heightmap25d_ros.evaluation.truth import read_truth
from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, Area, Geometry, HeightMap
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.mapping import sensor_model
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.scan import Scan
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import GridParams, MapperParams, Params, SensorParams
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import feed
from heightmap25d_ros.terrain.traversability import blocked_transitions, to_obstacle_map
from heightmap25d_ros.viz import map_figures

ROOT = Path(__file__).resolve().parent.parent
MAX_STEP = 10  # [cm] that the robot climbs

# Figure 1
LASER = (0.0, 0.02, 0.6)  # [m], away from the borders of cells
BOX_X = (1.02, 1.38)  # [m]
BOX_HEIGHT, GROUND = 0.15, 0.03  # [m] of the box above the ground, of that above ground zero
HEIGHTS = np.arange(1, 26) / 100.0  # [m] of boxes that are tried
GROUNDS = 20  # heights of the ground within a layer at which each is tried
RESOLUTIONS = (0.125, 0.1, 0.05)  # [m] of the evidence grids

# Figure 2
BAG = ROOT / "bags" / "ramp"
COARSE = 0.125  # [m]
PAPER_LAYERS = 16
LOWEST = -COARSE / 2  # [m] where a layer begins: flat ground at 0 lies in the middle of one
RAMP_X, RAMP_Y = (4.0, 16.0), (-1.375, 1.375)  # [m] the ramp without its kerb and its cliff
PART_X, PART_Y = (5.5, 12.0), (-1.75, 2.0)  # [m] what is drawn of the evidence grid


def main(arguments: list[str]) -> int:
    figures = {"fig1": fig1, "fig2": fig2}
    if not 1 <= len(arguments) <= 2 or arguments[0] not in figures:
        print("usage: python studies/paper_figures.py fig1|fig2 [DIRECTORY]", file=sys.stderr)
        return 2
    try:
        directory = Path(arguments[1]) if len(arguments) > 1 else ROOT / "docs"
        directory.mkdir(parents=True, exist_ok=True)
        print(json.dumps(figures[arguments[0]](directory), indent=2, ensure_ascii=False))
    except InputError as error:
        print(f"paper_figures: {error}", file=sys.stderr)
        return 2
    return 0


def fig1(directory: Path) -> dict:
    """The hidden obstacle: one example, and how often boxes of every height are hidden."""
    cubes, coarse = evidence_of_box(0.1, GROUND, BOX_HEIGHT)
    heights = height_map_of_box(GROUND, BOX_HEIGHT)
    hidden = {f"3-D, {r:g} m": share_hidden(r) for r in RESOLUTIONS}
    hidden["2½-D"] = share_hidden(None)
    paper_pictures.hidden_obstacle(
        directory / "paper_fig1.png",
        paper_pictures.Box(x=BOX_X, ground=GROUND, height=BOX_HEIGHT),
        cubes,
        (coarse, heights),
        (HEIGHTS, hidden),
    )
    return {
        "box [m]": BOX_HEIGHT,
        "3-D step [m]": largest_step(coarse),
        "3-D blocked": is_blocked(coarse),
        "2 1/2-D step [m]": largest_step(heights),
        "2 1/2-D blocked": is_blocked(heights),
        "highest hidden box [m]": {
            name: float(HEIGHTS[np.flatnonzero(share)[-1]]) for name, share in hidden.items()
        },
        "share of ground heights that hide the box": {
            name: float(share[np.searchsorted(HEIGHTS, BOX_HEIGHT - 1e-9)])
            for name, share in hidden.items()
        },
    }


def beams_on_box(ground: float, height: float) -> Beams:
    """Returns without noise of a laser that looks down along x, up to the back edge of a box."""
    below = np.radians(np.arange(15.0, 60.0, 0.1))
    ahead, down = np.cos(below), np.sin(below)
    to_ground, to_top = ((LASER[2] - z) / down for z in (ground, ground + height))
    to_face = BOX_X[0] / ahead
    to_box = np.where(to_face * down > LASER[2] - ground - height, to_face, to_top)
    reach = np.where(to_ground * ahead < BOX_X[0], to_ground, to_box)
    scan = Scan(
        stamp_ns=0,
        frame_id="laser",
        angle_min=below[0],
        angle_increment=below[1] - below[0],
        time_increment=0.0,
        range_min=0.0,
        range_max=30.0,
        ranges=np.where(reach * ahead < BOX_X[1], reach, np.nan).astype(np.float32),
    )
    T_map_laser = se3.from_xyz_rpy([[*LASER, -np.pi / 2, 0.0, 0.0]])  # scans x and z
    return sensor_model.beams(scan, T_map_laser, np.eye(4)[None], SensorParams())


def evidence_of_box(resolution: float, ground: float, height: float) -> tuple[NDArray, HeightMap]:
    """Occupied cubes (N, 3) and heights of a row of cells along x."""
    columns = int(np.ceil(BOX_X[1] / resolution))
    geometry = Geometry(resolution=resolution, origin=(0.0, 0.0), shape=(1, columns))
    grid = EvidenceGrid(resolution)
    grid.insert(beams_on_box(ground, height))
    return grid.occupied(geometry), grid.height_map(geometry)


def height_map_of_box(ground: float, height: float) -> HeightMap:
    """The same row of cells of 0.1 m in the 2 1/2-D map."""
    grid = HeightGrid(GridParams(resolution=0.1, extent=8.0))
    Mapper(grid, SensorParams(), MapperParams()).integrate(beams_on_box(ground, height))
    iy, ix = (int(index) for index in grid.geometry.cell_at(LASER[:2]))
    columns = int(np.ceil(BOX_X[1] / 0.1))
    return grid.read(MapperParams().probability_threshold, Area(iy, ix, 1, columns))


def share_hidden(resolution: float | None) -> NDArray[np.float64]:
    """For each of `HEIGHTS`: at how many heights of the ground nothing is blocked, as a share.

    In an evidence grid of this resolution, or in the 2 1/2-D map.
    """
    period = resolution or 0.1
    grounds = (np.arange(GROUNDS) + 0.5) * period / GROUNDS
    hidden = np.zeros((len(HEIGHTS), GROUNDS), bool)
    for index in np.ndindex(hidden.shape):
        ground, height = grounds[index[1]], HEIGHTS[index[0]]
        heights = (
            evidence_of_box(resolution, ground, height)[1]
            if resolution
            else height_map_of_box(ground, height)
        )
        hidden[index] = not is_blocked(heights)
    return hidden.mean(axis=1)


def is_blocked(heights: HeightMap) -> bool:
    return bool(blocked_transitions(heights.height, heights.known, MAX_STEP).any())


def largest_step(heights: HeightMap) -> float:
    row = heights.height[heights.known].astype(int)
    return round(float(np.abs(np.diff(row)).max() * HEIGHT_RESOLUTION), 2)


@dataclass(frozen=True)
class Drive:
    """What one drive gives."""

    beams: list[Beams]
    trajectory: NDArray[np.float64]  # (N, 3) [m], map
    heights: HeightMap


def fig2(directory: Path) -> dict:
    """One pass down the ramp: 3-D evidence grid, 2 1/2-D map, converted maps."""
    grid = EvidenceGrid(COARSE, LOWEST)
    truth = read_truth(BAG / "truth" / "surface.npz")
    settings = Params()
    drive = map_bag(settings)
    for beams in drive.beams:
        grid.insert(beams)
    heights, geometry = drive.heights, drive.heights.geometry
    cubes, coarse = grid.occupied(geometry), grid.height_map(geometry)

    converted = to_obstacle_map(heights, settings.traversability)
    pictures = [directory / f"paper_fig2{part}.png" for part in ("b", "c", "d", "d_evidence_grid")]
    part = area(geometry, PART_X, PART_Y)
    paper_pictures.cubes(pictures[0], cubes, LOWEST, geometry.part(part), part, drive.trajectory)
    map_figures.blocks(pictures[1], heights, drive.trajectory)
    map_figures.obstacle_map(pictures[2], converted, drive.trajectory)
    map_figures.obstacle_map(
        pictures[3], to_obstacle_map(coarse, settings.traversability), drive.trajectory
    )
    row = int(geometry.cell_at((0.0, 0.0))[0])
    paper_pictures.profile(
        directory / "paper_fig2_profile.png",
        cubes[cubes[:, 1] == row][:, ::2], LOWEST, heights, truth.top[row], drive.trajectory,
    )  # fmt: skip
    for picture in pictures:
        paper_pictures.shrink(picture)

    layers = int(np.ptp(cubes[:, 2])) + 1
    return {
        "cells": list(geometry.shape[::-1]),
        "numbers in the 2 1/2-D map": heights.height.size + heights.probability.size,
        "bytes in the 2 1/2-D map": heights.height.nbytes + heights.probability.nbytes,
        "numbers in a 3-D grid of 16 layers": geometry.shape[0] * geometry.shape[1] * PAPER_LAYERS,
        "layers that our place needs": layers,
        "numbers in a 3-D grid of these": geometry.shape[0] * geometry.shape[1] * layers,
        "nodes of the octree": grid.tree.size(),
        "bytes of the octree": grid.tree.memoryUsage(),
        "on the ramp": on_ramp(coarse, heights, truth.top),
    }


def map_bag(settings: Params) -> Drive:
    with Bag(BAG) as bag:
        topics = bag.scan_topics()
        mapping = Mapping(with_values(settings, {"intake.scan_topics": topics}))
        readings = []
        for event in bag.events([*topics, "/odom", "/tf_static"]):
            readings += feed(mapping, event.topic, event.message)
        readings += mapping.flush()
    return Drive(
        beams=[reading.beams(settings) for reading in readings],
        trajectory=np.array([r.T_map_base[0, :3, 3] for r in readings]),
        heights=mapping.maps()[0],
    )


def on_ramp(coarse: HeightMap, heights: HeightMap, top: NDArray[np.float64]) -> dict:
    """Steps between neighbours on the smooth ramp that both maps know, and errors of height."""
    geometry = heights.geometry
    inside = area(geometry, RAMP_X, RAMP_Y).slices(Area(0, 0, *geometry.shape))
    known = coarse.known[inside] & heights.known[inside]
    true = top[inside]
    counted = {
        "cells": int(known.sum()),
        # Between known cells every step is higher than -1.
        "transitions": blocked_pairs(np.zeros_like(heights.height[inside]), known, -1),
    }
    for name, stored in (
        ("true", np.floor(100 * true + 0.5).astype(np.int16)),
        ("3-D", coarse.height[inside]),
        ("2 1/2-D", heights.height[inside]),
    ):
        error = np.abs(stored * HEIGHT_RESOLUTION - true)[known]
        counted[name] = {
            "blocked": blocked_pairs(stored, known, MAX_STEP),
            "error p95 [m]": round(float(np.percentile(error, 95)), 3),
            "error max [m]": round(float(error.max()), 3),
        }
    return counted


def blocked_pairs(height: NDArray[np.int16], known: NDArray[np.bool_], max_step: int) -> int:
    """Pairs of neighbours, each once, that differ by more than a step [cm]."""
    return int(np.unpackbits(blocked_transitions(height, known, max_step)).sum()) // 2


def area(geometry: Geometry, x: tuple[float, float], y: tuple[float, float]) -> Area:
    (iy, ix), (end_y, end_x) = geometry.cell_at([(x[0], y[0]), (x[1], y[1])])
    return Area(int(iy), int(ix), int(end_y - iy), int(end_x - ix))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
