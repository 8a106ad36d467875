# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A 2 1/2-D map for ROS 2: a height and a probability per cell (Fong et al., 2003)."""
