# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Localization on a long-term map.

`short_term` keeps the surroundings of the last metres, `registration` aligns them with the
long-term map (a `surface`) by the score of `matching`, `global_search` does so without a prior,
and `pose_filter` combines registrations and odometry. `tracker` runs all of it, and
`tracking_state` is its state; `paper_registration` is the paper's method.
"""
