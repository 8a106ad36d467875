# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a path and a pose to a velocity.

`pure_pursuit` follows a path: regulated pure pursuit, as in Nav2, and turns on the spot.
"""
