# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 nodes: the only modules that import rclpy.

One file a node, which is thin: it hands messages to a pipeline and publishes what comes of them.
`lifecycle` is what all managed nodes share, `runtime` runs a node as a process.
"""
