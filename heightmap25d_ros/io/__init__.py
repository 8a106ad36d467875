# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bytes from outside become values, and values become bytes.

`decode` and `encode` for messages, `message_bytes` for those that come often, `point_cloud` for
clouds (`cloud_files` and `cloud_sequence` for those in files), `explanations` for what is asked
about a cell, `bag` for rosbag2, `map_directory` (written in one step by `atomic_directory`),
`layers_file`, `slam_file` and `merge_file` (both `report_file`), and `trajectory` for files,
`occupancy_map`, `point_files` and `geotiff` for those of others. What is not sound raises
`InputError`, which names the file, topic or field.
"""
