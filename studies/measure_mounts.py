# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mounts that are off: what the self-check tells of a drive, as the table of docs/reliability.md.

    python studies/measure_mounts.py bags/ramp_1 bags/room_1

Each laser's mount is assumed 2 degrees too large, and too small, about one axis of base_link; the
poses are those of /odom, with their errors. Where the mounts are right nothing may be told.
"""

from __future__ import annotations

import argparse
import logging
import re
from collections import defaultdict
from pathlib import Path

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.mount_watch import MountWatch
from heightmap25d_ros.pipelines.replay import pose_topic, replayed, with_sources

AXES = ("roll", "pitch", "yaw")
RIGHT = ("right", 0.0)
OFF = [RIGHT, *((axis, degrees) for axis in AXES for degrees in (2.0, -2.0))]


def told(path: Path, odom_topic: str | None) -> dict[str, dict[tuple[str, float], str]]:
    """By laser and by what is off: what was told at the end of a drive."""
    watches: defaultdict[tuple[str, float], MountWatch] = defaultdict(MountWatch)
    topics = set()
    with Bag(path) as bag:
        params = with_sources(Params(), [bag], (), ())
        topic = pose_topic(bag, odom_topic, params.intake)[0]
        for step in replayed(bag, Mapping(params), topic, params.intake):
            for reading in step.outcomes:
                topics.add(reading.topic)
                for axis, degrees in OFF:
                    mount = turned(reading.T_base_sensor, axis, np.radians(degrees))
                    watches[axis, degrees].observe(
                        reading.topic, reading.scan, reading.T_map_base, mount
                    )
    return {topic: {off: fault_of(topic, watches[off]) for off in OFF} for topic in sorted(topics)}


def turned(T_base_sensor: se3.Matrix, axis: str, angle: float) -> se3.Matrix:
    """The mount, turned about an axis of base_link through the laser."""
    turn = [angle if name == axis else 0.0 for name in AXES]
    result = T_base_sensor.copy()
    result[:, :3, :3] = se3.from_xyz_rpy([0.0, 0.0, 0.0, *turn])[:3, :3] @ T_base_sensor[:, :3, :3]
    return result


def fault_of(topic: str, watch: MountWatch) -> str:
    """What is told of one laser."""
    parts = dict(part.split(": ") for part in watch.fault().split("; ") if part)
    return parts.get(topic, "")


def cell(axis: str, found: dict[tuple[str, float], str]) -> str:
    """The angles that are told where it is too large, and too small; with all that is wrong."""
    signed = []
    for degrees in (2.0, -2.0):
        text = found[axis, degrees]
        one = re.fullmatch(rf"{axis} seems ([\d.]+) degrees too (large|small)", text)
        sign = {"large": "+", "small": "-"}
        signed.append(f"{sign[one[2]]}{one[1]}" if one else text or "none")
    return "-" if signed == ["none", "none"] else ", ".join(signed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bags", nargs="+", type=Path)
    parser.add_argument("--odom-topic", help="in place of that which `heightmap25d map` takes")
    options = parser.parse_args()
    logging.disable()
    print("| recording | laser | right | roll | pitch | yaw |\n|---|---|---|---|---|---|")
    for path in options.bags:
        for topic, found in told(path, options.odom_topic).items():
            cells = [found[RIGHT] or "-", *(cell(axis, found) for axis in AXES)]
            print(f"| {path.name} | {topic} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
