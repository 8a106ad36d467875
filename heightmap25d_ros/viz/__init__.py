# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures and 3-D views.

Figures with matplotlib, meshes and arrows for RViz, and a scene for rerun.
"""
