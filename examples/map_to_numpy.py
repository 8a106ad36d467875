# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map directory becomes numpy arrays: heights in metres, and coordinates of the cells.

Usage: python examples/map_to_numpy.py [DIRECTORY]    (default: out/examples)
"""

import sys
from pathlib import Path

import numpy as np

import heightmap25d_ros as hm

BAG = Path(__file__).resolve().parents[1] / "bags" / "ramp"
directory = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")
hm.save_map(directory / "ramp", hm.map_bag(BAG))  # or: heightmap25d map bags/ramp -o DIR/ramp

height_map = hm.load_map(directory / "ramp").height_map
metres = np.where(height_map.known, height_map.height / 100.0, np.nan)  # (rows y, columns x)
cells = np.moveaxis(np.indices(metres.shape), 0, -1)
x, y = np.moveaxis(height_map.geometry.cell_center(cells), -1, 0)
np.savez(directory / "ramp.npz", metres=metres, x=x, y=y)

highest = np.unravel_index(np.nanargmax(metres), metres.shape)
print(f"{np.isfinite(metres).sum()} of {metres.size} cells are known")
print(f"the highest one is at ({x[highest]:.2f}, {y[highest]:.2f}) m: {metres[highest]:.2f} m")
