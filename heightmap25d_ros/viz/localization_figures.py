# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of localization: trajectories, errors over time, and the score around a registration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from heightmap25d_ros.arrays import Array
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.localization import matching
from heightmap25d_ros.localization.matching import Cost
from heightmap25d_ros.localization.surface import Surface
from heightmap25d_ros.localization.tracker import Attempt
from heightmap25d_ros.params.sections import RegistrationParams
from heightmap25d_ros.viz import map_figures

_CORRECTED: dict[str, Any] = {"color": "#c020d0", "linewidth": 1.6, "label": "corrected"}
_ODOMETRY: dict[str, Any] = {"color": "#e4572e", "linewidth": 1.2, "label": "odometry alone"}
_TRUTH: dict[str, Any] = {"color": "black", "linewidth": 2.6, "label": "truth"}
_REACH = 0.75  # [m] around the minimum of the score that are drawn
_TURN = np.radians(6.0)
_STEPS = 61


def trajectories(
    path: Path, long_term: HeightMap, corrected: Array, odometry: Array, truth: Array | None
) -> None:
    """Draw trajectories (N, 3) [m] over the long-term map."""
    figure, axes = map_figures.heights_from_above(long_term)
    if truth is not None:
        axes.plot(truth[:, 0], truth[:, 1], **_TRUTH)
    axes.plot(odometry[:, 0], odometry[:, 1], **_ODOMETRY)
    axes.plot(corrected[:, 0], corrected[:, 1], **_CORRECTED)
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.01), ncol=3, frameon=False)
    map_figures.save(figure, path)


def errors(
    path: Path,
    seconds: Array,
    corrected: Array,
    odometry: Array,
    refused: Array,
) -> None:
    """Draw the errors of the corrected pose and of odometry alone over time.

    Parameters
    ----------
    seconds : (N,) float64 [s]
    corrected, odometry : (N, 3) float64 [m, m, deg]
        Errors of the position from above, of z and of the yaw.
    refused : (K,) float64 [s]
        When a registration was rejected.
    """
    figure = Figure(figsize=(10.0, 8.0))
    names = "position [m]", "z [m]", "yaw [degrees]"
    for row, name in enumerate(names):
        axes = figure.add_subplot(3, 1, row + 1)
        axes.plot(seconds, odometry[:, row], **_ODOMETRY)
        axes.plot(seconds, corrected[:, row], **_CORRECTED)
        for moment in refused:
            axes.axvline(moment, color="0.8", linewidth=0.8, zorder=0)
        axes.set(ylabel=f"error of {name}", xlim=(seconds[0], seconds[-1]))
        axes.grid(color="0.9")
        if row == 0:
            axes.legend(loc="upper left", frameon=False, ncol=2)
    axes.set_xlabel("time [s]; grey: a registration was refused" if len(refused) else "time [s]")
    map_figures.save(figure, path)


def score_surface(
    path: Path, attempt: Attempt, surface: Surface, params: RegistrationParams
) -> None:
    """Draw the score around a registration: over x and y, and over the yaw."""
    cost = Cost(params.clip, params.unknown, params.z_range)
    offset = attempt.registration.offset
    along = np.linspace(-_REACH, _REACH, _STEPS)
    turns = np.linspace(-_TURN, _TURN, _STEPS)

    def score(dx: float, dy: float, turn: float) -> float:
        hypothesis = offset + (dx, dy, turn)
        return matching.match(attempt.points, hypothesis, surface, attempt.pivot, cost).score

    figure = Figure(figsize=(12.0, 4.6), layout="constrained")
    plan, cut = figure.subplots(1, 2)
    scores = np.array([[score(dx, dy, 0.0) for dx in along] for dy in along])
    image = plan.imshow(scores, origin="lower", extent=(-_REACH, _REACH) * 2, cmap="viridis")
    plan.contour(along, along, scores, 10, colors="white", linewidths=0.5)
    figure.colorbar(image, ax=plan, label="score [m]")
    _mark_prior(plan, offset)
    plan.set(xlabel="x from the minimum [m]", ylabel="y from the minimum [m]")
    cut.plot(np.degrees(turns), [score(0.0, 0.0, turn) for turn in turns], color="#30308f")
    cut.axvline(0.0, color="0.7", linewidth=0.8)
    cut.set(xlabel="yaw from the minimum [degrees]", ylabel="score [m]")
    cut.grid(color="0.9")
    map_figures.save(figure, path)


def _mark_prior(axes: Axes, offset: Array) -> None:
    axes.plot(0.0, 0.0, "o", color="#c020d0", label="registered")
    if np.abs(offset[:2]).max() < _REACH:
        axes.plot(-offset[0], -offset[1], "x", color="#e4572e", label="prior")
    axes.legend(loc="lower right", frameon=True)
