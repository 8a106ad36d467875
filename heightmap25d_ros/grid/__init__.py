# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The cells of the map and their geometry.

`height_map` has the dense rectangle, which is saved, published, converted and drawn; `height_grid`
the map that grows, in tiles that take memory where something was seen. Import from these modules:
``from heightmap25d_ros.grid.height_map import HeightMap``.
"""
