# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From heights to obstacles.

`steps` finds steps between cells, `ground_plane` slopes and roughness under the footprint,
`gap_filling` closes narrow unknown gaps. `traversability` makes the obstacle map of a dense map,
and `obstacle_grid` keeps that of a growing one up to date. Import from these modules.
"""
