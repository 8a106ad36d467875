# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a scan or a cloud to cells; arrays in, cells out.

`sensor_model` makes the beams of a `scan` and `cloud` those of a point cloud, `cell_update` is the
paper's update of one cell, `level_update` that of a cell with several surfaces, `mapper` traces
each beam through the grid and marks `changed_tiles`, and `drop_offs` marks what beams tell of
beyond edges.
`ground_evidence` tells whether lasers see any ground; `driven_ground` and `side_slip` tell by
`scan_points` whether they are mounted as assumed.
"""
