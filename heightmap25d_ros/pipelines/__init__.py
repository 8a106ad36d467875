# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in, results out, with state over time.

What a node and a command both drive. `scan_queue` joins scans (not `repeated_scans`) with poses
(`odometry_gate`, `odometry_spikes`, `map_correction`) and mounts (`transform_buffer`); poses are
messages of several types (`robot_pose`), a map follows `submap_poses`, goals are in any frame
(`map_frames`), maps of several levels are two messages (`level_map`). `sensor_intake` hands what
the queue releases to `mapping`, `localization`, and `slam` without known poses, of several drives
in `slam_drives`; `planning` has its `mission`, the `path_requests` of others and the `speed_limit`.
`replay` feeds a bag, and `from_bag` does so in one call. `exploration` chooses goals for an
`exploration_task`, with the state of an `exploration_run`, and `path_following` drives along the
plan. `drops` decodes messages and counts those that are not used; `input_watch`, with its
`mount_watch`, and `self_check` find out what is missing, and `silence` who has fallen silent.
"""
