# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The options ``--start`` and ``--duration`` of a bag."""

from __future__ import annotations

import argparse
import math

from heightmap25d_ros.errors import InputError
from heightmap25d_ros.io.bag import Bag


def positive(text: str) -> float:
    """A finite number above 0."""
    number = not_negative(text)
    if not number:
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return number


def not_negative(text: str) -> float:
    """A finite number from 0 on."""
    number = float(text)
    if not 0.0 <= number < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a number from 0 on")
    return number


def add_stretch(parser: argparse.ArgumentParser) -> None:
    """Add ``--start`` and ``--duration``."""
    parser.add_argument("--start", type=not_negative, default=0.0, metavar="S",
                        help="seconds of the bag to leave out at its beginning")  # fmt: skip
    parser.add_argument("--duration", type=positive, default=math.inf, metavar="D",
                        help="seconds of the bag to use (default: all)")  # fmt: skip


def stretch(bag: Bag, options: argparse.Namespace) -> tuple[int, int]:
    """From when to before when [ns] messages of a bag were recorded that are used.

    Raises
    ------
    InputError
        If ``--start`` is after the end of the bag.
    """
    if options.start > bag.duration:
        raise InputError(f"--start {options.start:g}: {bag.path} lasts {bag.duration:.1f} s")
    start_ns = bag.start_ns + round(options.start * 1e9)
    stop_ns = bag.end_ns + 1
    if options.duration < bag.duration:
        stop_ns = min(stop_ns, start_ns + round(options.duration * 1e9))
    return start_ns, stop_ns
