# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""QoS profiles of the nodes' topics."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

QUEUE = QoSProfile(depth=10)
"""Of goals, corrections and the like: reliable."""

POSES = QoSProfile(depth=100)
"""Of odometry and transforms: deep enough for those that come while a map is converted."""

SCANS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
"""As qos_profile_sensor_data, but deep enough for the scans that come while a map is converted."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of maps and plans: reliable, and a late subscriber gets the newest one."""

STATIC_TRANSFORMS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of /tf_static."""
