# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Localization on a long-term map.

A `long_term_map` has a surface and landmarks for each level; the pose tells which one counts.

`short_term` keeps the surroundings of the last metres, `registration` aligns them with the
long-term map (a `surface`) by the score of `matching`, `global_search` does so without a prior
(by a `sweep` over the windows of a `height_pyramid`, then `branch_and_bound`; `level_search` on all
levels), both in slices (`sliced_search`),
`hypotheses` tracks what it cannot tell apart, and `pose_filter` combines registrations and
odometry, whose `odometry_errors` are learned. `tracker` runs all of it, and `tracking_state` is its
state; `paper_registration` is the paper's method.

`scan_filter` updates the pose by single scans: returns of the last moment (`scan_window`) are
matched (`scan_update`) with the walls and the ground of the long-term map (`layers`, `landmarks`,
`wall_lines`, `ground_planes`), or of one that is being made (`growing_map`). Where they contradict
the map or do not tell enough, `scan_proposal` asks short-term maps, and looks for the place around
(`scan_search`).
"""
