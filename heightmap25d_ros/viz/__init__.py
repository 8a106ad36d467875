# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures and 3-D views.

`map_figures`, `plan_figure`, `localization_figures`, `slam_figures`, `merge_figures` and
`exploration_figures` draw with matplotlib; `block_mesh`, `markers` and `marker_cdr` make blocks for
RViz, and `field_arrows` arrows; `rerun_scene` is a scene for rerun. `palette` has the colours of
all of them, and `walls` finds walls of which no foot was seen.
"""
