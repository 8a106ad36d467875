# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Localization on maps of two levels: drives with drifting odometry on the map of another drive."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from level_drives import WORLDS, print_table

from heightmap25d_ros import se3
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.localization import Localizer
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import replayed
from heightmap25d_ros.pose_interpolation import interpolate
from heightmap25d_ros.simulation.recording import simulate

_UPPER = 1.5  # [m] z above which the robot is on the upper level


def localization(folder: Path, seeds: list[int], params: Params) -> None:
    """Errors of drives with drifting odometry, on the map of another drive."""
    print_table("world, seed", "odometry alone: end", "RMSE", "lower", "upper", "largest", "z RMSE")
    params = replace(params, intake=replace(params.intake, scan_topics=("/scan", "/scan_down")))
    for world in WORLDS:
        for seed in seeds:
            bags = [folder / f"{world}_{seed}_drive{drive}" for drive in (0, 1)]
            for drive, bag in enumerate(bags):
                if not bag.exists():
                    simulate(world, seed, bag, drive=drive)
            print(f"| `{world}`, {seed} | {_localized(*bags, params)}", flush=True)


def _localized(driven: Path, mapped_drive: Path, params: Params) -> str:
    mapping, localizer = Mapping(params), Localizer(params)
    with Bag(mapped_drive) as bag:
        for _ in replayed(bag, mapping, "/ground_truth", params.intake):
            pass
    mapping.flush()
    height_map = mapping.maps()[0]
    localizer.set_long_term(height_map, mapping.layers(height_map.geometry))
    told, alone, stamps = [], [], []
    with Bag(driven) as bag:
        truth = [decode.odometry(event.message) for event in bag.events(["/ground_truth"])]
        for step in replayed(bag, localizer, "/odom", params.intake):
            pose = localizer.pose
            if pose is not None and (not stamps or pose.stamp_ns > stamps[-1]):
                told.append(pose.T_map_base)
                alone.append(se3.inverse(pose.T_map_odom) @ pose.T_map_base)
                stamps.append(pose.stamp_ns)
            del step
    times = np.array([pose.stamp_ns for pose in truth])
    true = interpolate(
        times, np.array([pose.T for pose in truth]), np.clip(stamps, times[0], times[-1])
    )
    off = np.array(told)[:, :3, 3] - true[:, :3, 3]
    away, is_upper = np.hypot(off[:, 0], off[:, 1]), true[:, 2, 3] > _UPPER
    drift = np.hypot(*(np.array(alone)[-1, :2, 3] - true[-1, :2, 3]))
    rmse = [f"{np.sqrt(np.mean(away[chosen] ** 2)):.3f} m" for chosen in (
        np.ones(len(away), bool), ~is_upper, is_upper,
    )]  # fmt: skip
    return (
        f"{drift:.2f} m | {' | '.join(rmse)} | {away.max():.3f} m | "
        f"{np.sqrt(np.mean(off[:, 2] ** 2)):.3f} m |"
    )
