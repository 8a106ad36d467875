# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the robot is on a map that was made before.

`short_term` keeps what the robot saw in its last metres, `registration` (or the literal
`paper_registration`) holds it against the long-term map (`surface`) with the score of `matching`,
`global_search` does so without a prior, and `pose_filter` joins registrations and odometry.
`tracker` does all of it; `tracking_state` says how sure it is. Import from these modules.
"""
