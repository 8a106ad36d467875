# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mapper beside OctoMap, numpy and the same work in C, on one stream of scans."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

import c_mapper
import numpy as np
import numpy_mapper
import octomap
import stream

from heightmap25d_ros.grid import HeightGrid
from heightmap25d_ros.mapper import Mapper
from heightmap25d_ros.params import Params
from heightmap25d_ros.sensor import Beams

REPEATS = 5
OCTOMAP_SLICES = (0, 1000, 2000)
OCTOMAP_SLICE = 20  # scans of each slice; the ones before it, thinned, are in the tree already
OCTOMAP_THINNED = 20


def measure() -> dict[str, float]:
    """Beams a second of each, medians of interleaved runs."""
    scans = stream.beams(stream.record())
    facts = stream.describe(scans)
    numpy_part = scans[: len(scans) // 10]
    runs: dict[str, Callable[[], float]] = {
        "ours": lambda: _rate(scans, Mapper),
        "ours, the part": lambda: _rate(numpy_part, Mapper),
        "C": lambda: _rate(scans, c_mapper.CMapper),
        "numpy, the part": lambda: _rate(numpy_part, numpy_mapper.NumpyMapper),
    }
    _assert_same_maps(scans)
    rates: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(REPEATS):
        for name, run in runs.items():
            rates[name].append(run())
    middle = {name: median(values) for name, values in rates.items()}
    octomap_rate = median(_octomap_rates(scans))
    return {
        **facts,
        "ours [beams/s]": middle["ours"],
        "C [beams/s]": middle["C"],
        "numpy [beams/s]": middle["numpy, the part"],
        "OctoMap [beams/s]": octomap_rate,
        "ours / OctoMap": middle["ours"] / octomap_rate,
        "ours / numpy": middle["ours, the part"] / middle["numpy, the part"],
        "time of ours / time of C": middle["C"] / middle["ours"],
    }


def _rate(scans: Sequence[Beams], kind: Any) -> float:
    params = Params()
    mapper = kind(HeightGrid(params.grid), params.sensor, params.mapper)
    began = time.perf_counter()
    for scan in scans:
        mapper.integrate(scan)
    return sum(len(scan.ends) for scan in scans) / (time.perf_counter() - began)


def _assert_same_maps(scans: Sequence[Beams]) -> None:
    """The C version does the same work, to the bit."""
    params = Params()
    grids = []
    for kind in (Mapper, c_mapper.CMapper):
        grid = HeightGrid(params.grid)
        mapper = kind(grid, params.sensor, params.mapper)
        for scan in scans:
            mapper.integrate(scan)
        grids.append(grid)
    area = grids[0].observed_area()
    for name in ("height", "probability", "candidate_height", "candidate_probability"):
        ours, theirs = (getattr(grid, name).read(area) for grid in grids)
        np.testing.assert_array_equal(ours, theirs, err_msg=name)
    np.testing.assert_array_equal(grids[0].tile_top, grids[1].tile_top)


def _octomap_rates(scans: Sequence[Beams]) -> list[float]:
    """Of slices of the stream, each inserted into a tree of what came before."""
    tree = octomap.OcTree(Params().grid.resolution)
    rates = []
    done = 0
    for start in OCTOMAP_SLICES:
        for scan in scans[done:start:OCTOMAP_THINNED]:
            _insert(tree, scan)
        part = scans[start : start + OCTOMAP_SLICE]
        began = time.perf_counter()
        for scan in part:
            _insert(tree, scan)
        rates.append(sum(len(scan.ends) for scan in part) / (time.perf_counter() - began))
        done = start + OCTOMAP_SLICE
    return rates


def _insert(tree: Any, scan: Beams) -> None:
    tree.insertPointCloud(scan.ends, scan.origins[0])


if __name__ == "__main__":
    for figure, value in measure().items():
        print(f"{figure:28} {value:,.4g}")
