# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures and 3-D views.

Figures of maps, plans and localization with matplotlib; meshes and arrows for RViz; a scene for
rerun.
"""
