# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``heightmap25d explore``: a simulated robot explores a world."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from heightmap25d_ros.commands.bringup import default_params_file
from heightmap25d_ros.commands.common import (
    Figures,
    add_command,
    cell_counts,
    check_output,
    read_params,
)
from heightmap25d_ros.errors import NegativeResultError
from heightmap25d_ros.io import map_directory
from heightmap25d_ros.params.sections import Params, SimulatorParams
from heightmap25d_ros.params.spec import specs
from heightmap25d_ros.pipelines.exploration_task import End, Task
from heightmap25d_ros.pipelines.mapping import compile_kernels
from heightmap25d_ros.planning.boundary import Boundary

EXIT_NOT_DONE = 3
_PNG, _GIF = "exploration.png", "exploration.gif"
_SCAN_RATE = 12.5  # [Hz] enough at the speed of the robot
_STEP = 0.01  # [s]
_LONGEST = 7200.0  # [s], simulated, of an exploration without a limit


def add_to(commands: Any) -> None:
    """Add ``explore``."""
    command = add_command(commands, "explore", _explore)
    command.set_defaults(params=default_params_file())
    worlds = {name: spec.choices for name, spec, _ in specs(SimulatorParams())}["world"]
    command.add_argument("world", metavar="WORLD",
                         help=f"{', '.join(worlds[:-1])} or {worlds[-1]}")  # fmt: skip
    command.add_argument("--seed", type=int, default=1, metavar="N",
                         help="of the world's details and of the noise (default: 1)")  # fmt: skip
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR",
                         help=f"directory for the map (map/, with the true trajectory), {_PNG} and "
                         f"{_GIF}")  # fmt: skip
    command.add_argument("--boundary", type=_corners, metavar="X,Y,X,Y,X,Y[,...]",
                         help="corners of the polygon that the robot does not leave [m] "
                         "(default: exploration.boundary, or the world's extent)")  # fmt: skip
    command.add_argument("--min-gain", type=float, metavar="A",
                         help="area that a place must show to be worth the way [m^2] "
                         "(default: exploration.min_gain)")  # fmt: skip
    command.add_argument("--time-limit", type=float, metavar="S",
                         help="simulated [s] (default: exploration.time_limit)")  # fmt: skip
    command.add_argument("--distance-limit", type=float, metavar="M",
                         help="[m] (default: exploration.distance_limit)")  # fmt: skip
    command.add_argument("--return-home", action="store_true", help="drive back to the start")
    command.add_argument("--no-animation", action="store_true", help=f"do not make {_GIF}")


def _corners(text: str) -> list[float]:
    try:
        return [float(number) for number in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not X,Y,X,Y,X,Y") from None


def _explore(options: argparse.Namespace) -> Figures:
    """Explore a simulated world with known poses; the same seed, the same run.

    Mapping, planning, exploration and path following run as in the nodes, in one process and in
    simulated time. The exit status is 3 where the exploration does not end with DONE.
    """
    from heightmap25d_ros.simulation import recording  # noqa: PLC0415 - needs MuJoCo
    from heightmap25d_ros.simulation.explored import SimulatedExploration  # noqa: PLC0415
    from heightmap25d_ros.simulation.simulation import Simulation  # noqa: PLC0415
    from heightmap25d_ros.viz import exploration_figures  # noqa: PLC0415 - takes a second

    check_output(options.output)
    settings = _settings(options)
    world = recording.world_of(options.world, options.seed)
    task = Task.of(settings)
    if not len(task.boundary.corners):
        (x0, x1), (y0, y1) = world.area
        task = replace(task, boundary=Boundary.of([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]))
    compile_kernels(settings)
    simulation = Simulation(
        world,
        options.seed,
        recording.noise_of(noise_free=False, true_odometry=True),
        recording.mounted_sensors(_SCAN_RATE),
        step=_STEP,
    )
    began = time.perf_counter()
    run = SimulatedExploration(simulation, settings, task)
    run.run(_LONGEST)
    seconds = time.perf_counter() - began
    height_map, obstacle_map = run.mapping.maps()
    layers = run.mapping.layers(height_map.geometry)
    map_path, record, explored = options.output / "map", run.record, run.exploration
    frame = settings.mapping.map_frame
    map_directory.save(map_path, height_map, obstacle_map, frame, record.trajectory, layers)
    corners = task.boundary.corners
    driven = np.array([T[:2, 3] for _, T in record.trajectory])
    exploration_figures.draw(
        options.output / _PNG, record.snapshots, driven, corners, explored.given_up, settings
    )
    if not options.no_animation:
        driven = np.array([snapshot.robot[:2, 3] for snapshot in record.snapshots])
        exploration_figures.animate(
            options.output / _GIF, record.snapshots, driven, corners, settings
        )
    figures: Figures = {
        "world": options.world,
        "seed": options.seed,
        "end": explored.end.name,
        "reason": explored.reason,
        "has_returned": explored.has_returned,
        "distance_m": round(explored.distance, 2),
        "duration_s": round(simulation.seconds, 1),
        "covered_m2": round(explored.survey.covered_area, 2) if explored.survey else 0.0,
        "given_up": len(explored.given_up),
        "contacts": record.contacts,
        "plans": record.plans,
        "refused_goals": record.refused,
        "decision_p95_ms": round(1e3 * float(np.percentile(record.decision_s or [0.0], 95)), 1),
        **cell_counts(height_map, obstacle_map),
        "processing_s": round(seconds, 1),
        "real_time_factor": round(simulation.seconds / seconds, 1),
        "map": str(map_path),
        "sha256": map_directory.digest(map_path),
    }
    if explored.end is not End.DONE:
        raise NegativeResultError(figures, EXIT_NOT_DONE)
    return figures


def _settings(options: argparse.Namespace) -> Params:
    """The parameters, with those of the command line in them."""
    settings = read_params(options)
    given = {
        "boundary": options.boundary and tuple(options.boundary),
        "min_gain": options.min_gain,
        "time_limit": options.time_limit,
        "distance_limit": options.distance_limit,
        "return_home": options.return_home or None,
    }
    own = {name: value for name, value in given.items() if value is not None}
    topics = tuple(f"/{topic.strip('/')}" for topic in settings.intake.scan_topics)
    return replace(
        settings,
        exploration=replace(settings.exploration, **own),
        intake=replace(settings.intake, scan_topics=topics),
    )
