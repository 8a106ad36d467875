# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The drifting odometry of a bag is corrected against a map of the room.

Usage: python examples/localize_bag.py [DIRECTORY]    (default: out/examples)
"""

import sys
from pathlib import Path

import numpy as np

import heightmap25d_ros as hm
from heightmap25d_ros.io.trajectory import write_tum

BAG = Path(__file__).resolve().parents[1] / "bags" / "room_1"
directory = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")
directory.mkdir(parents=True, exist_ok=True)

long_term = hm.map_bag(BAG, odom_topic="/ground_truth")
trajectory = hm.localize_bag(BAG, long_term)  # with /odom, which drifts
write_tum(directory / "room.tum", trajectory)

ends = {"localized": trajectory[-1][1][:2, 3]}
with hm.Bag(BAG) as bag:
    for topic in ("/odom", "/ground_truth"):
        *_, last = bag.events([topic])
        position = last.message.pose.pose.position
        ends[topic] = np.array([position.x, position.y])
for name in ("/odom", "localized"):
    print(f"{name}: off by {np.linalg.norm(ends[name] - ends['/ground_truth']):.3f} m at the end")
