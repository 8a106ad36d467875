# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d explain``: why a cell of a map is occupied, dear or unknown."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from heightmap25d_ros.commands.common import Figures, add_command, read_params, require_map
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.terrain.explanation import explain


def add_to(commands: Any) -> None:
    """Add ``explain``."""
    command = add_command(commands, "explain", _explain)
    command.add_argument("map", type=Path, metavar="DIR", help="map directory")
    command.add_argument("points", type=_point, nargs="+", metavar="X,Y",
                         help="places in the map [m]")  # fmt: skip


def _point(text: str) -> tuple[float, float]:
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text.strip()} is not x,y") from None
    if not (math.isfinite(x) and math.isfinite(y)):
        raise argparse.ArgumentTypeError(f"{text.strip()} is not a place")
    return x, y


def _explain(options: argparse.Namespace) -> Figures:
    """Tell of cells what they hold, and which rule makes them occupied, dear or unknown."""
    settings = read_params(options)
    require_map(options.map)
    height_map = map_directory.load(options.map, settings.mapper.probability_threshold).height_map
    found = [explain(height_map, point, settings.traversability) for point in options.points]
    if not options.json:
        return {str(index + 1): entry.sentence for index, entry in enumerate(found)}
    return {
        "cells": [
            {
                "x_m": round(entry.position[0], 4),
                "y_m": round(entry.position[1], 4),
                "occupancy": entry.occupancy,
                "cost": entry.cost,
                "rule": entry.rule.value,
                "height_m": _number(entry.height),
                "probability": round(entry.probability, 4),
                "value": _number(entry.value),
                "limit": _number(entry.limit),
                "because_of_m": entry.because_of,
                "sentence": entry.sentence,
            }
            for entry in found
        ]
    }


def _number(value: float) -> float | None:
    """JSON knows no NaN."""
    return round(value, 4) if math.isfinite(value) else None
