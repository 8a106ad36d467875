# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Localization on maps of two levels: drives with drifting odometry on the map of another drive."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from level_drives import WORLDS, print_table
from localization_drives import SCANS, localized, material
from measure_localization import normalised

from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pose_interpolation import interpolate

_UPPER = 1.5  # [m] z above which the robot is on the upper level


def localization(folder: Path, seeds: list[int], params: Params) -> None:
    """Errors of drives with drifting odometry; of all, of the lower and of the upper level."""
    print_table(
        "world, seed", "odometry alone: end", "RMSE", "lower", "upper", "largest", "z RMSE",
        "NEES / 3", "lower", "upper",
    )  # fmt: skip
    params = replace(params, intake=replace(params.intake, scan_topics=SCANS))
    for world in WORLDS:
        for seed in seeds:
            print(f"| `{world}`, {seed} | {_localized(folder, world, seed, params)}", flush=True)


def _localized(folder: Path, world: str, seed: int, params: Params) -> str:
    events, truth, long_term = material(folder, world, seed)
    localizer = Localizer(params)
    localizer.set_long_term(*long_term)
    run = localized(events, localizer)
    true = interpolate(*truth, np.clip(run.stamps, truth[0][0], truth[0][-1]))
    off = np.array(run.told)[:, :3, 3] - true[:, :3, 3]
    away, is_upper = np.hypot(off[:, 0], off[:, 1]), true[:, 2, 3] > _UPPER
    drift = np.hypot(*(np.array(run.odometry)[-1, :2, 3] - true[-1, :2, 3]))
    squares, is_upper_then = normalised(run, truth), is_upper[100::50]
    everywhere = np.ones_like(is_upper)
    rmse = [
        f"{np.sqrt(np.mean(away[chosen] ** 2)):.3f} m"
        for chosen in (everywhere, ~is_upper, is_upper)
    ]
    nees = [
        f"{squares[chosen].mean() / 3:.2f}"
        for chosen in (everywhere[100::50], ~is_upper_then, is_upper_then)
    ]
    return (
        f"{drift:.2f} m | {' | '.join(rmse)} | {away.max():.3f} m | "
        f"{np.sqrt(np.mean(off[:, 2] ** 2)):.3f} m | {' | '.join(nees)} |"
    )
