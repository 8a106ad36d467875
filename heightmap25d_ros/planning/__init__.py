# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From terrain and a goal to a path, or the reason why there is none.

`graph` holds the cells that the robot may enter and the cost of each transition
(`transition_costs`), `kept_graph` that of a map that comes again, of which only what has changed is
made anew, and `boundary` is the area that the robot may not leave. `start_clearing` frees the
ground under the robot, `search` computes the cost to go and `route` the cheapest cells, `smoothing`
makes an any-angle path of them, `collision` and `rectangle_check` check the robot's rectangle along
the path, and `surface_poses` puts it on the ground. `refusals` are the reasons why there is no
path. `planner` runs all of it; `plan` are its data types. `level_graph` and `level_planner` do the
same over a map with several levels.
"""
