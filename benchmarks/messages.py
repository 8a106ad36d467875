# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What messages cost: a LaserScan of 361 beams into an array, a million cells into a map.

    python benchmarks/messages.py

Microseconds a call, medians of interleaved runs. A scan is decoded from its bytes (CDR) by
rclpy, which the node uses, by rosbags, which the command line uses, and field by field with
numpy; `messages.scan`, which checks it, comes on top.
"""

from __future__ import annotations

import array
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np
from nav_msgs.msg import OccupancyGrid
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import LaserScan

from heightmap25d_ros.grid.height_map import Geometry
from heightmap25d_ros.io import decode, encode
from heightmap25d_ros.io.bag import LASER_SCAN, Bag

RAMP = Path(__file__).parent.parent / "bags" / "ramp"
ROUNDS = 7
CALLS = 500
GRID = (1000, 1000)


def measure() -> dict[str, float]:
    """Medians in microseconds."""
    with Bag(RAMP) as bag:
        data = next(iter(bag.raw_events(["/scan"]))).data
    store = get_typestore(Stores.ROS2_JAZZY)
    decoded = deserialize_message(data, LaserScan)
    np.testing.assert_array_equal(_numpy_ranges(data), decoded.ranges)
    cells = np.random.default_rng(1).integers(-1, 101, GRID).astype(np.int8)
    cells_list, cells_array = cells.ravel().tolist(), array.array("b", cells.tobytes())
    geometry = Geometry(resolution=0.125, origin=(0.0, 0.0), shape=GRID)
    grid = OccupancyGrid()
    return _interleaved(
        {
            "decode LaserScan, rclpy": (CALLS, partial(deserialize_message, data, LaserScan)),
            "decode LaserScan, rosbags": (CALLS, partial(store.deserialize_cdr, data, LASER_SCAN)),
            "decode LaserScan, numpy": (CALLS, partial(_numpy_ranges, data)),
            "messages.scan": (CALLS, partial(decode.scan, decoded)),
            "OccupancyGrid.data, array.array": (5, partial(setattr, grid, "data", cells_array)),
            "OccupancyGrid.data, list": (1, partial(setattr, grid, "data", cells_list)),
            "fill_occupancy_grid": (
                5,
                partial(encode.fill_occupancy_grid, grid, cells, geometry, 0, "map"),
            ),
        }
    )


def _numpy_ranges(data: bytes) -> np.ndarray:
    """The ranges of a LaserScan, straight from its bytes."""
    body = memoryview(data)[4:]
    after_frame = 12 + int.from_bytes(body[8:12], "little")
    angles = -(-after_frame // 4) * 4  # seven float32, then the number of ranges
    count = int.from_bytes(body[angles + 28 : angles + 32], "little")
    return np.frombuffer(body, "<f4", count, angles + 32)


def _interleaved(runs: dict[str, tuple[int, Callable[[], object]]]) -> dict[str, float]:
    """Median microseconds of a call of each; the first round does not count."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(ROUNDS + 1):
        for name, (calls, run) in runs.items():
            began = time.perf_counter()
            for _ in range(calls):
                run()
            times[name].append(1e6 * (time.perf_counter() - began) / calls)
    return {f"{name} [us]": median(values[1:]) for name, values in times.items()}


if __name__ == "__main__":
    for figure, value in measure().items():
        print(f"{figure:38} {value:,.4g}")
