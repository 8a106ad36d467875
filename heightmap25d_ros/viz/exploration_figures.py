# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of an exploration: the map at its end, and an animation of the map as it grew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.axes_grid1 import make_axes_locatable
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import Geometry, HeightMap
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.terrain.traversability import OCCUPIED, to_obstacle_map
from heightmap25d_ros.viz import map_figures, palette
from heightmap25d_ros.viz.walls import walls_without_ground

_FRAMES_PER_SECOND = 6
_LAST = 12  # frames for which the last one stays
_WIDTH, _DPI = 9.2, 80  # [inch], [1/inch]
_BORDER = 0.2  # [m] around the map and the boundary
_MARGIN = 1.6  # [inch] around the map, for the legend and the colours
_LARGEST_MARK = 9.0  # [pt] of the place with the largest gain
_CURVE, _GAP = 1.5, 0.75  # [inch] height of the curve below the map, and of the gap

PLACE_MARK: dict[str, Any] = {
    "marker": "o", "color": palette.FRONTIER, "markeredgecolor": "black", "markersize": 6,
    "linestyle": "none", "label": "place, by its gain",
}  # fmt: skip
GIVEN_UP_MARK: dict[str, Any] = {
    "marker": "X", "color": palette.OCCUPIED, "markeredgecolor": "white", "markersize": 8,
    "linestyle": "none", "label": "given up",
}  # fmt: skip
_ROBOT: dict[str, Any] = {"facecolor": palette.ROBOT, "edgecolor": palette.FOOTPRINT}
BOUNDARY_LINE: dict[str, Any] = {
    "color": palette.ODOMETRY, "linewidth": 1.4, "linestyle": "--", "label": "boundary",
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Snapshot:
    """How far an exploration was at a time.

    Attributes
    ----------
    seconds : float [s]
        Since the start.
    distance : float [m]
        That was driven.
    covered_area : float [m^2]
    height_map : HeightMap
    robot : (4, 4) float64
        Its pose in the map.
    goal : Pose2D or None
    places : (N, 2) float64 [m], map
        That were compared last.
    gains : (N,) float64 [m^2]
        Of these.
    path : (N, 2) float64 [m], map
        That is followed.
    """

    seconds: float
    distance: float
    covered_area: float
    height_map: HeightMap
    robot: se3.Matrix
    goal: Pose2D | None
    places: Array
    gains: Array
    path: Array


def draw(
    path: Path,
    snapshots: Sequence[Snapshot],
    driven: NDArray[np.float64],
    boundary: NDArray[np.float64],
    given_up: Sequence[Pose2D],
    params: Params,
) -> None:
    """Draw the map at the end, the way that was driven, and how the covered area grew along it.

    Parameters
    ----------
    path : Path
        Of the picture; its suffix is the format.
    snapshots : sequence of Snapshot
        At least one.
    driven : (N, 2) float64 [m], map
    boundary : (N, 2) float64 [m], map
        Corners; empty: none.
    given_up : sequence of Pose2D
    params : Params
    """
    shown = map_figures.observed_part(snapshots[-1].height_map)
    figure, axes, norm = _map_figure(shown)
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + _CURVE + _GAP)
    map_figures.draw_picture(axes, shown.geometry, _cells(shown, norm, params))
    axes.plot(*driven.T, **palette.DRIVEN_LINE)
    axes.plot(*driven[0], **palette.START_MARK)
    axes.fill(*_outline(snapshots[-1], params).T, **_ROBOT, zorder=4)
    entries = [
        palette.line_entry(palette.DRIVEN_LINE), palette.line_entry(palette.START_MARK),
        palette.footprint_entry("robot at the end"),
    ]  # fmt: skip
    if len(boundary):
        axes.plot(*np.vstack([boundary, boundary[:1]]).T, **BOUNDARY_LINE)
        entries.append(palette.line_entry(BOUNDARY_LINE))
    if given_up:
        axes.plot(*np.array([(p.x, p.y) for p in given_up]).T, **GIVEN_UP_MARK)
        entries.append(palette.line_entry(GIVEN_UP_MARK))
    axes.margins(0.02)
    cells = [palette.occupied_entry(), palette.unknown_entry(), palette.wall_entry()]
    palette.legend_above(axes, [*entries, *cells])
    below = make_axes_locatable(axes).append_axes("bottom", size=_CURVE, pad=_GAP)
    below.plot([s.distance for s in snapshots], [s.covered_area for s in snapshots], color="black")
    below.set(xlabel="distance driven [m]", ylabel="covered [m²]", xlim=(0.0, None), ylim=(0, None))
    below.grid(visible=True, color=palette.GROUND, linewidth=0.6)
    map_figures.save(figure, path)


def animate(
    path: Path,
    snapshots: Sequence[Snapshot],
    driven: NDArray[np.float64],
    boundary: NDArray[np.float64],
    params: Params,
) -> None:
    """Draw the map as it grew, as a GIF; parameters as of `draw`.

    ``driven`` has a point for each snapshot.
    """
    shown = map_figures.observed_part(snapshots[-1].height_map)
    figure, axes, norm = _map_figure(shown)
    artists = _stage(axes, shown, boundary)
    width, height = axes.viewLim.size
    figure.set_size_inches(_WIDTH, (_WIDTH - _MARGIN) * height / width + _MARGIN)
    figure.subplots_adjust(left=0.07, right=0.9, bottom=0.1, top=0.84)
    writer = PillowWriter(fps=_FRAMES_PER_SECOND)
    with writer.saving(figure, path, _DPI):
        for n, snapshot in enumerate(snapshots):
            artists["cells"].set_data(_placed(shown.geometry, snapshot.height_map, norm, params))
            _show(artists, snapshot, driven[: n + 1], params)
            writer.grab_frame()
        for _ in range(_LAST):
            writer.grab_frame()


def _map_figure(shown: HeightMap) -> tuple[Figure, Axes, Normalize]:
    figure, axes = map_figures.map_axes(shown.geometry)
    norm = palette.height_norm(shown.metres)
    side = make_axes_locatable(axes).append_axes("right", size=0.14, pad=0.1)
    figure.colorbar(palette.height_scale(norm), cax=side, label="height [m]")
    axes.set_facecolor(palette.UNKNOWN)
    return figure, axes, norm


def _stage(axes: Axes, shown: HeightMap, boundary: NDArray[np.float64]) -> dict[str, Any]:
    """What changes from frame to frame."""
    nothing = np.zeros((*shown.geometry.shape, 4), np.uint8)
    artists: dict[str, Any] = {
        "cells": map_figures.draw_picture(axes, shown.geometry, nothing),
        "path": axes.plot([], [], **palette.PLANNED_LINE)[0],
        "driven": axes.plot([], [], **palette.DRIVEN_LINE)[0],
        "places": axes.scatter([], [], s=[], color=palette.FRONTIER, edgecolors="black", zorder=3),
        "robot": axes.fill([0.0], [0.0], **_ROBOT, zorder=4)[0],
        "goal": axes.plot([], [], **palette.GOAL_MARK, zorder=5)[0],
    }  # fmt: skip
    entries = [
        palette.line_entry(palette.DRIVEN_LINE), palette.line_entry(palette.PLANNED_LINE),
        palette.footprint_entry("robot"), palette.line_entry(palette.GOAL_MARK),
        palette.line_entry(PLACE_MARK), palette.occupied_entry(), palette.unknown_entry(),
        palette.wall_entry(),
    ]  # fmt: skip
    if len(boundary):
        axes.plot(*np.vstack([boundary, boundary[:1]]).T, **BOUNDARY_LINE)
        entries.append(palette.line_entry(BOUNDARY_LINE))
    west, east, south, north = map_figures.extent(shown.geometry)
    corners = np.vstack([[(west, south), (east, north)], boundary.reshape(-1, 2)])
    low, high = corners.min(axis=0) - _BORDER, corners.max(axis=0) + _BORDER
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    legend = palette.legend_above(axes, entries, " ")
    artists["title"] = legend.get_title()
    artists["title"].set_family("monospace")  # columns of numbers stay where they are
    return artists


def _show(
    artists: dict[str, Any], snapshot: Snapshot, driven: NDArray[np.float64], params: Params
) -> None:
    artists["path"].set_data(*snapshot.path.T)
    artists["driven"].set_data(*driven.T)
    worth = snapshot.gains >= params.exploration.min_gain
    artists["places"].set_offsets(snapshot.places[worth])
    largest = max(float(snapshot.gains.max(initial=0.0)), 1e-9)
    artists["places"].set_sizes(_LARGEST_MARK**2 * snapshot.gains[worth] / largest)
    goal = snapshot.goal
    artists["goal"].set_data(*(([goal.x], [goal.y]) if goal is not None else ([], [])))
    artists["robot"].set_xy(_outline(snapshot, params))
    artists["title"].set_text(
        f"{snapshot.seconds:6.1f} s   {snapshot.distance:6.1f} m driven   "
        f"{snapshot.covered_area:6.1f} m² covered"
    )


def _outline(snapshot: Snapshot, params: Params) -> NDArray[np.float64]:
    """(4, 2) [m], map: the corners of the robot."""
    half = np.array([params.planner.robot_length, params.planner.robot_width]) / 2
    corners = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) * half
    outline = se3.transform_points(snapshot.robot[None], np.column_stack([corners, np.zeros(4)]))
    return np.asarray(outline[:, :2])


def _cells(shown: HeightMap, norm: Normalize, params: Params) -> NDArray[np.uint8]:
    """(rows, columns, 4): heights, obstacles and walls."""
    picture = palette.relief(shown.metres, shown.geometry.resolution, norm)
    occupied = to_obstacle_map(shown, params.traversability).occupancy == OCCUPIED
    walls = walls_without_ground(shown, occupied)
    for cells, colour in ((walls, palette.WALL), (occupied, palette.OCCUPIED)):
        picture[cells] = (*palette.rgb(colour), 255)
    return picture


def _placed(
    geometry: Geometry, shown: HeightMap, norm: Normalize, params: Params
) -> NDArray[np.uint8]:
    """The picture of one map in the rectangle of another one; transparent elsewhere."""
    picture = _cells(shown, norm, params)
    result = np.zeros((*geometry.shape, 4), np.uint8)
    cells = np.argwhere(picture[..., 3] > 0)
    there = geometry.cell_at(shown.geometry.cell_center(cells))
    inside = geometry.contains(there)
    result[tuple(there[inside].T)] = picture[tuple(cells[inside].T)]
    return result
