# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Processor time of mapping with levels, against that without."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from level_drives import WORLDS, mapped, print_table, recorded, scans_of

from heightmap25d_ros.params.sections import LevelsParams, Params

ONE_LEVEL = ("ramp", "room", "rough", "street", "moving")


def cost(folder: Path, seeds: list[int], params: Params) -> None:
    """Processor time and known cells with levels, against those without."""
    single = replace(params, levels=LevelsParams(max_surfaces=1))
    print_table(
        "world", "time per beam", "known cells", "lost, won, moved > 0.10 m", "upper surfaces"
    )
    for world in (*ONE_LEVEL, *WORLDS):
        scans = scans_of(recorded(folder, world, seeds[0]), params)
        before, *_ = mapped(scans, single)
        after, *_ = mapped(scans, params)
        times = np.array([
            [mapped(scans, settings)[1] for settings in (single, params)] for _ in range(5)
        ]).min(axis=0)  # fmt: skip
        area = before.known, after.known
        moved = np.abs(before.height.astype(int) - after.height) > 10
        counts = (
            (area[0] & ~area[1]).sum(),
            (area[1] & ~area[0]).sum(),
            (moved & area[0] & area[1]).sum(),
        )
        print(f"| `{world}` | {times[1] / times[0] - 1:+.1%} | {area[0].sum()} | "
              f"{', '.join(map(str, counts))} | {len(after.upper)} |", flush=True)  # fmt: skip
