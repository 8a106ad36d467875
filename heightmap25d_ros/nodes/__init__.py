# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 nodes: the only modules that import rclpy.

One file a node, which is thin: it hands messages to a pipeline and publishes what comes of them.
`guard` is the one place through which their callbacks run. `lifecycle` is what all managed nodes
share, `plain` what the others do, `runtime` runs a node as a process. `planner_server` has the
actions and services by which Nav2 plans. `map_publisher` publishes `map_messages`, and decides by
`map_updates` whether all of a map goes out, or what has changed; `map_source` subscribes to both.
"""
