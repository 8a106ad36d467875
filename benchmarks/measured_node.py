# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mapping node, noting when each scan was merged.

measured_node.py FILE events|default [ROS arguments]
"""

import json
import sys
import time
from pathlib import Path

from rclpy.executors import SingleThreadedExecutor

from heightmap25d_ros.nodes import mapping, runtime
from heightmap25d_ros.pipelines.mapping import Mapping

LASERS = ["-p", "intake.scan_topics:=[scan, scan_down]"]

merged: dict[str, float] = {}
made: list[Mapping] = []


class MeasuredMapping(Mapping):
    def __init__(self, params):
        super().__init__(params)
        made.append(self)

    def _use(self, readings):
        for reading in readings:
            super()._use([reading])
            merged[f"/{reading.topic} {reading.scan.stamp_ns}"] = time.time()
        return readings


if __name__ == "__main__":
    file = Path(sys.argv[1])
    mapping.Mapping = MeasuredMapping
    if sys.argv[2] == "default":
        runtime.EventsExecutor = SingleThreadedExecutor  # what rclpy.spin() takes
    runtime.run(
        mapping.MappingNode,
        ["measured_node", "--ros-args", *(sys.argv[3:] or LASERS)],
    )
    file.write_text(json.dumps({"merged": merged, "dropped": made[0].dropped.total()}))
