# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of results against ground truth.

`truth` reads the truth files of the simulator; `map_error`, `level_error`, `path_drivability`,
`trajectory_error` and `goal_reachability` compare maps, their levels, paths, trajectories and
reachable goals with them. They share
no code with what they evaluate.
"""
