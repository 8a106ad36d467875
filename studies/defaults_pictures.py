# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pictures of docs/defaults.md: cells where the default misses a target."""

from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from heightmap25d_ros.evaluation.goal_reachability import evaluate_goals
from heightmap25d_ros.evaluation.map_error import LARGE_ERROR
from heightmap25d_ros.evaluation.truth import GoalPairs, read_goals, read_truth
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, Geometry, HeightMap
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.terrain.traversability import INFLATED, ObstacleMap, to_obstacle_map

SETTINGS = Params()
CLIMB = SETTINGS.traversability.max_step
FALSE, MISSED, UNKNOWN = "#d62728", "#1f5fd6", "#e4e4e4"


@dataclass(frozen=True)
class Case:
    """A map and the truth, on the cells of the truth; heights [m], NaN: unknown."""

    geometry: Geometry
    height: NDArray
    seen: NDArray
    top: NDArray


def draw(bags: Path, maps: Path, directory: Path) -> None:
    directory.mkdir(parents=True, exist_ok=True)
    mpl.rcParams.update({"font.size": 8, "axes.titlesize": 9, "image.interpolation": "nearest"})
    tops(directory / "defaults_tops.png", case(bags, maps, "street_1"))
    transitions(directory / "defaults_street.png", case(bags, maps, "street_1"),
                ((22.0, 25.6), (-5.4, -4.4)), (0.0, 2.0))  # fmt: skip
    transitions(directory / "defaults_rough.png", case(bags, maps, "rough_3"),
                ((15.0, 19.0), (6.0, 8.6)), None)  # fmt: skip
    goals(directory / "defaults_goals.png", bags / "moving_2", maps / "moving_2_candidate")


def case(bags: Path, maps: Path, drive: str) -> Case:
    truth = read_truth(bags / drive / "truth" / "surface.npz")
    stored = map_directory.load(maps / f"{drive}_candidate", SETTINGS.mapper.probability_threshold)
    height = on_cells_of(truth.geometry, stored.height_map)
    return Case(truth.geometry, height, truth.seen, truth.top)


def on_cells_of(geometry: Geometry, height_map: HeightMap) -> NDArray:
    """Heights [m] of a map on other cells of the same lattice; NaN where unknown."""
    rows, columns = np.indices(geometry.shape)
    cells = height_map.geometry.cell_at(geometry.cell_center(np.stack([rows, columns], axis=-1)))
    heights = height_map.metres
    inside = height_map.geometry.contains(cells)
    result = np.full(geometry.shape, np.nan)
    result[inside] = heights[cells[inside][:, 0], cells[inside][:, 1]]
    return result


def wrong(case: Case) -> tuple[list, list]:
    """Borders (as lines [m]) of false and of missed blocked transitions, those along x and y.

    By the rule of `evaluation`: one has its like in the other map within a cell.
    """
    rows, columns = case.top.shape
    places = {key: np.zeros((2 * rows + 1, 2 * columns + 1), bool) for key in ("map", "truth")}
    steps = []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = np.s_[: rows - dy, max(-dx, 0) : columns - max(dx, 0)]
        there = np.s_[dy:, max(dx, 0) : columns + min(dx, 0)]
        y, x = np.mgrid[here]
        with np.errstate(invalid="ignore"):
            predicted = np.abs(case.height[there] - case.height[here]) > CLIMB + 1e-6
            true = np.abs(case.top[there] - case.top[here]) > CLIMB
        places["map"][2 * y + 1 + dy, 2 * x + 1 + dx] |= predicted
        places["truth"][2 * y + 1 + dy, 2 * x + 1 + dx] |= true
        known = np.isfinite(case.height[here]) & np.isfinite(case.height[there])
        steps.append((2 * y + 1 + dy, 2 * x + 1 + dx, dy, dx, predicted, true & known))
    near = {key: maximum_filter(at, size=5) for key, at in places.items()}
    false, missed = [], []
    for y, x, dy, dx, predicted, true in steps:
        for lines, chosen, other in ((false, predicted, "truth"), (missed, true, "map")):
            for row, column in zip(*np.nonzero(chosen & ~near[other][y, x]), strict=True):
                at = np.array([x[row, column], y[row, column]]) / 2
                half = np.array([dy, -dx]) / (2.0 if dx * dy == 0 else 4.0)
                ends = np.stack([at - half, at + half]) * case.geometry.resolution
                lines.append(ends + case.geometry.origin)
    return false, missed


def show(axes: Axes, geometry: Geometry, image: NDArray, **options: object) -> mpl.image.AxesImage:
    (x, y), (rows, columns) = geometry.origin, geometry.shape
    extent = (x, x + columns * geometry.resolution, y, y + rows * geometry.resolution)
    axes.set_facecolor(UNKNOWN)
    return axes.imshow(image, origin="lower", extent=extent, **options)


def transitions(path: Path, case: Case, area: tuple, span: tuple | None) -> None:
    """Heights of map and lasers, and the wrong transitions on both."""
    (x0, x1), (y0, y1) = area
    low = case.geometry.cell_at((x0, y0))
    high = case.geometry.cell_at((x1, y1))
    part = case.seen[low[0] : high[0], low[1] : high[1]]
    low_z, high_z = span or (np.nanmin(part), np.nanpercentile(part, 97))
    is_wide = x1 - x0 > 3 * (y1 - y0)
    figure, panels = plt.subplots(
        *((3, 1) if is_wide else (1, 3)),
        figsize=(8, 5.6) if is_wide else (10, 3.4),
        sharex=True,
        sharey=True,
        layout="constrained",
    )
    false, missed = wrong(case)
    titles = ("map", "highest point met, without noise", "top of the world")
    for axes, image, title in zip(panels, (case.height, case.seen, case.top), titles, strict=True):
        drawn = show(axes, case.geometry, image, vmin=low_z, vmax=high_z, cmap="viridis")
        axes.add_collection(LineCollection(false, colors=FALSE, linewidths=1.6))
        axes.add_collection(LineCollection(missed, colors=MISSED, linewidths=1.6))
        axes.set(xlim=(x0, x1), ylim=(y0, y1), title=title)
    panels[0].set_ylabel("y [m]")
    panels[-1].set_xlabel("x [m]")
    figure.colorbar(drawn, ax=panels, label="height [m]", shrink=0.7)
    save(figure, path)


def tops(path: Path, case: Case) -> None:
    """Where a top is off, and by how much."""
    error = case.height - case.seen
    off = np.abs(error) > LARGE_ERROR
    figure, axes = plt.subplots(figsize=(9, 2.7), layout="constrained")
    show(axes, case.geometry, np.where(np.isfinite(case.height), 0.25, np.nan), vmin=0, vmax=1,
         cmap="Greys", alpha=0.35)  # fmt: skip
    drawn = show(
        axes, case.geometry, np.where(off, error, np.nan), vmin=-1, vmax=1, cmap="coolwarm"
    )
    axes.set(
        xlim=(8.0, 26.0),
        ylim=(4.4, 8.6),
        xlabel="x [m]",
        ylabel="y [m]",
        title="stored minus highest point met, where > 10 cm",
    )
    axes.set_facecolor("white")
    figure.colorbar(drawn, ax=axes, label="[m]", shrink=0.8)
    save(figure, path)


def goals(path: Path, bag: Path, stored: Path) -> None:
    """Unreachable goals on the map, and on one that holds the truth."""
    truth = read_truth(bag / "truth" / "surface.npz")
    pairs = read_goals(bag / "truth" / "goals.npz")
    mapped = map_directory.load(stored, SETTINGS.mapper.probability_threshold).height_map
    figure, panels = plt.subplots(1, 2, figsize=(8, 3.9), sharey=True, layout="constrained")
    for axes, heights, name in zip(
        panels, (mapped, exact(truth.geometry, truth.top)), ("map", "the true surface"), strict=True
    ):
        obstacles = to_obstacle_map(heights, SETTINGS.traversability)
        is_open = (obstacles.cost >= 0) & (obstacles.cost < INFLATED)
        image = np.where(heights.known, np.where(is_open, 1.0, 0.5), np.nan)
        image[obstacles.occupancy == 100] = 0.0
        show(axes, obstacles.geometry, image, vmin=0, vmax=1, cmap="gray")
        refused = np.array([is_refused(obstacles, pairs, i) for i in range(len(pairs.goal))])
        for chosen, mark, color in ((refused, "x", "#2ca02c"), (~refused, "o", FALSE)):
            at = pairs.goal[~pairs.reachable & chosen]
            axes.plot(at[:, 0], at[:, 1], mark, color=color, markersize=4)
        axes.set(xlim=(-2.5, 9.0), ylim=(-2.5, 6.5), xlabel="x [m]")
        count = int((refused & ~pairs.reachable).sum())
        axes.set_title(f"{name}: {count} of {int((~pairs.reachable).sum())} refused")
    panels[0].set_ylabel("y [m]")
    save(figure, path)


def exact(geometry: Geometry, height: NDArray) -> HeightMap:
    """A map that holds heights [m] to the centimetre; NaN: unknown."""
    known = np.isfinite(height)
    return HeightMap(
        geometry=geometry,
        height=np.rint(np.where(known, height, 0.0) / HEIGHT_RESOLUTION).astype(np.int16),
        probability=np.where(known, 65000, 0).astype(np.uint16),
        probability_threshold=0.5,
    )


def is_refused(obstacles: ObstacleMap, pairs: GoalPairs, index: int) -> bool:
    one = GoalPairs(
        start=pairs.start[[index]],
        goal=pairs.goal[[index]],
        reachable=np.zeros(1, bool),
        observed=np.zeros(1, bool),
    )
    return evaluate_goals(obstacles, one).refused == 1


def save(figure: plt.Figure, path: Path) -> None:
    figure.savefig(path, dpi=130)
    plt.close(figure)
