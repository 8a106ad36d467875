# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag becomes a height map, the map becomes obstacles, and a path leads up the ramp.

Usage: python examples/bag_to_path.py [DIRECTORY]    (default: out/examples)
"""

import sys
from pathlib import Path

import numpy as np

import heightmap25d_ros as hm

BAG = Path(__file__).resolve().parents[1] / "bags" / "ramp"
directory = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")

height_map = hm.map_bag(BAG)
obstacle_map = hm.to_obstacle_map(height_map)
hm.save_map(directory / "ramp", height_map, obstacle_map)

planner = hm.Planner.from_height_map(height_map)
plan = planner.plan(hm.Pose2D(24.0, 0.0), hm.Pose2D(4.0, 0.0, yaw=np.pi))
if not len(plan.poses):
    sys.exit(f"no path: {plan.reason}")
print(f"{plan.length:.1f} m long, {plan.climb:.2f} m up, cost {plan.cost:.1f} m of flat ground")
np.savetxt(directory / "path.txt", hm.se3.to_xyz_rpy(plan.poses), "%.4f", header="x y z r p y")
