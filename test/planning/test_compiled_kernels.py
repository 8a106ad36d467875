# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compilation takes seconds, and must not count against the timeout of a plan."""

import subprocess
import sys

# In a process of its own, in which no other test has compiled anything.
SCRIPT = """
import importlib, pkgutil
import numpy as np
import heightmap25d_ros.planning as room
from heightmap25d_ros.grid.height_map import HeightMap
from heightmap25d_ros.params.sections import PlannerParams
from heightmap25d_ros.planning.plan import Pose2D
from heightmap25d_ros.planning.planner import Planner, compile_kernels
names = [m.name for m in pkgutil.iter_modules(room.__path__)]
modules = [importlib.import_module(f"{room.__name__}.{name}") for name in names]
kernels = {k for m in modules for k in vars(m).values() if hasattr(k, "signatures")}
def compiled():
    return {k.py_func.__qualname__: len(k.signatures) for k in kernels}
compile_kernels()
before = compiled()
heights = np.zeros((64, 96))
heights[30, 20:60] = heights[36, 20:60] = 1.0
params = PlannerParams(goal_tolerance=0.5, timeout=600.0)
planner = Planner.from_height_map(HeightMap.from_metres(heights), params=params)
found = 0
for start in (Pose2D(1.0, 1.0, 0.0), Pose2D(5.0, 3.45, 0.3), Pose2D(5.0, 4.1, 1.5)):
    for goal in (Pose2D(10.0, 6.0, 1.0), Pose2D(5.0, 4.1), Pose2D(5.0, 3.8, 0.0)):
        for there in (False, True):
            for field in (False, True):
                plan = planner.plan(start, goal, is_robot_there=there, is_field_wanted=field)
                found += plan.found
                if plan.found: planner.cost_along(plan.poses, start)
assert found >= 4
assert compiled() == before, set(compiled().items()) - set(before.items())
"""


def test_no_plan_compiles_a_kernel_beside_a_wall_either():
    subprocess.run([sys.executable, "-c", SCRIPT], check=True)
