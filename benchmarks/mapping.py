# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mapper beside OctoMap, numpy and the same work in C, on one stream of scans.

    python benchmarks/mapping.py

Each run starts with an empty map and takes the whole stream in, but for numpy, which is compared
on the first scans. OctoMap gets the same beams, those without return as if they had hit where
they end; with its returns alone it is no faster a beam. Its default keeps the inner nodes of the
tree current; the lazy figure leaves them to a pass at the end, which is not timed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from statistics import median
from typing import Any

import c_mapper
import numpy as np
import numpy_mapper
import octomap
import stream

from heightmap25d_ros.grid.height_grid import HeightGrid
from heightmap25d_ros.grid.height_map import Area
from heightmap25d_ros.mapping.mapper import Mapper
from heightmap25d_ros.mapping.sensor_model import Beams
from heightmap25d_ros.params.sections import LevelsParams, MapperParams, Params

ROUNDS = 3
RUNS = 3  # of the fast ones in a round
NUMPY_SCANS = 300


def measure() -> dict[str, float]:
    """Beams a second of each, medians of interleaved runs, and their ratios."""
    scans = stream.beams(stream.record())
    part = scans[:NUMPY_SCANS]
    _assert_same_maps(scans)
    _assert_alike(part)
    fast: dict[str, Callable[[], float]] = {
        "ours": partial(_rate, scans, Mapper),
        "C": partial(_rate, scans, c_mapper.CMapper),
        "ours, part": partial(_rate, part, Mapper),
        "numpy, part": partial(_rate, part, numpy_mapper.NumpyMapper),
    }
    slow: dict[str, Callable[[], float]] = {
        "OctoMap": partial(_octomap_rate, scans, lazy=False),
        "OctoMap, lazy": partial(_octomap_rate, scans, lazy=True),
    }
    rates: dict[str, list[float]] = {name: [] for name in (*fast, *slow)}
    for _ in range(ROUNDS):
        for runs in (*[fast] * RUNS, slow):
            for name, run in runs.items():
                rates[name].append(run())
    middle = {name: median(values) for name, values in rates.items()}
    return {
        **stream.describe(scans),
        "ours [beams/s]": middle["ours"],
        "C [beams/s]": middle["C"],
        "numpy [beams/s]": middle["numpy, part"],
        "OctoMap [beams/s]": middle["OctoMap"],
        "OctoMap, lazy [beams/s]": middle["OctoMap, lazy"],
        "ours / OctoMap": middle["ours"] / middle["OctoMap"],
        "ours / OctoMap, lazy": middle["ours"] / middle["OctoMap, lazy"],
        "ours / numpy": middle["ours, part"] / middle["numpy, part"],
        "time of ours / time of C": middle["C"] / middle["ours"],
    }


def _rate(scans: Sequence[Beams], kind: Any) -> float:
    params = Params()
    mapper = kind(HeightGrid(params.grid), params.sensor, params.mapper)
    began = time.perf_counter()
    for scan in scans:
        mapper.integrate(scan)
    return _count(scans) / (time.perf_counter() - began)


def _octomap_rate(scans: Sequence[Beams], *, lazy: bool) -> float:
    tree = octomap.OcTree(Params().grid.resolution)
    began = time.perf_counter()
    for scan in scans:
        tree.insertPointCloud(scan.ends, scan.origins[0], lazy_eval=lazy)
    return _count(scans) / (time.perf_counter() - began)


def _count(scans: Sequence[Beams]) -> int:
    return sum(len(scan.ends) for scan in scans)


def _assert_same_maps(scans: Sequence[Beams]) -> None:
    """The C version, which knows one level, makes the same maps of one level, to the bit."""
    params = Params()
    grids = []
    for kind in (Mapper, c_mapper.CMapper):
        grid = HeightGrid(params.grid, levels=LevelsParams(max_surfaces=1))
        mapper = kind(grid, params.sensor, params.mapper)
        for scan in scans:
            mapper.integrate(scan)
        grids.append(grid)
    area = grids[0].observed_area()
    for name in ("height", "probability", "candidate_height", "candidate_probability"):
        ours, theirs = (getattr(grid, name).read(area) for grid in grids)
        np.testing.assert_array_equal(ours, theirs, err_msg=name)
    np.testing.assert_array_equal(grids[0].tile_top, grids[1].tile_top)


def _assert_alike(scans: Sequence[Beams]) -> None:
    """The numpy version makes the map of the literal rule, but for a few cells in a thousand."""
    params = Params(mapper=MapperParams(update_rule="paper"))
    grid = HeightGrid(params.grid)
    ours = Mapper(grid, params.sensor, params.mapper)
    theirs = numpy_mapper.NumpyMapper(grid, params.sensor, params.mapper)
    for scan in scans:
        ours.integrate(scan)
        theirs.integrate(scan)
    side = numpy_mapper.SIDE
    iy, ix = (grid.geometry.cell_at((0.0, 0.0)) - side // 2).tolist()
    threshold = params.mapper.probability_threshold
    expected = grid.read(threshold, Area(iy, ix, side, side))
    is_known = theirs.probability >= threshold
    is_same = (is_known == expected.known) & (~is_known | (theirs.height == expected.height))
    share = is_same[is_known | expected.known].mean()
    if share < 0.99:
        raise AssertionError(f"numpy's map is the mapper's in {share:.1%} of the cells only")


if __name__ == "__main__":
    for figure, value in measure().items():
        print(f"{figure:28} {value:,.4g}")
