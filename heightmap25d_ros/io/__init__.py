# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bytes from outside become values, and values become bytes.

`decode` and `encode` for messages, `point_cloud` for clouds, `tf_bytes` for those of /tf, `bag` for
rosbag2, `map_directory` (written in one step by `atomic_directory`), `layers_file`, `slam_file` and
`trajectory` for files. What is not sound raises `InputError`, which names the file, topic or field.
"""
