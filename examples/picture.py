# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Three pictures of a map: heights from above, obstacles, and blocks in 3-D.

Usage: python examples/picture.py [DIRECTORY]    (default: out/examples)
"""

import sys
from pathlib import Path

import heightmap25d_ros as hm

BAG = Path(__file__).resolve().parents[1] / "bags" / "ramp"
directory = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")
directory.mkdir(parents=True, exist_ok=True)

height_map = hm.map_bag(BAG)
hm.map_figures.height_map(directory / "heights.png", height_map)
hm.map_figures.obstacle_map(directory / "obstacles.png", hm.to_obstacle_map(height_map))
hm.map_figures.blocks(directory / "blocks.png", height_map)
print(f"heights.png, obstacles.png and blocks.png are in {directory}")
