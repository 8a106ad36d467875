# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d simulate``: a bag of a simulated drive."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from heightmap25d_ros.commands.common import Figures, add_command
from heightmap25d_ros.params.sections import SimulatorParams
from heightmap25d_ros.params.spec import specs


def add_to(commands: Any) -> None:
    """Add ``simulate``."""
    command = add_command(commands, "simulate", _simulate)
    worlds = {name: spec.choices for name, spec, _ in specs(SimulatorParams())}["world"]
    command.add_argument("world", metavar="WORLD",
                         help=f"{', '.join(worlds[:-1])} or {worlds[-1]}")  # fmt: skip
    command.add_argument("--seed", type=_integer, default=1, metavar="N",
                         help="of the world's details and of the noise (default: 1)")  # fmt: skip
    command.add_argument("--drive", type=_integer, default=0, metavar="N",
                         help="another way through the same world, with other errors "
                         "(default: 0, the world's own)")  # fmt: skip
    command.add_argument("--speed", type=float, metavar="V",
                         help="of the drive [m/s], 0.1 to 1.5 "
                         "(default: the world's own)")  # fmt: skip
    command.add_argument("--slip", type=float, metavar="S",
                         help="standard deviation of the odometry's slowly varying error of "
                         "the distance per distance, 0 to 1 (default: 0.055)")  # fmt: skip
    command.add_argument("-o", "--output", type=Path, required=True, metavar="BAG",
                         help="rosbag2 directory to write, with truth/ in it")  # fmt: skip
    command.add_argument("--scan-rate", type=float, default=37.5, metavar="HZ",
                         help="scans of each laser, at most 75 (default: 37.5)")  # fmt: skip
    command.add_argument("--nodding", action="store_true", help="a third laser, which nods")
    command.add_argument(
        "--lidar",
        type=_integer,
        default=0,
        metavar="RINGS",
        help="a 3-D lidar of 8 to 128 rings in place of the lasers, on /points",
    )
    command.add_argument(
        "--depth-camera",
        action="store_true",
        help="a depth camera in place of the lasers, on /depth/points",
    )
    command.add_argument("--true-odometry", action="store_true", help="/odom without errors")
    command.add_argument("--noise-free", action="store_true", help="nothing errs")


def _integer(text: str) -> int:
    """A whole number; one of too many digits is told without them."""
    try:
        return int(text)
    except ValueError:
        shown = text if len(text) < 30 else f"{text[:20]}... ({len(text)} characters)"
        raise argparse.ArgumentTypeError(f"invalid int value: {shown!r}") from None


def _simulate(options: argparse.Namespace) -> Figures:
    """Record a drive through a simulated world, and the truth; the same seed, the same bytes."""
    from heightmap25d_ros.simulation import recording  # noqa: PLC0415 - needs MuJoCo

    return recording.simulate(
        options.world,
        options.seed,
        options.output,
        drive=options.drive,
        speed=options.speed,
        mounted=recording.mounted_sensors(
            options.scan_rate,
            has_nodding=options.nodding,
            lidar_rings=options.lidar,
            has_depth_camera=options.depth_camera,
        ),
        noise=recording.noise_of(
            noise_free=options.noise_free,
            true_odometry=options.true_odometry,
            slip=options.slip,
        ),
    )
