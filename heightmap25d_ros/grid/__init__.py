# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The cells of the map and their geometry.

`height_map` is a dense rectangle: what is saved, published, converted and drawn. `height_grid` is
the growing map, in tiles that take memory only where cells were observed (`lazy_zeros`). `levels`
are the surfaces above the lowest one in a cell, and `map_changes` tells where a map has changed.
"""
