# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures and 3-D views.

Figures with matplotlib (`map_figures`, `plan_figure`, `localization_figures`), blocks and arrows
for RViz (`block_mesh`, `markers`, `marker_cdr`), and a scene for rerun (`rerun_scene`). Import from
these modules: only what draws figures loads matplotlib.
"""
