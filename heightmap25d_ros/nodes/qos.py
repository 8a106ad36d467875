# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node as a process, which ends cleanly; and the qualities of service of the nodes."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of maps and plans: reliable, and who comes late gets the last one."""

STATIC_TRANSFORMS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of /tf_static."""

SCANS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
"""As qos_profile_sensor_data, but deep enough for the scans that come while a map is converted
or searched."""
