# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figure of a plan: the path over heights and obstacles, and its profile from the side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from mpl_toolkits.axes_grid1 import make_axes_locatable
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params.sections import PlannerParams
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.plan import Plan
from heightmap25d_ros.viz import map_figures, palette
from heightmap25d_ros.viz.walls import walls_without_ground

_FOOTPRINT_EVERY = 1.0
"""Distance between the footprints that are drawn along the path [m]."""

_PROFILE, _GAP = 1.3, 0.85
"""Height of the profile, and of the gap between it and the map [inch]."""


def distances(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) [m]: distance of each pose along a path (N, 4, 4)."""
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def draw(
    path: Path, height_map: HeightMap, graph: TransitionGraph, plan: Plan, robot: PlannerParams
) -> None:
    """Draw a plan.

    Parameters
    ----------
    path : Path
        Of the picture; its suffix is the format.
    height_map : HeightMap
    graph : TransitionGraph
        Of that map: cells that cannot contain the robot's centre are hatched.
    plan : Plan
        With a path.
    robot : PlannerParams
        Its footprint is drawn.
    """
    shown = map_figures.observed_part(height_map)
    figure, axes = map_figures.map_axes(shown.geometry)
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + _PROFILE + _GAP)
    divider = make_axes_locatable(axes)
    norm = palette.height_norm(shown.metres)
    side = divider.append_axes("right", size=0.14, pad=0.1)
    figure.colorbar(palette.height_scale(norm), cax=side, label="height [m]")
    map_figures.draw_heights(axes, shown, norm)
    _draw_cells(axes, height_map, graph)
    west, east, south, north = map_figures.extent(shown.geometry)
    axes.set(xlim=(west, east), ylim=(south, north))
    _draw_path(axes, plan, robot)
    _add_legend(axes)
    _draw_profile(divider.append_axes("bottom", size=_PROFILE, pad=_GAP), plan)
    map_figures.save(figure, path)


def _draw_cells(axes: Axes, height_map: HeightMap, graph: TransitionGraph) -> None:
    walls = walls_without_ground(height_map, graph.occupied)
    hatched = height_map.known & ~graph.enterable & ~graph.occupied & ~walls
    map_figures.draw_hatched(axes, graph.geometry, hatched)
    map_figures.draw_cells(axes, graph.geometry, walls, palette.WALL)
    map_figures.draw_cells(axes, graph.geometry, graph.occupied, palette.OCCUPIED)


def _add_legend(axes: Axes) -> None:
    entries = [
        palette.line_entry(palette.START_MARK), palette.line_entry(palette.GOAL_MARK),
        palette.line_entry(palette.PLANNED_LINE), palette.footprint_entry(),
        palette.occupied_entry(), palette.inflated_entry(),
        palette.unknown_entry(), palette.wall_entry(),
    ]  # fmt: skip
    palette.legend_above(axes, entries, "map from above")


def _draw_path(axes: Axes, plan: Plan, robot: PlannerParams) -> None:
    x, y = plan.poses[:, 0, 3], plan.poses[:, 1, 3]
    axes.plot(x, y, **palette.PLANNED_LINE)
    far = distances(plan.poses)
    every = np.searchsorted(far, np.arange(0.0, far[-1] + _FOOTPRINT_EVERY, _FOOTPRINT_EVERY))
    half = np.array([robot.robot_length, robot.robot_width]) / 2
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)]) * half
    corners = np.column_stack([corners, np.zeros(len(corners))])
    for T in plan.poses[np.minimum(every, len(far) - 1)]:
        outline = se3.transform_points(T[None], corners)
        axes.plot(outline[:, 0], outline[:, 1], **palette.FOOTPRINT_LINE)
    axes.plot(x[0], y[0], **palette.START_MARK)
    axes.plot(x[-1], y[-1], **palette.GOAL_MARK)


def _draw_profile(axes: Axes, plan: Plan) -> None:
    far, z = distances(plan.poses), plan.poses[:, 2, 3]
    slope = np.degrees(np.arccos(np.clip(plan.poses[:, 2, 2], -1.0, 1.0)))
    middle, half = (z.max() + z.min()) / 2, max(z.max() - z.min(), 0.5)
    axes.fill_between(far, z, middle - half, color=palette.GROUND)
    axes.plot(far, z, color="black", linewidth=1.2)
    axes.set(xlabel="distance along the planned path [m]", ylabel="height [m]")
    axes.set_title("profile of the planned path", loc="left", fontsize=palette.TITLE_SIZE)
    axes.set(xlim=(0.0, max(far[-1], 0.1)), ylim=(middle - half, middle + half))
    slopes = axes.twinx()
    slopes.plot(far, slope, color=palette.SLOPE, linewidth=1.0)
    slopes.tick_params(axis="y", colors=palette.SLOPE)
    slopes.set_ylabel("slope [deg]", color=palette.SLOPE)
    slopes.set_ylim(0.0, max(15.0, 1.1 * float(slope.max())))
