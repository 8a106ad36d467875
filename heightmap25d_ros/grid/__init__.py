# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The cells of the map and their geometry.

`HeightMap` is a dense rectangle: what is saved, published, converted and drawn. `HeightGrid` is the
map that grows, in tiles that take memory where something was seen.
"""
