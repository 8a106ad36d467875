# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figure of a plan: the path over heights and obstacles, and its profile from the side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from mpl_toolkits.axes_grid1 import make_axes_locatable
from numpy.typing import NDArray

from heightmap25d_ros import se3
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params.sections import PlannerParams
from heightmap25d_ros.planning.graph import TransitionGraph
from heightmap25d_ros.planning.plan import Plan
from heightmap25d_ros.viz.map_figures import (
    OCCUPIED_COLOUR,
    TRAJECTORY,
    UNKNOWN_COLOUR,
    extent,
    height_norm,
    map_axes,
    observed_part,
    save,
    terrain_colours,
)

_FOOTPRINT_EVERY = 1.0
"""Distance between the footprints that are drawn along the path [m]."""

_PROFILE, _GAP = 1.5, 0.7
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
        Of that map: cells that cannot contain the robot's centre are shaded.
    plan : Plan
        With a path.
    robot : PlannerParams
        Its footprint is drawn.
    """
    shown = observed_part(height_map)
    figure, axes = map_axes(shown.geometry)
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + _PROFILE + _GAP)
    divider = make_axes_locatable(axes)
    side = divider.append_axes("right", size=0.14, pad=0.1)
    _draw_map(axes, side, shown, graph)
    _draw_path(axes, plan, robot)
    _draw_profile(divider.append_axes("bottom", size=_PROFILE, pad=_GAP), plan)
    save(figure, path)


def _draw_map(axes: Axes, side: Axes, shown: HeightMap, graph: TransitionGraph) -> None:
    metres = shown.metres
    axes.set_facecolor(UNKNOWN_COLOUR)
    style: dict[str, Any] = {"origin": "lower", "interpolation": "nearest"}
    image = axes.imshow(
        metres, cmap=terrain_colours(), norm=height_norm(metres), extent=extent(shown.geometry),
        **style,
    )  # fmt: skip
    axes.figure.colorbar(image, cax=side, label="height [m]")
    for cells, colour, alpha in (
        (~graph.enterable & ~graph.forbidden, "black", 0.25),
        (graph.occupied, OCCUPIED_COLOUR, 1.0),
    ):
        axes.imshow(
            np.where(cells, 1.0, np.nan), cmap=ListedColormap([colour]), alpha=alpha,
            extent=extent(graph.geometry), **style,
        )  # fmt: skip
    west, east, south, north = extent(shown.geometry)
    axes.set(xlim=(west, east), ylim=(south, north))


def _draw_path(axes: Axes, plan: Plan, robot: PlannerParams) -> None:
    x, y = plan.poses[:, 0, 3], plan.poses[:, 1, 3]
    axes.plot(x, y, **TRAJECTORY)
    axes.plot(x[0], y[0], "o", color="white", markeredgecolor="black")
    axes.plot(x[-1], y[-1], "*", color="white", markeredgecolor="black", markersize=14)
    far = distances(plan.poses)
    every = np.searchsorted(far, np.arange(0.0, far[-1] + _FOOTPRINT_EVERY, _FOOTPRINT_EVERY))
    half = np.array([robot.robot_length, robot.robot_width]) / 2
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)]) * half
    corners = np.column_stack([corners, np.zeros(len(corners))])
    for T in plan.poses[np.minimum(every, len(far) - 1)]:
        outline = se3.transform_points(T[None], corners)
        axes.plot(outline[:, 0], outline[:, 1], color="black", linewidth=0.7)


def _draw_profile(axes: Axes, plan: Plan) -> None:
    far, z = distances(plan.poses), plan.poses[:, 2, 3]
    slope = np.degrees(np.arccos(np.clip(plan.poses[:, 2, 2], -1.0, 1.0)))
    middle, half = (z.max() + z.min()) / 2, max(z.max() - z.min(), 0.5)
    axes.fill_between(far, z, middle - half, color="#c8a878")
    axes.plot(far, z, color="black", linewidth=1.2)
    axes.set(xlabel="along the path [m]", ylabel="height [m]")
    axes.set(xlim=(0.0, max(far[-1], 0.1)), ylim=(middle - half, middle + half))
    slopes = axes.twinx()
    slopes.plot(far, slope, color="#2060c0", linewidth=1.0)
    slopes.set_ylabel("slope of the ground [deg]", color="#2060c0")
    slopes.set_ylim(0.0, max(15.0, 1.1 * float(slope.max())))
