# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From terrain and a goal to a path, or the reason why there is none.

`graph` says where the robot's middle may be and what each transition costs (`transition_costs`),
`start_clearing` frees the ground under the robot, `search` makes the cost-to-go field, `smoothing`
an any-angle path, `collision` checks the robot's rectangle along it, and `surface_poses` puts it on
the ground. `planner` does all of it; `plan` has what it takes and returns. Import from these
modules.
"""
