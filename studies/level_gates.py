# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The gates of the world `arch`, with and without a nodding laser.

Right: a path leads through those where the robot fits, and through no others.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from level_drives import SCAN_RATE, mapped, print_table, scans_of

from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.planning.level_planner import planner_over
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.simulation.recording import mounted_sensors, simulate, world_of

_THROUGH = 2.6  # [m] of a path of 2 m that leads through a gate, and not around


def gates(folder: Path, seeds: list[int], params: Params) -> None:
    """Gates of `arch` that are planned through, or not, as they should be."""
    print_table(
        "seed, lasers", "gates right", "wrong (clear height)", "undersides seen", "largest error"
    )
    for seed in seeds:
        for has_nodding in (False, True):
            bag = folder / f"arch_{seed}{'_nodding' * has_nodding}"
            if not bag.exists():
                sensors = mounted_sensors(SCAN_RATE, has_nodding=has_nodding)
                simulate("arch", seed, bag, mounted=sensors)
            topics = ("/scan", "/scan_down", *(["/scan_nod"] * has_nodding))
            height_map, *_ = mapped(scans_of(bag, params, topics), params)
            planner = planner_over(height_map, params.levels, params.traversability, params.planner)
            wrong, errors, count = [], [], 0
            for solid in world_of("arch", seed).solids:
                if not solid.is_overhead:
                    continue
                (x, y, z), half = solid.center, solid.size
                clear, count = z - half[2], count + 1
                plan = planner.plan(
                    Pose2D(x - 1.0, y, yaw=0.0, z=0.0), Pose2D(x + 1.0, y, yaw=0.0, z=0.0)
                )
                is_open = plan.found and plan.length < _THROUGH and not plan.reason
                if is_open != (clear >= params.levels.clear_height):
                    wrong.append(f"{clear:.2f} m")
                errors += _underside_errors(height_map, x, y, half, clear)
            largest = f"{max(errors):.3f} m" if errors else "-"
            name = "with the nodding one" if has_nodding else "two"
            told = ", ".join(wrong) or "none"
            print(f"| {seed}, {name} | {count - len(wrong)} of {count} | {told} | "
                  f"{len(errors)} | {largest} |", flush=True)  # fmt: skip


def _underside_errors(
    height_map: HeightMap, x: float, y: float, half: Any, clear: float
) -> list[float]:
    """By how much [m] the underside of a lintel is off, where the map has surfaces of it."""
    centres = height_map.geometry.cell_center(height_map.upper.cell)
    inside = (np.abs(centres - (x, y)) < np.array(half[:2]) + 0.07).all(axis=1)
    bottoms = height_map.upper.bottom[inside] * 0.01
    return [abs(float(bottoms.min()) - clear)] if inside.any() else []
