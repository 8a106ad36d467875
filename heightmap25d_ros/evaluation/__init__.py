# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results against the truth.

`truth` reads what the simulator knows; `map_error`, `path_drivability`, `trajectory_error` and
`goal_reachability` hold results against it. They share no code with what they judge. Import from
these modules.
"""
