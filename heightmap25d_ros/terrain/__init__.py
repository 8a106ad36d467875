# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From heights to obstacles.

`steps` finds blocked transitions between cells, `ground_plane` slope and roughness under the
footprint, `gap_filling` fills narrow unknown gaps. `traversability` makes the obstacle map of a
dense map, and `obstacle_grid` keeps that of a growing one up to date. `slices` are the levels of a
map with several surfaces in a cell, and `shown_level` is the one of a growing map that is shown.
`explanation` tells why a cell is what it is.
"""
