# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From terrain and a goal to a path, or the reason why there is none.

`graph` holds the cells that the robot may enter and the cost of each transition
(`transition_costs`), `start_clearing` frees the ground under the robot, `search` computes the cost
to go, `smoothing` makes an any-angle path of it, `collision` checks the robot's rectangle along the
path, and `surface_poses` puts the path on the ground. `planner` runs all of it; `plan` are its data
types.
"""
