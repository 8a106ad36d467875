# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pictures of docs/defaults.md: cells where the default misses a target."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from heightmap25d_ros.evaluation.goal_reachability import evaluate_goals
from heightmap25d_ros.evaluation.map_error import LARGE_ERROR
from heightmap25d_ros.evaluation.truth import GoalPairs, read_goals, read_truth
from heightmap25d_ros.grid.height_map import HEIGHT_RESOLUTION, Geometry, HeightMap
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.terrain.traversability import INFLATED, OCCUPIED, ObstacleMap, to_obstacle_map
from heightmap25d_ros.viz import map_figures, palette

SETTINGS = Params()
CLIMB = SETTINGS.traversability.max_step
ODD = palette.ODOMETRY  # goals that should be refused and are not
FALSE, MISSED = palette.OCCUPIED, palette.FRONTIER


@dataclass(frozen=True)
class Case:
    """A map and the truth, on the cells of the truth; heights [m], NaN: unknown."""

    geometry: Geometry
    height: NDArray
    seen: NDArray
    top: NDArray


def draw(bags: Path, maps: Path, directory: Path) -> None:
    directory.mkdir(parents=True, exist_ok=True)
    mpl.rcParams.update({"font.size": 9, "axes.titlesize": 9, "image.interpolation": "nearest"})
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
    axes.set_facecolor(palette.UNKNOWN)
    return axes.imshow(image, origin="lower", extent=map_figures.extent(geometry), **options)


def transitions(path: Path, case: Case, area: tuple, span: tuple | None) -> None:
    """Heights of map and lasers, and the wrong transitions on both."""
    (x0, x1), (y0, y1) = area
    low = case.geometry.cell_at((x0, y0))
    high = case.geometry.cell_at((x1, y1))
    part = case.seen[low[0] : high[0], low[1] : high[1]]
    low_z, high_z = span or (np.nanmin(part), np.nanpercentile(part, 97))
    norm = Normalize(low_z, high_z, clip=True)
    is_wide = x1 - x0 > 3 * (y1 - y0)
    figure, panels = plt.subplots(
        *((3, 1) if is_wide else (1, 3)),
        figsize=(8, 6.0) if is_wide else (9, 3.2),
        sharex=True,
        sharey=True,
        layout="constrained",
    )
    false, missed = wrong(case)
    titles = ("map", "highest point met, without noise", "top of the world")
    for axes, image, title in zip(panels, (case.height, case.seen, case.top), titles, strict=True):
        show(axes, case.geometry, palette.relief(image, case.geometry.resolution, norm))
        for lines, colour in ((false, FALSE), (missed, MISSED)):
            axes.add_collection(LineCollection(lines, colors="white", linewidths=3.2))
            axes.add_collection(LineCollection(lines, colors=colour, linewidths=1.8))
        axes.set(xlim=(x0, x1), ylim=(y0, y1), title=title)
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.label_outer()
    figure.colorbar(palette.height_scale(norm), ax=panels, label="height [m]", shrink=0.7)
    add_legend(figure, (Line2D([], [], color=FALSE, label="false transition"),
                        Line2D([], [], color=MISSED, label="missed transition"),
                        palette.unknown_entry()))  # fmt: skip
    save(figure, path)


def tops(path: Path, case: Case) -> None:
    """Where a top is off, and by how much."""
    error = case.height - case.seen
    off = np.abs(error) > LARGE_ERROR
    figure, axes = plt.subplots(figsize=(8.5, 3.0), layout="constrained")
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
    figure.colorbar(drawn, ax=axes, label="error [m]", shrink=0.8)
    grey = mpl.colormaps["Greys"](0.25, alpha=0.35)
    add_legend(figure, (palette.cell_entry("white", "unknown"),
                        palette.cell_entry(grey, "right within 10 cm")))  # fmt: skip
    save(figure, path)


def goals(path: Path, bag: Path, stored: Path) -> None:
    """Unreachable goals on the map, and on one that holds the truth."""
    truth = read_truth(bag / "truth" / "surface.npz")
    pairs = read_goals(bag / "truth" / "goals.npz")
    mapped = map_directory.load(stored, SETTINGS.mapper.probability_threshold).height_map
    figure, panels = plt.subplots(1, 2, figsize=(8, 4.1), sharey=True, layout="constrained")
    for axes, heights, name in zip(
        panels, (mapped, exact(truth.geometry, truth.top)), ("map", "the true surface"), strict=True
    ):
        obstacles = to_obstacle_map(heights, SETTINGS.traversability)
        is_open = (obstacles.cost >= 0) & (obstacles.cost < INFLATED)
        axes.set_facecolor(palette.UNKNOWN)
        for cells, colour in (
            (heights.known, palette.WALL),
            (is_open, palette.FREE),
            (obstacles.occupancy == OCCUPIED, palette.OCCUPIED),
        ):
            map_figures.draw_cells(axes, obstacles.geometry, cells, colour)
        refused = np.array([is_refused(obstacles, pairs, i) for i in range(len(pairs.goal))])
        for chosen, mark, color in ((refused, "x", palette.DRIVEN), (~refused, "o", ODD)):
            at = pairs.goal[~pairs.reachable & chosen]
            axes.plot(
                at[:, 0],
                at[:, 1],
                mark,
                color=color,
                markeredgecolor="black" if mark == "o" else color,
                markersize=5,
            )
        axes.set(xlim=(-2.5, 9.0), ylim=(-2.5, 6.5), xlabel="x [m]")
        count = int((refused & ~pairs.reachable).sum())
        axes.set_title(f"{name}: {count} of {int((~pairs.reachable).sum())} refused")
    panels[0].set_ylabel("y [m]")
    marks = {"linestyle": "none", "markersize": 5}
    add_legend(figure, (
        Line2D([], [], marker="x", color=palette.DRIVEN,
               label="unreachable goal, refused", **marks),
        Line2D([], [], marker="o", color=ODD, markeredgecolor="black",
               label="unreachable goal, found", **marks),
        palette.free_entry(), palette.cell_entry(palette.WALL, "inflated"),
        palette.occupied_entry(), palette.unknown_entry(),
    ))  # fmt: skip
    save(figure, path)


def add_legend(figure: Figure, entries: Sequence[Artist]) -> None:
    """A legend above all panels."""
    figure.legend(
        handles=list(entries), loc="outside upper left", ncols=3, frameon=False,
        fontsize=palette.LEGEND_SIZE,
    )  # fmt: skip


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
