# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The table of docs/slam.md on merged maps: halves of laps, in frames of their own.

Usage: python studies/measure_merge.py [WORLD_SEED ...]

Each lap of the simulator is mapped with its true poses: its first 60 %, its last 60 % in another
frame, and all of it. The halves are registered and merged. Markdown to the terminal.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from heightmap25d_ros import se3
from heightmap25d_ros.evaluation import map_error, truth
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.io.bag import Bag
from heightmap25d_ros.params.by_name import with_values
from heightmap25d_ros.params.sections import Params
from heightmap25d_ros.pipelines.mapping import Mapping
from heightmap25d_ros.pipelines.replay import replayed
from heightmap25d_ros.pipelines.scan_queue import Reading
from heightmap25d_ros.simulation import recording
from heightmap25d_ros.slam.map_merge import merge_maps
from heightmap25d_ros.slam.map_registration import Outcome, RegisteredMap, register_maps

LAPS = ("room_1", "ramp_1", "street_1", "rough_1", "room_2", "ramp_2", "street_2", "rough_2")
PARAMS = with_values(Params(), {"intake.scan_topics": ["/scan", "/scan_down"]})
T_SECOND_FIRST = se3.from_xyz_rpy([3.3, -7.7, 0.4, 0.0, 0.0, 1.1])


class MovedMapping(Mapping):
    """Mapping in a frame of its own."""

    T = np.eye(4)

    def merge(self, reading: Reading) -> None:
        """Merge a scan, moved."""
        super().merge(dataclasses.replace(reading, T_map_base=self.T @ reading.T_map_base))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("laps", nargs="*", default=LAPS, metavar="WORLD_SEED")
    with tempfile.TemporaryDirectory() as scratch:
        for line in table(parser.parse_args().laps, Path(scratch)):
            print(line, flush=True)


def table(laps: Sequence[str], scratch: Path) -> Iterator[str]:
    yield "| lap | error: position | z | yaw | F1: first half | merged | whole lap | CPU |"
    yield "|---|---|---|---|---|---|---|---|"
    maps: dict[str, RegisteredMap] = {}
    for lap in laps:
        world, seed = lap.rsplit("_", 1)
        recording.simulate(world, int(seed), scratch / lap, drive=0)
        first, second, whole = (
            mapped(scratch / lap, part, T)
            for part, T in (
                ((0.0, 0.6), np.eye(4)), ((0.4, 1.0), T_SECOND_FIRST), ((0.0, 1.0), np.eye(4))
            )
        )  # fmt: skip
        maps[lap] = whole
        began = time.process_time()
        found = register_maps(first, second, PARAMS)
        seconds = time.process_time() - began
        if found.outcome is not Outcome.REGISTERED:
            yield f"| `{lap}` | {found.outcome.value} | | | | | | {seconds:.0f} s |"
            continue
        merged = merge_maps([first, second], [np.eye(4), found.T_fixed_moving], PARAMS)
        x, y, z, _, _, yaw = se3.to_xyz_rpy(found.T_fixed_moving @ T_SECOND_FIRST)
        surface = truth.read_truth(scratch / lap / "truth" / "surface.npz")
        scores = " | ".join(
            f"{f1(height_map, surface):.3f}"
            for height_map in (first.height_map, merged.height_map, whole.height_map)
        )
        yield (
            f"| `{lap}` | {100 * np.hypot(x, y):.1f} cm | {100 * abs(z):.1f} cm "
            f"| {abs(np.degrees(yaw)):.2f} deg | {scores} | {seconds:.0f} s |"
        )
    pairs = [(a, b) for a in maps for b in maps if a < b]
    outcomes = [register_maps(maps[a], maps[b], PARAMS).outcome for a, b in pairs]
    wrong = [pair for pair, o in zip(pairs, outcomes, strict=True) if o is Outcome.REGISTERED]
    yield f"\nPairs of different worlds or seeds: {len(pairs)}, not refused: {wrong or 'none'}."


def mapped(path: Path, part: tuple[float, float], T: se3.Matrix) -> RegisteredMap:
    mapping = MovedMapping(PARAMS)
    mapping.T = T
    with Bag(path) as bag:
        begin, end = (bag.start_ns + int(share * bag.duration * 1e9) for share in part)
        for _ in replayed(bag, mapping, "/ground_truth", PARAMS.intake, (begin, end)):
            pass
    height_map, _ = mapping.maps()
    return RegisteredMap(height_map, mapping.layers(height_map.geometry), PARAMS)


def f1(height_map: HeightMap, surface: truth.Truth) -> float:
    """Of the blocked transitions."""
    found = map_error.evaluate_map(height_map, PARAMS.traversability, surface)
    return found.blocked_transitions.f1 or 0.0


if __name__ == "__main__":
    main()
