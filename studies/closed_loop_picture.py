# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The animation of studies/closed_loop.py: the map as it grows, the plan, the robot."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.terrain.traversability import OCCUPIED, to_obstacle_map
from heightmap25d_ros.viz import map_figures

EVERY = 1.5  # [s], simulated, between two frames
FRAMES_PER_SECOND = 5
LAST = 10  # frames for which the last one stays
WIDTH, DPI = 9.0, 80  # [inch], [1/inch]
# White with a dark rim: to be seen on the unknown as well as on any height.
PLAN: dict[str, Any] = {
    "color": "white", "linewidth": 1.4,
    "path_effects": [Stroke(linewidth=3.2, foreground="#303030"), Normal()],
}  # fmt: skip


def animate(path: Path, run: Any, goals: Sequence[Sequence[float]]) -> None:
    """Draw a `Run` of closed_loop.py as a GIF."""
    shown = map_figures.observed_part(run.maps[-1][1])
    geometry = shown.geometry
    figure, artists = _stage(shown)
    stamps = np.array([(stamp - run.driven[0][0]) * 1e-9 for stamp, _ in run.driven])
    stamps += run.seconds - stamps[-1]
    poses = np.array([T for _, T in run.driven])
    writer = PillowWriter(fps=FRAMES_PER_SECOND)
    with writer.saving(figure, path, DPI):
        for seconds in np.arange(0.0, run.seconds + EVERY, EVERY):
            _show_map(artists, geometry, _newest(run.maps, seconds))
            plan = _newest(run.plans, seconds)
            artists["plan"].set_data(*(plan.T if plan is not None else np.empty((2, 0))))
            count = int(np.searchsorted(stamps, seconds, side="right"))
            done = poses[: max(count, 1)]
            artists["driven"].set_data(done[:, 0, 3], done[:, 1, 3])
            artists["robot"].set_xy(_outline(done[-1]))
            far = np.linalg.norm(np.diff(done[:, :3, 3], axis=0), axis=1).sum()
            plans = sum(at <= seconds and len(way) > 0 for at, way in run.plans)
            sent = max(int(np.searchsorted(run.sent_at, seconds, side="right")), 1)
            artists["goal"].set_data(*([value] for value in goals[sent - 1][:2]))
            artists["title"].set_text(f"{min(seconds, run.seconds):5.1f} s   {far:5.1f} m driven   "
                                      f"height {done[-1, 2, 3]:+.2f} m   plan {plans}")  # fmt: skip
            writer.grab_frame()
        for _ in range(LAST):
            writer.grab_frame()


def _stage(last: HeightMap) -> tuple[Figure, dict[str, Any]]:
    """The figure, and what of it changes."""
    figure, axes = map_figures.map_axes(last.geometry)
    width, height = figure.get_size_inches()
    figure.set_size_inches(WIDTH, WIDTH * height / width)
    figure.subplots_adjust(left=0.07, right=0.99, bottom=0.13, top=0.92)
    axes.set_facecolor(map_figures.UNKNOWN_COLOUR)
    metres = last.metres
    style: dict[str, Any] = {
        "origin": "lower", "interpolation": "nearest", "extent": map_figures.extent(last.geometry),
    }  # fmt: skip
    nothing = np.full(last.geometry.shape, np.nan)
    obstacle = ListedColormap([map_figures.OCCUPIED_COLOUR])
    artists = {
        "heights": axes.imshow(nothing, cmap=map_figures.terrain_colours(),
                               norm=map_figures.height_norm(metres), **style),
        "obstacles": axes.imshow(nothing, cmap=obstacle, vmin=0.0, vmax=1.0, **style),
        "plan": axes.plot([], [], **PLAN)[0],
        "driven": axes.plot([], [], **map_figures.TRAJECTORY)[0],
        "robot": axes.fill([0.0], [0.0], facecolor="white", edgecolor="black")[0],
        "goal": axes.plot([], [], "*", color="white", markeredgecolor="black", markersize=14)[0],
        "title": axes.set_title("", family="monospace", fontsize=10),
    }  # fmt: skip
    return figure, artists


def _newest(stamped: list[tuple[float, Any]], seconds: float) -> Any:
    """What was last said by then; None before the first."""
    said = [content for at, content in stamped if at <= seconds]
    return said[-1] if said else None


def _show_map(artists: dict[str, Any], geometry: Geometry, shown: HeightMap | None) -> None:
    if shown is None:
        return
    metres = shown.metres
    occupied = to_obstacle_map(shown, TraversabilityParams()).occupancy == OCCUPIED
    obstacles = np.where(occupied, 1.0, np.nan)
    for name, values in (("heights", metres), ("obstacles", obstacles)):
        artists[name].set_data(_placed(geometry, shown.geometry, values))


def _placed(geometry: Geometry, part: Geometry, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cells of one rectangle of the grid in another one; NaN where they tell nothing."""
    result = np.full(geometry.shape, np.nan)
    cells = np.argwhere(np.isfinite(values))
    there = geometry.cell_at(part.cell_center(cells))
    inside = geometry.contains(there)
    result[tuple(there[inside].T)] = values[tuple(cells[inside].T)]
    return result


def _outline(T: se3.Matrix) -> NDArray[np.float64]:
    half = np.array([PlannerParams().robot_length, PlannerParams().robot_width]) / 2
    corners = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) * half
    corners = np.column_stack([corners, np.zeros(4)])
    return se3.transform_points(T[None], corners)[:, :2]
