# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The animation of studies/closed_loop.py: the map as it grows, the plan, the robot."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.axes_grid1 import make_axes_locatable
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.params.sections import PlannerParams, TraversabilityParams
from heightmap25d_ros.terrain.traversability import OCCUPIED, to_obstacle_map
from heightmap25d_ros.viz import map_figures, palette
from heightmap25d_ros.viz.walls import walls_without_ground

EVERY = 1.5  # [s], simulated, between two frames
FRAMES_PER_SECOND = 5
LAST = 10  # frames for which the last one stays
WIDTH, DPI = 9.2, 96  # [inch], [1/inch]: 883 pixels, points at their size on a screen


def animate(path: Path, run: Any, goals: Sequence[Sequence[float]]) -> None:
    """Draw a `Run` of closed_loop.py as a GIF."""
    shown = map_figures.observed_part(run.maps[-1][1])
    geometry = shown.geometry
    norm = palette.height_norm(shown.metres)
    figure, artists = _stage(shown, norm)
    stamps = np.array([(stamp - run.driven[0][0]) * 1e-9 for stamp, _ in run.driven])
    stamps += run.seconds - stamps[-1]
    poses = np.array([T for _, T in run.driven])
    writer = PillowWriter(fps=FRAMES_PER_SECOND)
    with writer.saving(figure, path, DPI):
        for seconds in np.arange(0.0, run.seconds + EVERY, EVERY):
            _show_map(artists, geometry, _newest(run.maps, seconds), norm)
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


def _stage(last: HeightMap, norm: Normalize) -> tuple[Figure, dict[str, Any]]:
    """The figure, and what of it changes."""
    figure, axes = map_figures.map_axes(last.geometry)
    rows, columns = last.geometry.shape
    figure.set_size_inches(WIDTH, (WIDTH - 1.6) * rows / columns + 1.6)
    figure.subplots_adjust(left=0.07, right=0.92, bottom=0.12, top=0.82)
    side = make_axes_locatable(axes).append_axes("right", size=0.14, pad=0.1)
    figure.colorbar(palette.height_scale(norm), cax=side, label="height [m]")
    axes.set_facecolor(palette.UNKNOWN)
    nothing = np.zeros((*last.geometry.shape, 4), np.uint8)
    artists = {
        "cells": map_figures.draw_picture(axes, last.geometry, nothing),
        "plan": axes.plot([], [], **palette.PLANNED_LINE)[0],
        "driven": axes.plot([], [], **palette.DRIVEN_LINE)[0],
        "robot": axes.fill([0.0], [0.0], facecolor=palette.ROBOT, edgecolor=palette.FOOTPRINT)[0],
        "goal": axes.plot([], [], **palette.GOAL_MARK)[0],
    }  # fmt: skip
    entries = [
        palette.line_entry(palette.DRIVEN_LINE), palette.line_entry(palette.PLANNED_LINE),
        palette.footprint_entry("robot"), palette.line_entry(palette.GOAL_MARK),
        palette.occupied_entry(), palette.unknown_entry(), palette.wall_entry(),
    ]  # fmt: skip
    legend = palette.legend_above(axes, entries, " ")
    artists["title"] = legend.get_title()
    artists["title"].set_family("monospace")  # columns of numbers stay where they are
    return figure, artists


def _newest(stamped: list[tuple[float, Any]], seconds: float) -> Any:
    """What was last said by then; None before the first."""
    said = [content for at, content in stamped if at <= seconds]
    return said[-1] if said else None


def _show_map(
    artists: dict[str, Any], geometry: Geometry, shown: HeightMap | None, norm: Normalize
) -> None:
    if shown is None:
        return
    picture = palette.relief(shown.metres, shown.geometry.resolution, norm)
    occupied = to_obstacle_map(shown, TraversabilityParams()).occupancy == OCCUPIED
    walls = walls_without_ground(shown, occupied)
    for cells, colour in ((walls, palette.WALL), (occupied, palette.OCCUPIED)):
        picture[cells] = (*palette.rgb(colour), 255)
    artists["cells"].set_data(_placed(geometry, shown.geometry, picture))


def _placed(geometry: Geometry, part: Geometry, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture of one rectangle of the grid in another one; transparent elsewhere."""
    result = np.zeros((*geometry.shape, 4), np.uint8)
    cells = np.argwhere(picture[..., 3] > 0)
    there = geometry.cell_at(part.cell_center(cells))
    inside = geometry.contains(there)
    result[tuple(there[inside].T)] = picture[tuple(cells[inside].T)]
    return result


def _outline(T: se3.Matrix) -> NDArray[np.float64]:
    half = np.array([PlannerParams().robot_length, PlannerParams().robot_width]) / 2
    corners = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) * half
    corners = np.column_stack([corners, np.zeros(4)])
    return se3.transform_points(T[None], corners)[:, :2]
