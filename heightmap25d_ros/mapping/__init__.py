# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a scan to cells; arrays in, cells out.

`sensor_model` makes beams of a scan, `cell_update` is the paper's update of one cell, and `mapper`
walks each beam through the grid. Import from these modules.
"""
