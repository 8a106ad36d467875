# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pictures of docs/tuning.md: what a parameter does, side by side.

Usage: python studies/tuning_pictures.py [DIRECTORY] [NAME ...]

Without names it draws all of them; the directory is docs/ by default.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import replayed
from heightmap25d_ros.planning.graph import transition_graph
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.planning.planner import Planner
from heightmap25d_ros.terrain.traversability import INFLATED, OCCUPIED, to_obstacle_map
from heightmap25d_ros.viz import map_figures, palette
from heightmap25d_ros.viz.walls import walls_without_ground

ROOT = Path(__file__).resolve().parent.parent
WIDTH, DPI = 8.0, 110  # [inch], [1/inch]
Values = dict[str, Any]
COSTS = ScalarMappable(Normalize(0, INFLATED - 1), palette.SCORES)
Draw = Callable[[Axes, HeightMap, Normalize, Params], str]


@dataclass(frozen=True)
class Picture:
    """One bag, mapped or converted with several values, drawn one above the other."""

    bag: str
    values: tuple[Values, ...]
    part: tuple[tuple[float, float], tuple[float, float]]  # x, y [m]
    draw: Draw


def main(arguments: list[str]) -> int:
    directory = Path(arguments[0]) if arguments else ROOT / "docs"
    unknown = set(arguments[1:]) - set(PICTURES)
    if unknown:
        print(f"unknown: {', '.join(unknown)}; there are {', '.join(PICTURES)}", file=sys.stderr)
        return 2
    directory.mkdir(parents=True, exist_ok=True)
    for name in arguments[1:] or PICTURES:
        path = directory / f"tuning_{name}.png"
        draw(path, PICTURES[name])
        print(path)
    return 0


def draw(path: Path, picture: Picture) -> None:
    (west, east), (south, north) = picture.part
    rows = len(picture.values)
    panel = (WIDTH - 1.5) * (north - south) / (east - west)
    figure = Figure(figsize=(WIDTH, rows * (panel + 0.35) + 0.8), layout="constrained")
    all_params = [with_values(Params(), values) for values in picture.values]
    maps = [mapped(picture.bag, params) for params in all_params]
    norm = palette.height_norm(np.concatenate([part_of(shown, picture.part) for shown in maps]))
    panels = figure.subplots(rows, sharex=True)
    for axes, params, values, shown in zip(panels, all_params, picture.values, maps, strict=True):
        result = picture.draw(axes, shown, norm, params)
        title = ", ".join(f"{name}: {value}" for name, value in values.items())
        axes.set_title(f"{title}   {result}", size=palette.TITLE_SIZE, loc="left")
        axes.set(xlim=(west, east), ylim=(south, north), aspect="equal", ylabel="y [m]")
        axes.set_facecolor(palette.UNKNOWN)
    panels[-1].set_xlabel("x [m]")
    is_costs = picture.draw is draw_costs
    scale = COSTS if is_costs else palette.height_scale(norm)
    label = "cost" if is_costs else "height [m]"
    figure.colorbar(scale, ax=panels, label=label, aspect=20 * rows, pad=0.02)
    figure.legend(
        handles=entries(picture.draw), loc="outside upper left", ncols=5, frameon=False,
        fontsize=palette.LEGEND_SIZE,
    )  # fmt: skip
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=DPI, metadata={"Software": None})


def entries(how: Draw) -> list[Artist]:
    """What the legend shows."""
    if how is draw_costs:
        return [palette.occupied_entry(), palette.inflated_entry(), palette.unknown_entry()]
    cells: list[Artist] = [
        palette.occupied_entry(), palette.unknown_entry(), palette.wall_entry()
    ]  # fmt: skip
    if isinstance(how, partial):
        marks = palette.PLANNED_LINE, palette.START_MARK, palette.GOAL_MARK
        return [*(palette.line_entry(mark) for mark in marks), *cells]
    return cells


def part_of(shown: HeightMap, part: tuple[tuple[float, float], tuple[float, float]]) -> NDArray:
    """The heights [m] of the known cells in a rectangle."""
    cells = np.argwhere(shown.known)
    at = shown.geometry.cell_center(cells)
    inside = np.all([(low <= at[:, k]) & (at[:, k] <= high) for k, (low, high) in enumerate(part)],
                    axis=0)  # fmt: skip
    return shown.metres[tuple(cells[inside].T)]


def mapped(name: str, params: Params) -> HeightMap:
    """The map of a bag by its true poses."""
    with Bag(ROOT / "bags" / name) as bag:
        values = {"intake.scan_topics": bag.scan_topics()}
        mapping = Mapping(with_values(params, values))
        for _ in replayed(bag, mapping, "/ground_truth"):
            pass
        return mapping.maps()[0]


def draw_obstacles(axes: Axes, shown: HeightMap, norm: Normalize, params: Params) -> str:
    map_figures.draw_heights(axes, shown, norm)
    occupied = to_obstacle_map(shown, params.traversability).occupancy == OCCUPIED
    walls = walls_without_ground(shown, occupied)
    map_figures.draw_cells(axes, shown.geometry, walls, palette.WALL)
    map_figures.draw_cells(axes, shown.geometry, occupied, palette.OCCUPIED)
    return ""


def draw_costs(axes: Axes, shown: HeightMap, norm: Normalize, params: Params) -> str:
    del norm  # of heights
    obstacles = to_obstacle_map(shown, params.traversability)
    cost, geometry = obstacles.cost, shown.geometry
    picture = COSTS.to_rgba(cost, bytes=True)
    picture[..., 3] = np.where(cost >= 0, 255, 0)
    map_figures.draw_picture(axes, geometry, picture)
    map_figures.draw_cells(axes, geometry, cost == INFLATED, palette.FREE)
    map_figures.draw_hatched(axes, geometry, cost == INFLATED)
    map_figures.draw_cells(axes, geometry, cost == OCCUPIED, palette.OCCUPIED)
    return ""


def draw_path(
    axes: Axes, shown: HeightMap, norm: Normalize, params: Params, start: Pose2D, goal: Pose2D
) -> str:
    draw_obstacles(axes, shown, norm, params)
    graph = transition_graph(shown, params.traversability, params.planner)
    planner = Planner(graph, params.traversability, params.planner)
    plan = planner.plan(start, goal, is_robot_there=False)
    axes.plot(plan.poses[:, 0, 3], plan.poses[:, 1, 3], **palette.PLANNED_LINE)
    axes.plot(start.x, start.y, **palette.START_MARK)
    axes.plot(goal.x, goal.y, **palette.GOAL_MARK)
    return plan.reason or f"{plan.length:.1f} m long, {plan.climb:.2f} m up"


def each(name: str, *values: Any) -> tuple[Values, ...]:
    return tuple({name: value} for value in values)


RAMP = ((0.0, 27.5), (-7.2, 3.3))
HILL = ((3.0, 18.0), (-2.0, 5.0))
ROUGH = ((-2.0, 24.5), (-6.0, 6.0))
PICTURES = {
    "rule": Picture(
        "ramp_1",
        ({"mapper.update_rule": "paper"}, {"mapper.lone_return": 0.0},
         {"mapper.update_rule": "candidate"}),
        RAMP, draw_obstacles,
    ),
    "resolution": Picture(
        "ramp_1", each("grid.resolution", 0.25, 0.125, 0.0625), RAMP, draw_obstacles
    ),
    "max_step": Picture(
        "street_1", each("traversability.max_step", 0.03, 0.1, 0.2), ((-3.5, 25.0), (-5.2, 8.2)),
        draw_obstacles,
    ),
    "max_slope": Picture(
        "rough_1", each("traversability.max_slope", 0.15, 0.25, 0.44), ROUGH, draw_obstacles
    ),
    "robot_radius": Picture(
        "ramp_1", each("traversability.robot_radius", 0.2, 0.5, 0.8), RAMP, draw_costs
    ),
    "climb_weight": Picture(
        "rough_1", each("planner.climb_weight", 2.0, 20.0), HILL,
        partial(draw_path, start=Pose2D(6.0, 1.0), goal=Pose2D(15.0, 1.5)),
    ),
    "clearance_weight": Picture(
        "ramp_1", each("planner.clearance_weight", 0.0, 1.0, 10.0), RAMP,
        partial(draw_path, start=Pose2D(24.0, -1.0), goal=Pose2D(16.0, -5.5)),
    ),
}  # fmt: skip


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
