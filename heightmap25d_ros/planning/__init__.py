# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From terrain and a goal to a path, or the reason why there is none.

`graph` says where the robot's middle may be and what each transition costs, `search` makes the
cost-to-go field, `smoothing` an any-angle path, and `collision` checks the robot's rectangle along
it. `planner` does all of it.
"""
