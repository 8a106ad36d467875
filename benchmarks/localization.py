# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Registration of one short-term map against a long-term map, beside other ways to do it.

    python benchmarks/localization.py

A hundred places with boxes, 128 x 128 cells of 0.125 m, heights with 2.5 cm of noise in both
maps; the robot is up to 0.9 m and 9 degrees off. Beside ours:

- brute force: all hypotheses of that window in steps of a quarter of a cell and a quarter of a
  degree, with all cells, by vectorised numpy and by our own kernel. Both are timed on a part of
  their hypotheses and counted up.
- the search of the whole map, and what every hypothesis of it would take in steps of whole cells.
- small_gicp's ICP and GICP of the same cells as points, on one thread, from the same start.
"""

from __future__ import annotations

import statistics
import time

import numpy as np
import small_gicp

from heightmap25d_ros.localization import matching
from heightmap25d_ros.localization.global_search import relocalize
from heightmap25d_ros.localization.matching import Cost, RegistrationPoints
from heightmap25d_ros.localization.registration import register, scale_of, search_points
from heightmap25d_ros.localization.surface import Surface, edges
from heightmap25d_ros.params.sections import RegistrationParams

PLACES = 100
TIMED = 20  # of them
SIDE, CELL, NOISE = 128, 0.125, 0.025
REACH = np.array([0.9, 0.9, np.radians(9.0)])
PRIOR = np.diag((REACH / 3) ** 2)
FINE = np.array([CELL / 4, CELL / 4, np.radians(0.25)])
SAMPLE_NUMPY, SAMPLE_KERNEL = 40, 2000
FAILED = 0.25  # [m]
PARAMS = RegistrationParams()
COST = Cost(PARAMS.clip, PARAMS.unknown, PARAMS.z_range)


def measure() -> dict[str, float]:
    """Times in milliseconds, their ratios, errors."""
    times: dict[str, list[float]] = {}
    errors: dict[str, list[np.ndarray]] = {}
    _ours(*_material(0)[:2])  # compiled, not timed
    for seed in range(PLACES):
        seen, surface, truth = _material(seed)
        _timed(
            times, errors, "ours", truth,
            lambda seen=seen, surface=surface: _ours(seen, surface),
        )  # fmt: skip
        for kind in ("ICP", "GICP"):
            _timed(
                times, errors, kind, truth,
                lambda seen=seen, surface=surface, kind=kind: _icp(seen, surface, kind),
            )  # fmt: skip
        if seed < TIMED:
            times.setdefault("numpy", []).append(_numpy_seconds(seen, surface))
            times.setdefault("kernel", []).append(_kernel_seconds(seen, surface))
            relocalize(seen, surface, PARAMS)  # the pyramid is made
            began = time.perf_counter()
            relocalize(seen, surface, PARAMS)
            times.setdefault("whole map", []).append(time.perf_counter() - began)
            times.setdefault("whole map, all", []).append(_all_seconds(seen, surface))
    middle = {name: 1e3 * statistics.median(values) for name, values in times.items()}
    figures = {f"{name} [ms]": milliseconds for name, milliseconds in middle.items()}
    for name in ("numpy", "kernel", "ICP", "GICP"):
        figures[f"{name} / ours"] = middle[name] / middle["ours"]
    figures["whole map, all / whole map"] = middle["whole map, all"] / middle["whole map"]
    for name, found in errors.items():
        distance = np.hypot(*np.array(found).T[:2])
        yaw = np.degrees(np.abs(np.array(found)[:, 2]))
        figures[f"{name}: median error [m]"] = float(np.median(distance))
        figures[f"{name}: 95 % of errors [m]"] = float(np.percentile(distance, 95))
        figures[f"{name}: median error of yaw [deg]"] = float(np.median(yaw))
        figures[f"{name}: failures"] = int((distance > FAILED).sum())
    return figures


def _timed(times, errors, name, truth, run) -> None:
    began = time.perf_counter()
    offset = run()
    times.setdefault(name, []).append(time.perf_counter() - began)
    errors.setdefault(name, []).append(offset - truth)


def _material(seed: int) -> tuple[RegistrationPoints, Surface, np.ndarray]:
    rng = np.random.default_rng(seed)
    boxes = np.column_stack([
        rng.uniform(-9, 9, (60, 2)), rng.uniform(0.15, 0.7, (60, 2)), rng.uniform(0, np.pi, 60),
        rng.uniform(0.2, 1.0, 60),
    ])  # fmt: skip
    truth = rng.uniform(-REACH, REACH)
    heights = _cells(boxes, np.zeros(3)) + rng.normal(0.0, NOISE, (SIDE, SIDE))
    heights = heights.astype(np.float32)
    surface = Surface(heights, edges(heights, PARAMS.edge_step), (-SIDE * CELL / 2,) * 2, CELL)
    seen = (_cells(boxes, truth) + rng.normal(0.0, NOISE, (SIDE, SIDE))).astype(np.float32)
    axis = (np.arange(SIDE) + 0.5) * CELL - SIDE * CELL / 2
    x, y = np.meshgrid(axis, axis)
    points = RegistrationPoints(
        np.column_stack([x.ravel(), y.ravel(), seen.ravel().astype(np.float64)]),
        edges(seen, PARAMS.edge_step).ravel(),
        np.ones(SIDE * SIDE),
    )
    return points, surface, truth


def _ours(points: RegistrationPoints, surface: Surface) -> np.ndarray:
    return register(points, surface, PRIOR, PARAMS).offset


def _cells(boxes: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """What a map of a robot at a pose holds: the highest of 3 x 3 points of each cell."""
    axis = (np.arange(3 * SIDE) + 0.5) * CELL / 3 - SIDE * CELL / 2
    u, v = np.meshgrid(axis, axis)
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    x, y = pose[0] + cos * u - sin * v, pose[1] + sin * u + cos * v
    top = np.zeros(x.shape)
    for bx, by, half_x, half_y, yaw, height in boxes:
        along = np.cos(yaw) * (x - bx) + np.sin(yaw) * (y - by)
        across = np.cos(yaw) * (y - by) - np.sin(yaw) * (x - bx)
        top[(np.abs(along) < half_x) & (np.abs(across) < half_y) & (top < height)] = height
    return top.reshape(SIDE, 3, SIDE, 3).max(axis=(1, 3))


def _hypotheses() -> int:
    return int(np.prod(2 * np.ceil(REACH / FINE) + 1))


def _numpy_seconds(points: RegistrationPoints, surface: Surface) -> float:
    """The clipped difference of all cells, for all hypotheses."""
    rng = np.random.default_rng(0)
    px, py, pz = points.xyz.T
    began = time.perf_counter()
    for x, y, yaw in rng.uniform(-REACH, REACH, (SAMPLE_NUMPY, 3)):
        cos, sin = np.cos(yaw), np.sin(yaw)
        ix = np.floor((x + cos * px - sin * py) / CELL + SIDE / 2).astype(np.int64)
        iy = np.floor((y + sin * px + cos * py) / CELL + SIDE / 2).astype(np.int64)
        inside = (ix >= 0) & (ix < SIDE) & (iy >= 0) & (iy < SIDE)
        difference = surface.heights[iy[inside], ix[inside]] - pz[inside]
        difference -= np.median(difference)
        np.minimum(np.abs(difference), PARAMS.clip).mean()
    return (time.perf_counter() - began) / SAMPLE_NUMPY * _hypotheses()


def _kernel_seconds(points: RegistrationPoints, surface: Surface) -> float:
    steps = np.arange(-5, 5)
    yaws = np.linspace(-REACH[2], REACH[2], SAMPLE_KERNEL // 100)
    began = time.perf_counter()
    matching.search(points, matching.Window(steps, steps, yaws), surface, COST)
    return (time.perf_counter() - began) / SAMPLE_KERNEL * _hypotheses()


def _all_seconds(points: RegistrationPoints, surface: Surface) -> float:
    """The score of 150 points at every cell, in the yaw steps of the search; one row is timed."""
    few = points.some(search_points(points, 150))
    yaws = np.arange(0.0, 2 * np.pi, 3.0 * scale_of(points, surface)[2])
    window = matching.Window(np.arange(-SIDE // 2, SIDE // 2), np.zeros(1, np.int64), yaws)
    began = time.perf_counter()
    matching.search(few, window, surface, COST)
    return (time.perf_counter() - began) * SIDE


def _icp(points: RegistrationPoints, surface: Surface, kind: str) -> np.ndarray:
    axis = (np.arange(SIDE) + 0.5) * CELL - SIDE * CELL / 2
    x, y = np.meshgrid(axis, axis)
    target = np.column_stack([x.ravel(), y.ravel(), surface.heights.ravel().astype(np.float64)])
    found = small_gicp.align(
        target, points.xyz, registration_type=kind, downsampling_resolution=CELL,
        max_correspondence_distance=1.0, max_iterations=50,
    ).T_target_source  # fmt: skip
    return np.array([found[0, 3], found[1, 3], np.arctan2(found[1, 0], found[0, 0])])


if __name__ == "__main__":
    for name, value in measure().items():
        print(f"{name:40} {value:12.4g}")
