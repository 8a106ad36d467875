# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What odometry that jumps costs a map: bags/ramp with disturbed poses, against its truth.

``python studies/measure_odometry_jumps.py [BAG]`` prints a table: blocked transitions (F1), cells
that the truth does not cover, and what the map counted.
"""

from __future__ import annotations

import copy
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation.map_error import evaluate_map
from heightmap25d_ros.evaluation.truth import read_truth
from heightmap25d_ros.io import decode
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import feed

RAMP = Path(__file__).parent.parent / "bags" / "ramp"

Disturbance = Callable[[float, se3.Matrix], se3.Matrix]
"""Pose from seconds since the start and the pose that the odometry had."""


def restart(at: float, tilt: bool = False) -> Disturbance:
    """The odometry begins at 0 again, with the roll and pitch that it had, or at 0 as well."""
    T_new_old: list[se3.Matrix] = []

    def disturbed(seconds: float, T: se3.Matrix) -> se3.Matrix:
        if seconds < at:
            return T
        if not T_new_old:
            xyz_rpy = se3.to_xyz_rpy(T)
            level = T if tilt else se3.from_xyz_rpy([*xyz_rpy[:3], 0.0, 0.0, xyz_rpy[5]])
            T_new_old.append(se3.inverse(level))
        return np.asarray(T_new_old[0] @ T)

    return disturbed


def every(period: float, T_wild: se3.Matrix, first: float = 1.0, last: float = 1e9) -> Disturbance:
    """Single poses somewhere else."""
    due = [first]

    def disturbed(seconds: float, T: se3.Matrix) -> se3.Matrix:
        if not due[0] <= seconds <= last:
            return T
        due[0] += period
        return T_wild

    return disturbed


def offset(at: float, until: float, *shift: float) -> Disturbance:
    """Poses that are shifted from a time to another one."""
    T_shift = se3.from_xyz_rpy([*shift, *(0.0,) * (6 - len(shift))])
    return lambda seconds, T: np.asarray(T_shift @ T) if at <= seconds < until else T


def in_body(at: float, *shift: float) -> Disturbance:
    """Poses of a robot that is moved along and about its own axes."""
    T_shift = se3.from_xyz_rpy([*shift, *(0.0,) * (6 - len(shift))])
    return lambda seconds, T: np.asarray(T @ T_shift) if seconds >= at else T


def disturbances(half: float) -> dict[str, Disturbance]:
    """By name; half of the drive has passed at a time [s]."""
    return {
        "undisturbed": lambda _, T: T,
        "restart at 0": restart(half),
        "restart at 0, roll and pitch as well": restart(half, tilt=True),
        "one zero pose every 2 s": every(2.0, np.eye(4)),
        "two zero poses every 2 s": lambda s, T: np.eye(4) if s % 2 < 0.04 and s > 1 else T,
        "one wild pose": every(1e9, se3.from_xyz_rpy([500.0, 30.0, 5.0, 0.2, 0.1, 2.0]), half),
        "1 m sideways": offset(half, 1e9, 0.0, 1.0),
        "1 m sideways and back after 5 s": offset(half, half + 5.0, 0.0, 1.0),
        "300 m": offset(half, 1e9, 300.0, 0.0),
        "300 m, turned by 90 degrees": offset(half, 1e9, 300.0, 0.0, 0.0, 0.0, 0.0, np.pi / 2),
        "0.8 m up": offset(half, 1e9, 0.0, 0.0, 0.8),
    }


def messages(bag: Bag, disturb: Disturbance) -> Iterator[tuple[str, Any]]:
    """Topics and messages of a bag with other poses."""
    begin: int | None = None
    for event in bag.events([*bag.scan_topics(), "/odom", "/tf", "/tf_static"]):
        message = event.message
        if event.topic == "/odom":
            odometry = decode.odometry(message)
            begin = odometry.stamp_ns if begin is None else begin
            T = disturb((odometry.stamp_ns - begin) * 1e-9, odometry.T)
            if T is not odometry.T:
                message = copy.deepcopy(message)
                position, turn = message.pose.pose.position, message.pose.pose.orientation
                position.x, position.y, position.z = T[:3, 3].tolist()
                turn.x, turn.y, turn.z, turn.w = se3.to_quaternion(T).tolist()
        yield event.topic, message


def mapped(path: Path, disturb: Disturbance, **values: Any) -> Mapping:
    """The map of a bag with other poses."""
    with Bag(path) as bag:
        settings = with_values(Params(), {"intake.scan_topics": bag.scan_topics(), **values})
        mapping = Mapping(settings)
        for topic, message in messages(bag, disturb):
            feed(mapping, topic, message)
    mapping.flush()
    return mapping


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else RAMP
    truth = read_truth(path / "truth" / "surface.npz")
    with Bag(path) as bag:
        half = bag.duration / 2
    for name, disturb in disturbances(half).items():
        mapping = mapped(path, disturb)
        error = evaluate_map(mapping.maps()[0], Params().traversability, truth)
        f1 = error.blocked_transitions.f1
        print(f"{name:38} F1 {f1:.3f}, {error.known_cells_outside:4} cells outside; "
              f"{mapping.merged['scans']} scans; {mapping.dropped}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
