# SPDX-FileCopyrightText: 2026 heightmap25d_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated ATRV-Jr with laser scanners, in worlds whose truth is known. Needs MuJoCo.

Read in this order: ``scene`` (solids and rays), ``worlds`` with ``indoor``, ``outdoor``, ``plain``
and ``repeats`` (the places), ``robot`` (wheels on the ground), ``lasers`` and ``odometry`` (what is
measured, and how well), ``simulation`` (all of it in steps of time), ``drive`` and ``recording`` (a
bag), ``truth`` (what a map is held against). Nothing in the package but the command line and the
node imports it.
"""
