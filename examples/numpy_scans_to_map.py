# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans in numpy arrays become a height map: a robot drives towards a step of 0.30 m.

Usage: python examples/numpy_scans_to_map.py [DIRECTORY]    (default: out/examples)
"""

import sys
from pathlib import Path

import numpy as np

import heightmap25d_ros as hm

directory = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")
grid = hm.HeightGrid()
mapper = hm.Mapper(grid)
T_base_laser = hm.se3.from_xyz_rpy([0.28, 0.0, 0.60, 0.0, np.radians(28.0), 0.0])  # looks down
angles = np.radians(np.arange(-80.0, 80.5, 0.5))

for x in np.arange(0.0, 3.6, 0.05):
    T_map_base = hm.se3.from_xyz_rpy([x, 0.0, 0.0, 0.0, 0.0, 0.0])
    # In place of a laser: the ground is at z = 0, and at z = 0.30 m from x = 4.05 m on.
    T_map_laser = T_map_base @ T_base_laser
    along = T_map_laser[:3, :2] @ [np.cos(angles), np.sin(angles)]
    to_face = (4.05 - T_map_laser[0, 3]) / along[0]
    z_at_face = T_map_laser[2, 3] + to_face * along[2]
    to_level = (np.where(z_at_face < 0.30, 0.0, 0.30) - T_map_laser[2, 3]) / along[2]
    ranges = np.minimum(to_level, np.where(z_at_face < 0.30, to_face, np.inf))
    scan = hm.Scan(angle_min=angles[0], angle_increment=np.radians(0.5), ranges=ranges)
    mapper.add_scan(scan, T_map_base, T_base_laser)

height_map = grid.read()
hm.save_map(directory / "step", height_map)
for x in (2.0, 3.0, 4.1, 4.3):
    iy, ix = height_map.geometry.cell_at((x, 0.0))
    print(f"x = {x:.1f} m: {height_map.height[iy, ix]} cm")
