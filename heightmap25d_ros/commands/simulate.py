# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d simulate``: a bag of a simulated drive."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from heightmap25d_ros.commands.common import Figures, add_command


def add_to(commands: Any) -> None:
    """Add ``simulate``."""
    command = add_command(
        commands, "simulate", _simulate, "a bag of a simulated drive, and its truth"
    )
    command.add_argument("world", metavar="WORLD",
                         help="ramp, room, rough, street, arch, garage or moving")  # fmt: skip
    command.add_argument("--seed", type=int, default=1, metavar="N",
                         help="of the world's details and of the noise (default: 1)")  # fmt: skip
    command.add_argument("--drive", type=int, default=0, metavar="N",
                         help="another way through the same world, with other errors "
                         "(default: 0, the world's own)")  # fmt: skip
    command.add_argument("-o", "--output", type=Path, required=True, metavar="BAG",
                         help="rosbag2 directory to write, with truth/ in it")  # fmt: skip
    command.add_argument("--scan-rate", type=float, default=37.5, metavar="HZ",
                         help="scans of each laser, at most 75 (default: 37.5)")  # fmt: skip
    command.add_argument("--nodding", action="store_true", help="a third laser, which nods")
    command.add_argument("--true-odometry", action="store_true", help="/odom without errors")
    command.add_argument("--noise-free", action="store_true", help="nothing errs")


def _simulate(options: argparse.Namespace) -> Figures:
    """Record a drive through a simulated world, and the truth; the same seed, the same bytes."""
    from heightmap25d_ros.simulation import recording  # noqa: PLC0415 - needs MuJoCo

    return recording.simulate(
        options.world,
        options.seed,
        options.output,
        drive=options.drive,
        scan_rate=options.scan_rate,
        has_nodding=options.nodding,
        noise=recording.noise_of(
            noise_free=options.noise_free, true_odometry=options.true_odometry
        ),
    )
